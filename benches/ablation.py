#!/usr/bin/env python3
"""Whole commands with and without a mechanism: processor time and memory, the least of some repetitions.

    python3 benches/ablation.py with=target/release/sprung without=/elsewhere/sprung [--repeat 3] [--threads 1]
        [--scenes cloth:100:6,lattice:24:5,network:10000:4] [--methods linear-backward-euler,bdf2] [-- options of `sprung run`]

Each program is one build; `without` is built from a copy of the sources in which the mechanism is taken out. A scene is KIND:SIZE:STEPS, made by
`sprung new`. Programs take turns, so that what else the machine does hits all of them. Prints a Markdown table: a mechanism stays where the
ratio of time reaches 1.15, or that of memory 4/3.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile


def run(program, arguments):
    """Processor seconds, MiB, exit status."""
    process = subprocess.Popen([program, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, process.returncode


def best(runs):
    return [min(column) for column in zip(*runs)]


def main():
    own, options = sys.argv[1:], []
    if "--" in own:
        at = own.index("--")
        own, options = own[:at], own[at + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("programs", nargs="+", metavar="NAME=PROGRAM")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--dt", default="0.01")
    parser.add_argument("--scenes", default="cloth:32:20,cloth:100:6,lattice:8:20,lattice:24:5,network:400:20,network:10000:4")
    parser.add_argument("--methods", default="linear-backward-euler,bdf2,rodas4")
    arguments = parser.parse_args(own)
    programs = dict(program.split("=", 1) for program in arguments.programs)
    names = list(programs)
    print("| scene | steps | method | " + " | ".join(f"{name}: s, MiB" for name in names) + " | ratios | CG iterations, factorizations |")
    print("|---" * (5 + len(names)) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for scene in arguments.scenes.split(","):
            kind, size, steps = scene.split(":")
            file = pathlib.Path(folder, f"{kind}{size}.toml")
            with file.open("w") as text:
                subprocess.run([programs[names[0]], "new", kind, "--size", size], stdout=text, check=True)
            for method in arguments.methods.split(","):
                runs, work = {name: [] for name in names}, {}
                for _ in range(arguments.repeat):
                    for name, program in programs.items():
                        out = pathlib.Path(folder, f"{name}-out")
                        common = ["--steps", steps, "--dt", arguments.dt, "--method", method, "--threads", str(arguments.threads)]
                        seconds, memory, _ = run(program, ["run", str(file), *common, "--out", str(out), "--quiet", *options])
                        runs[name].append((seconds, memory))
                        done = json.loads((out / "summary.json").read_text())["work"]
                        work[name] = f"{done['cg_iterations']}, {done['factorizations']}"
                least = {name: best(of) for name, of in runs.items()}
                first = least[names[0]]
                ratios = ["/".join(f"{mine / base:.2f}" for mine, base in zip(least[name], first)) for name in names[1:]]
                cells = [f"{seconds:.3f}, {memory:.0f}" for seconds, memory in least.values()]
                print(f"| {kind} {size} | {steps} | {method} | " + " | ".join(cells) + f" | {', '.join(ratios)} | {'; '.join(work.values())} |", flush=True)


if __name__ == "__main__":
    main()
