"""Pictures and worked numbers of the theory chapters of the guide. Only the standard library.

    python3 xtask/docs/theory.py pictures     draws docs/guide/src/theory/*.svg from runs of the program
    python3 xtask/docs/theory.py numbers      runs the commands of the chapters and compares what they print

The program is target/release/sprung, or what SPRUNG names.
"""

import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from plot import COLOURS, plot

ROOT = Path(__file__).resolve().parents[2]
CHAPTERS = ROOT / "docs/guide/src/theory"
SCENES = ROOT / "src/verify/scenes"
SPRUNG = Path(os.environ.get("SPRUNG", ROOT / "target/release/sprung")).resolve()
DOTS = {"line": None, "mark": "circle"}
GREY = {"colour": "#3c3c3c"}


def sprung(*arguments, fails=False):
    """What the program prints; it must end with status 0 unless it may fail."""
    done = subprocess.run([SPRUNG, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode and not fails:
        raise SystemExit(f"sprung {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout


def run(scene, *arguments, fails=False):
    """A run's summary, positions at the end and rows of energies; `None` of one that fails and may."""
    with tempfile.TemporaryDirectory() as folder:
        text = sprung("run", scene, *arguments, "--json", "--quiet", "--out", folder, fails=fails)
        summary = json.loads(text)
        if fails and summary["status"] != "completed":
            return None
        end = json.loads((Path(folder) / "final.json").read_text())
        with open(Path(folder) / "energy.csv") as file:
            rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
        return summary, end["positions"], rows


def inspect(scene, *arguments):
    with tempfile.TemporaryDirectory() as folder:
        return json.loads(sprung("inspect", scene, *arguments, "--json", "--quiet", "--out", folder))


def scene(text):
    """A scene in a file of its own, which is left to the system to remove."""
    file = Path(tempfile.mkstemp(suffix=".toml")[1])
    file.write_text(text)
    return file


def builtin(kind, size):
    return scene(sprung("new", kind, "--size", size))


def relative_error(positions, reference):
    """The relative position error of two lists of positions."""
    centre = [sum(column) / len(reference) for column in zip(*reference)]
    extent = math.dist([c for row in reference for c in row], [c for _ in reference for c in centre])
    return math.dist([c for row in positions for c in row], [c for row in reference for c in row]) / extent


OSCILLATOR = CHAPTERS / "spring.toml"


def spring():
    """Force and stiffness of one spring at many lengths, out of the matrices that the program writes."""
    k, l0, tension, axial, transverse = 120.0, 0.8, [], [], []
    for step in range(11, 41):
        length = 0.05 * step * l0
        file = scene(f"""
            particles = {{ positions = [[0, 0], [{length}, 0]], masses = 1.0 }}
            springs = {{ pairs = [[0, 1]], stiffness = {k}, rest_lengths = {l0} }}
            [[constraints]]
            particles = [0]
            """)
        with tempfile.TemporaryDirectory() as folder:
            sprung("matrix", file, "--dt", 0.1, "--quiet", "--out", folder)
            entries = (Path(folder) / "K.mtx").read_text().split("\n")
            values = {tuple(line.split()[:2]): float(line.split()[2]) for line in entries if re.match(r"\d+ \d+ -?\d.*\.", line)}
            force = [line for line in (Path(folder) / "b.mtx").read_text().split("\n") if line and not line.startswith("%")][1]
        tension.append((length / l0, -float(force) / k))
        axial.append((length / l0, -values["1", "1"] * l0 / k))
        transverse.append((length / l0, -values.get(("2", "2"), 0.0) * l0 / k))
    plot(CHAPTERS / "spring.svg", "Tension and stiffness of one spring", "stretch l/l₀", "in units of k and k/l₀",
         [("tension, over k", tension, {}), ("stiffness along, over k/l₀", axial, {}),
          ("stiffness across, over k/l₀", transverse, {}), ("", [(0.5, 0), (2.05, 0)], GREY)], ylimits=(-1.1, 1.3), xlimits=(0.5, 2.05))


def matrices():
    """The pattern of A, as `sprung inspect` draws it."""
    with tempfile.TemporaryDirectory() as folder:
        sprung("inspect", builtin("network", 20), "--dt", 0.01, "--quiet", "--out", folder)
        (CHAPTERS / "matrices.svg").write_text((Path(folder) / "pattern-A.svg").read_text())


def step():
    """The energy that linearised backward Euler takes from a vibration."""
    series = []
    for (z, shape), colour in zip([(0.25, "circle"), (0.5, "square"), (1.0, "triangle")], COLOURS):
        count = round(8 / z)
        _, _, rows = run(OSCILLATOR, "--method", "linear-backward-euler", "--dt", z / 10, "--steps", count)
        series.append((f"ω dt = {z:g}", [(10 * row["time"], row["total"] / 0.5) for row in rows],
                       {"line": None, "mark": shape, "colour": colour}))
        theory = [(z * n, (1 + z * z) ** -n) for n in range(count + 1)]
        series.append(("", theory, {"colour": colour}))
    plot(CHAPTERS / "step.svg", "Energy of a vibration: steps, and (1 + ω²dt²)⁻ⁿ as lines", "ω t", "energy over that at the start",
         series, xlimits=(0, 8), ylimits=(0, 1.02))


def definiteness():
    """λ_min of A over the step, as `sprung inspect` draws it."""
    with tempfile.TemporaryDirectory() as folder:
        sprung("inspect", SCENES / "compressed_chain.toml", "--quiet", "--out", folder)
        (CHAPTERS / "definiteness.svg").write_text((Path(folder) / "lambda-min.svg").read_text())


def indefinite():
    """The transverse coefficient that each option puts in the matrix, over the stretch; closed forms."""
    stretches = [0.4 + 0.02 * step for step in range(81)]
    exact = [(stretch, 1 - 1 / stretch) for stretch in stretches]
    options = {"full": lambda a: a, "tension": lambda a: max(a, 0.0), "absolute": abs, "axial": lambda a: 0.0}
    lines = [{}, {"line": "dashed"}, {"line": "dashed"}, GREY]
    series = [(name, [(stretch, of(a)) for stretch, a in exact], line) for (name, of), line in zip(options.items(), lines)]
    plot(CHAPTERS / "indefinite.svg", "Stiffness across a spring in the matrix of each option", "stretch l/l₀",
         "in units of k/l₀", series, xlimits=(0.4, 2), ylimits=(-1.6, 1.6))


def solvers():
    """Iterations of conjugate gradients on lattices of growing size."""
    series = {"none": [], "block-jacobi": [], "multigrid": []}
    for size in (4, 6, 8, 12, 16, 24):
        file = builtin("lattice", size)
        for preconditioner, points in series.items():
            summary, _, _ = run(file, "--method", "linear-backward-euler", "--stiffness", "tension", "--dt", 0.05, "--steps", 2,
                                "--solver", "cg", "--tolerance", 1e-8, "--preconditioner", preconditioner,
                                "--no-error-estimate", "--allow-unstable")
            points.append((summary["dofs"], summary["work"]["cg_iterations"] / summary["work"]["solves"]))
    shapes = zip(series.items(), ["circle", "square", "triangle"])
    plot(CHAPTERS / "solvers.svg", "Iterations of conjugate gradients to 10⁻⁸: an elastic block, dt = 50 ms", "degrees of freedom",
         "iterations a solve", [(name, points, {"mark": shape}) for (name, points), shape in shapes], xlog=True, ylog=True,
         xlimits=(100, 60000), ylimits=(1, 300), yticks=[1, 3, 10, 30, 100, 300])


def newton():
    """The energy of a pendulum by methods that solve nonlinear equations."""
    file = builtin("pendulum", 1)
    series = []
    for method in ("backward-euler", "implicit-midpoint"):
        _, _, rows = run(file, "--method", method, "--dt", 0.02, "--duration", 4)
        series.append((method, [(row["time"], row["total"]) for row in rows], {}))
    _, _, rows = run(file, "--method", "dop853", "--rtol", 1e-8, "--dt", 0.02, "--duration", 4)
    series.append(("the true motion", [(row["time"], row["total"]) for row in rows], {"line": "dashed"} | GREY))
    plot(CHAPTERS / "newton.svg", "Energy of a swinging pendulum, steps of 20 ms", "time, s", "energy, J", series, xlimits=(0, 4))


def methods():
    """Error over the step of methods of several orders."""
    file = SCENES / "tetrahedron.toml"
    _, truth, _ = run(file, "--method", "dop853", "--rtol", 1e-13, "--dt", 2)
    series = []
    shapes = ["circle", "square", "triangle", "circle", "square", "triangle"]
    names = ["linear-backward-euler", "bdf2", "w2", "verlet", "rodas4", "dop853"]
    for (name, shape) in zip(names, shapes):
        points = []
        for halving in range(7):
            dt = 0.2 / 2**halving
            done = run(file, "--method", name, "--dt", dt, "--duration", 2, "--no-error-estimate", "--allow-unstable", fails=True)
            error = done and relative_error(done[1], truth)
            if error and 3e-13 < error < 1:
                points.append((dt, error))
        series.append((name, points, {"mark": shape}))
    plot(CHAPTERS / "methods.svg", "Error at 2 s over the step: a damped tetrahedron", "dt, s", "relative position error", series,
         xlog=True, ylog=True, xlimits=(0.0025, 0.25), ylimits=(1e-13, 1), xticks=[0.003, 0.01, 0.03, 0.1])


def energy_balance():
    """Where the energy of a driven, damped motion goes."""
    file = SCENES / "moving_anchor.toml"
    _, _, rows = run(file, "--method", "bdf2", "--dt", 0.02, "--duration", 2)
    start = rows[0]["total"]
    parts = {
        "energy gained": lambda row: row["total"] - start,
        "work of the anchors": lambda row: row["work"],
        "dissipated, with a minus": lambda row: -row["dissipated"],
        "imbalance": lambda row: row["imbalance"],
    }
    series = [(name, [(row["time"], of(row)) for row in rows], {}) for name, of in parts.items()]
    plot(CHAPTERS / "energy-balance.svg", "Energy balance of a pendulum with moving anchors, BDF2, steps of 20 ms", "time, s", "J", series, xlimits=(0, 2))


def accuracy():
    """What runs say of their own error, over the error that they have."""
    names = ["tetrahedron", "stiff_pendulum", "moving_anchor", "taut_string", "compressed_chain", "planar_truss"]
    series = []
    shapes = ["circle", "square", "triangle", "circle", "square"]
    truths = {name: run(SCENES / f"{name}.toml", "--method", "dop853", "--rtol", 1e-12)[1] for name in names}
    for method, shape in zip(["linear-backward-euler", "bdf2", "w2", "verlet", "rodas4"], shapes):
        points = []
        for name in names:
            for dt in (0.04, 0.02, 0.01, 0.005, 0.0025):
                done = run(SCENES / f"{name}.toml", "--method", method, "--dt", dt, fails=True)
                if done is None:
                    continue
                estimate, error = done[0]["error"]["estimate"], relative_error(done[1], truths[name])
                if error > 1e-9 and estimate > 1e-9:
                    points.append((error, estimate))
        series.append((method, points, {"line": None, "mark": shape}))
    line = [(1e-9, 1e-9), (10, 10)]
    series += [("equal", line, GREY)]
    series += [("ten times", [(x, f * y) for x, y in line], GREY | {"line": "dashed"}) for f in (10,)]
    series += [("", [(x, f * y) for x, y in line], GREY | {"line": "dashed"}) for f in (0.1,)]
    plot(CHAPTERS / "accuracy.svg", "Estimated error of runs over their true error: six scenes, five methods, steps of 2.5 to 40 ms",
         "true relative position error", "estimate", series, xlog=True, ylog=True, xlimits=(1e-9, 3), ylimits=(1e-9, 3))


def checks():
    """The V-curve, out of the report of `sprung verify`."""
    with tempfile.TemporaryDirectory() as folder:
        sprung("verify", SCENES / "tetrahedron.toml", "--quiet", "--out", folder)
        report = (Path(folder) / "report.html").read_text()
    pictures = re.findall(r'<svg role="img" aria-label="Error of K w against central differences.*?</svg>', report, re.S)
    picture = pictures[0] if "xmlns=" in pictures[0] else pictures[0].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    (CHAPTERS / "checks.svg").write_text(picture + "\n")


def stability():
    """The largest stable step under `axial`, by inspection and by its formula; and a cloth that linearised steps brake."""
    found = []
    for stretch in (1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2.0):
        file = scene(f"""
            particles = {{ positions = [[{-stretch}, 0], [0, 0], [{stretch}, 0]], masses = 1.0 }}
            springs = {{ pairs = [[0, 1], [1, 2]], stiffness = 50.0, rest_lengths = 1.0 }}
            [[constraints]]
            particles = [0, 2]
            """)
        dt = inspect(file, "--stiffness", "axial", "--dt", 0.01)["stable_dt"]
        found.append((stretch, 10 * dt))
    theory = [(s / 1000, 2 / math.sqrt(1 - 1000 / s)) for s in range(1030, 2001, 5)]
    plot(CHAPTERS / "stability.svg", "Largest stable step under axial: one mass between two stretched springs", "stretch l/l₀", "ω dt",
         [("2/√(1 − l₀/l)", theory, {}), ("found by sprung inspect", found, DOTS)], xlimits=(1, 2.02), ylimits=(0, 12))
    cloth = builtin("cloth", 10)
    series = []
    for name, words in {
        "linearised, full": ["linear-backward-euler", "--stiffness", "full"],
        "linearised, axial": ["linear-backward-euler", "--stiffness", "axial"],
        "bdf2": ["bdf2"],
    }.items():
        _, _, rows = run(cloth, "--duration", 0.5, "--dt", 0.005, "--method", *words, "--allow-unstable")
        series.append((name, [(row["time"], 1000 * row["gravitational"]) for row in rows], {}))
    _, _, rows = run(cloth, "--duration", 0.5, "--dt", 0.005, "--method", "dop853", "--rtol", 1e-6)
    series.append(("the true motion", [(row["time"], 1000 * row["gravitational"]) for row in rows], {"line": "dashed"} | GREY))
    plot(CHAPTERS / "stability-cloth.svg", "A cloth swings down, in steps of 5 ms", "time, s", "energy of the weight, mJ", series, xlimits=(0, 0.5))


def comparable(line):
    """A line without its spaces at the ends, and numbers to nine digits: the last ones are the machine's."""
    return re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda number: f"{float(number[0]):.9g}", line.strip())


def numbers():
    """Runs the commands of every chapter: the block that follows must be what they print, with … in place of lines that are left out."""
    wrong = 0
    for chapter in sorted(CHAPTERS.glob("*.md")):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("docs", "src"):
                (Path(folder) / name).symlink_to(ROOT / name)
            (Path(folder) / "bin").mkdir()
            (Path(folder) / "bin/sprung").symlink_to(SPRUNG)
            path = f"{folder}/bin:{os.environ['PATH']}"
            blocks = re.findall(r"```sh\n(.*?)```(?:\s*```text\n(.*?)```)?", chapter.read_text(), re.S)
            for commands, expected in blocks:
                done = subprocess.run(["bash", "-c", commands], cwd=folder, env=os.environ | {"PATH": path}, text=True,
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
                printed, wanted = ("\n".join(map(comparable, text.strip("\n").split("\n"))) for text in (done.stdout, expected))
                if wanted and not re.fullmatch(re.escape(wanted).replace("…", ".*"), printed, re.S):
                    wrong += 1
                    print(f"{chapter.name}: not printed: {expected}\n  by: {commands}  but: {done.stdout}")
            print(f"{chapter.name}: {len(blocks)} blocks of commands")
    raise SystemExit(f"{wrong} blocks are not what is printed" if wrong else 0)


PICTURES = [spring, matrices, step, definiteness, indefinite, solvers, newton, methods, energy_balance, accuracy, checks, stability]

if __name__ == "__main__":
    match sys.argv[1:]:
        case ["pictures", *names]:
            for picture in PICTURES:
                if not names or picture.__name__ in names:
                    picture()
                    print(picture.__name__)
        case ["numbers"]:
            numbers()
        case _:
            raise SystemExit(__doc__)
