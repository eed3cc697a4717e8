#!/usr/bin/env python3
"""Measures explicit steps beside a program in C with the same layout of data, in turn, and writes docs/performance/explicit.md.

    benches/explicit/run.py [SCENE…]        for example: benches/explicit/run.py "cloth 100" "lattice 22"

Needs Rust and gcc. Both programs stay in memory and make bursts of steps in turn, on one thread, timed by its processor time; every
figure is a median over the rounds, and quotients are formed round by round. Before anything is timed both have made
the same steps, and their positions are compared.
"""

import json
import resource
import statistics
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SCENES = ["cloth 10", "cloth 32", "cloth 100", "cloth 316", "lattice 5", "lattice 10", "lattice 22", "lattice 46"]
KINDS = ["forces", "symplectic-euler", "verlet"]
BUILDS = {"-O3": ["-O3"], "-O3 -march=native": ["-O3", "-march=native"]}
ROUNDS = 41
# Processor time of a burst, in ns: long against the clock's grain, short against what else the machine does.
BURST = 1e7
# Of the whole command, in steps: the difference of two runs has no start of the program in it.
COMMAND_SECONDS = 1.0


def build(folder):
    message = subprocess.run(["cargo", "build", "--release", "--bin", "sprung", "--bench", "explicit", "--message-format", "json"],
                             check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout
    built = {m["target"]["name"]: m["executable"] for m in map(json.loads, message.splitlines()) if m.get("executable")}
    peers = {}
    for number, (name, options) in enumerate(BUILDS.items()):
        peers[name] = folder / f"explicit-{number}"
        subprocess.run(["gcc", *options, HERE / "explicit.c", "-o", peers[name], "-lm"], check=True)
    return built["explicit"], built["sprung"], peers


class Program:
    """One that answers a line with a number."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(part) for part in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, kind, what):
        self.process.stdin.write(f"{kind} {what}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())


def positions(program, folder):
    program.ask("positions", folder / "after.bin")
    import array
    values = array.array("d")
    values.frombytes((folder / "after.bin").read_bytes())
    return values


def check_same_motion(ours, peers, folder):
    """Ten steps of Verlet from the same start: the same formulas, differently rounded."""
    ours.ask("verlet", 10)
    expected = positions(ours, folder)
    size = max(map(abs, expected))
    for name, peer in peers.items():
        peer.ask("verlet", 10)
        error = max(abs(a - b) for a, b in zip(positions(peer, folder), expected))
        if not error <= 1e-12 * size:
            sys.exit(f"C with {name} ends {error} m away after ten steps")


def command(program, folder, steps):
    """Processor time of a whole run by the command, in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([program, "run", folder / "scene.json", "--method", "verlet", "--dt", "1e-5", "--steps", str(steps), "--threads", "1",
                    "--out", folder / "out"],
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime) - (before.ru_utime + before.ru_stime)


def measure(scene, ours_at, sprung, peers_at):
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        subprocess.run([ours_at, "export", *scene.split(), folder], check=True)
        ours = Program(ours_at, "serve", *scene.split())
        peers = {name: Program(at, folder) for name, at in peers_at.items()}
        check_same_motion(ours, peers, folder)
        result = {"scene": scene, "springs": (folder / "springs.bin").stat().st_size // 8}
        for kind in KINDS:
            ours.ask(kind, 1)
            steps = max(1, round(BURST / ours.ask(kind, 1)))
            rounds = [{"sprung": ours.ask(kind, steps), **{name: peer.ask(kind, steps) for name, peer in peers.items()}}
                      for _ in range(ROUNDS)]
            result[kind] = statistics.median(r["sprung"] for r in rounds)
            for name in peers:
                result[f"{kind} {name}"] = statistics.median(r["sprung"] / r[name] for r in rounds)
        steps = max(1, round(BURST / ours.ask("monitored", 1)))
        pairs = [(ours.ask("monitored", steps), ours.ask("verlet", steps)) for _ in range(ROUNDS)]
        result["monitored"] = statistics.median(a / b for a, b in pairs)
        steps = max(4, round(COMMAND_SECONDS * 1e9 / (2.5 * result["verlet"])))
        times = [(command(sprung, folder, 2 * steps) - command(sprung, folder, steps)) / steps * 1e9 for _ in range(5)]
        result["command"] = statistics.median(times) / result["verlet"]
    return result


def rows_of(heads, rows):
    return ["| " + " | ".join(row) + " |" for row in [heads, ["---"] * len(heads), *rows]]


def table(results):
    """Quotients, the builds of C beside each other, and below them what the library's steps take by themselves."""
    quotients = [[r["scene"], *(", ".join(f"{r[f'{kind} {name}']:.2f}" for name in BUILDS) for kind in KINDS),
                  f"{r['monitored']:.2f}", f"{r['command']:.2f}"] for r in results]
    times = [[r["scene"], str(r["springs"]), *(f"{r[kind] / r['springs']:.2f}" for kind in KINDS)] for r in results]
    return [*rows_of(["scene", *(f"{kind} / C" for kind in KINDS), "monitored / not", "command / step"], quotients), "",
            *rows_of(["scene", "springs", *(f"{kind}, ns a spring" for kind in KINDS)], times)]


def cpu():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "unknown processor")


def main():
    scenes = sys.argv[1:] or SCENES
    with tempfile.TemporaryDirectory() as folder:
        ours, sprung, peers = build(Path(folder))
        results = []
        for scene in scenes:
            print(f"measuring {scene}", file=sys.stderr, flush=True)
            results.append(measure(scene, ours, sprung, peers))
        threads = subprocess.run([ours, "threads"], check=True, stdout=subprocess.PIPE, text=True).stdout if not sys.argv[1:] else ""
    text = (HERE / "remarks.md").read_text().format(day=date.today().isoformat(), machine=cpu(), rounds=ROUNDS,
                                                   table="\n".join(table(results)), threads=threads.strip())
    if sys.argv[1:]:
        print("\n".join(table(results)))
    else:
        (ROOT / "docs" / "performance" / "explicit.md").write_text(text)


if __name__ == "__main__":
    main()
