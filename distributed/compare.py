"""compare.py SPRUNG SPRUNG_MPI [GROUP…]: holds sprung-mpi to sprung. Needs nothing but Python."""

import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path

SPRUNG, MPI = (str(Path(program).resolve()) for program in sys.argv[1:3])
# As root, on fewer cores than ranks, in a container, without asking the network.
os.environ.update({name: "1" for name in ("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "OMPI_MCA_mpi_yield_when_idle",
                                          "OMPI_MCA_rmaps_base_oversubscribe", "OMP_NUM_THREADS", "RAYON_NUM_THREADS")})
os.environ.update(OMPI_MCA_btl_vader_single_copy_mechanism="none", OMPI_MCA_btl="self,vader", OMPI_MCA_plm="isolated")
GROUPS = sys.argv[3:]
WORK = Path(tempfile.mkdtemp(prefix="sprung-mpi-"))
RANKS = [1, 2, 3, 4]
failures = []


def check(name, holds, what=""):
    if not holds:
        failures.append(name)
        print(f"FAILED  {name}: {what}", flush=True)


def one(*arguments, status=0):
    done = subprocess.run([SPRUNG, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == status, (arguments, done.returncode, done.stderr)
    return done


def launch(command, timeout, more):
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=timeout, cwd=WORK, **more)


def many(ranks, *arguments, status=0, timeout=120, **more):
    command = ["mpirun", "--bind-to", "none", "-n", str(ranks), MPI, *map(str, arguments)]
    done = launch(command, timeout, more)
    # Three of some thousand launches on a busy machine. A rank that ends tells `mpirun` and waits two seconds for the answer; where
    # `mpirun` gets no core for longer than that, it may call the end improper, of any program (see the guide). What really ends so does
    # it again.
    if status == 0 and "exiting improperly" in done.stderr and "completed after" in done.stdout and "error:" not in done.stderr:
        print(f"repeated, for mpirun took an end for an improper one: {arguments[:2]} on {ranks}", flush=True)
        done = launch(command, timeout, more)
    if status is not None:
        check(f"status of {arguments} on {ranks}", done.returncode == status, (done.returncode, done.stderr[-2000:]))
    return done


def final(folder):
    return json.loads((folder / "final.json").read_text())


def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def norm(rows):
    return math.sqrt(sum(value * value for row in rows for value in row))


def distance(a, b):
    return norm([[x - y for x, y in zip(row, other)] for row, other in zip(a, b)])


def scene(name, kind, size):
    path = WORK / f"{name}.json"
    path.write_text(one("new", kind, "--size", size, "--json").stdout)
    return path


def content_of(path):
    """What a scene's file says, with the particles and springs of its mesh."""
    content = json.loads(path.read_text()) if path.suffix == ".json" else tomllib.loads(path.read_text())
    mesh = content.pop("mesh", None)
    if mesh:
        lines = [line.split() for line in (path.parent / mesh["file"]).read_text().splitlines()]
        content["particles"]["positions"] = [[float(c) for c in words[1:4]] for words in lines if words[:1] == ["v"]]
        faces = [[int(word.split("/")[0]) - 1 for word in words[1:]] for words in lines if words[:1] == ["f"]]
        content["springs"]["pairs"] = sorted({tuple(sorted(edge)) for face in faces for edge in zip(face, face[1:] + face[:1])})
    return content


def changed(path, name, change):
    content = content_of(path)
    change(content)
    target = WORK / f"{name}.json"
    target.write_text(json.dumps(content))
    return target


def stir(content, most=0.02):
    """Positions and velocities that nothing is symmetric in, about the rest lengths of the scene as it was."""
    chance = random.Random(1)
    x = content["particles"]["positions"]
    pairs = content["springs"]["pairs"]
    content["springs"].setdefault("rest_lengths", [math.dist(x[i], x[j]) for i, j in pairs])
    step = min(math.dist(x[i], x[j]) for i, j in pairs)
    content["particles"]["positions"] = [[c + most * step * (2 * chance.random() - 1) for c in row] for row in x]
    content["particles"]["velocities"] = [[0.2 * (2 * chance.random() - 1) for _ in row] for row in x]
    for constraint in content.get("constraints", []):
        for p in constraint["particles"]:
            content["particles"]["velocities"][p] = [0.0 for _ in x[p]]


def disturbed(path, name):
    """The same scene with positions changed by 1e-10 of a spring: what becomes of that is what rounding can become."""
    def change(content):
        chance = random.Random(2)
        x = content["particles"]["positions"]
        pairs = content["springs"]["pairs"]
        content["springs"].setdefault("rest_lengths", [math.dist(x[i], x[j]) for i, j in pairs])
        step = min(math.dist(x[i], x[j]) for i, j in pairs)
        content["particles"]["positions"] = [[c + 1e-10 * step * (2 * chance.random() - 1) for c in r] for r in x]
    return changed(path, name, change)


def velocities(path, steps, dt, *options):
    folder = WORK / f"one-{path.stem}"
    one("run", path, "--dt", dt, "--steps", steps, "--allow-unstable", "--out", folder, *options)
    return final(folder)


def stirred_scenes():
    sizes = {"chain": 9, "cloth": 9, "lattice": 5, "column": 9, "pendulum": 2, "string": 15, "network": 60}
    for kind, size in sizes.items():
        path = scene(kind, kind, size)
        yield kind, changed(path, f"{kind}-stirred", stir)


def led(content):
    """Rollers, a velocity and a path with a kink in the third step, beside what is held."""
    stir(content)
    last = len(content["particles"]["positions"]) - 1
    content["constraints"] += [
        {"particles": [last], "velocity": [0.1, -0.2, 0.05]},
        {"particles": [last - 8], "path": {"times": [0.0, 0.025, 0.1], "offsets": [[0, 0, 0], [0.003, 0, 0.001], [0, 0.002, 0]]}},
        {"particles": [30, 40], "axes": ["y"]},
    ]


def one_dimensional():
    path = WORK / "line.json"
    content = {"name": "line", "gravity": [-9.81], "particles": {"positions": [[0.1 * p] for p in range(70)], "masses": 0.1},
               "springs": {"pairs": [[p, p + 1] for p in range(69)], "stiffness": 300.0, "damping": 0.1},
               "constraints": [{"particles": [0]}]}
    stir(content)
    path.write_text(json.dumps(content))
    return path


def repository_scenes():
    """Scenes with moving constraints and of a mesh, as they stand in the repository."""
    root = Path(__file__).resolve().parent.parent
    for path in ("src/verify/scenes/moving_anchor", "src/verify/scenes/planar_truss", "verification/scenes/bunny"):
        yield Path(path).name, root / f"{path}.toml"


def mesh_scene():
    """A mesh of a sphere: a thousand particles, springs along the edges of triangles."""
    rows, columns = 24, 40
    x = [[math.sin(math.pi * (i + 1) / (rows + 1)) * math.cos(2 * math.pi * j / columns),
          math.cos(math.pi * (i + 1) / (rows + 1)),
          math.sin(math.pi * (i + 1) / (rows + 1)) * math.sin(2 * math.pi * j / columns)]
         for i in range(rows) for j in range(columns)]
    number = lambda i, j: i * columns + j % columns
    pairs = [[number(i, j), number(i, j + 1)] for i in range(rows) for j in range(columns)]
    pairs += [[number(i, j), number(i + 1, j)] for i in range(rows - 1) for j in range(columns)]
    pairs += [[number(i, j), number(i + 1, j + 1)] for i in range(rows - 1) for j in range(columns)]
    content = {"name": "sphere", "gravity": [0, -9.81, 0], "particles": {"positions": x, "masses": 0.01},
               "springs": {"pairs": pairs, "stiffness": 50.0, "damping": 0.01}, "constraints": [{"particles": [0, 1, 2]}]}
    stir(content)
    path = WORK / "sphere.json"
    path.write_text(json.dumps(content))
    return path


def matrix_of(folder):
    lines = (folder / "A.mtx").read_text().splitlines()
    lines = [line for line in lines if not line.startswith("%")]
    return lines[0].split()[:2], {tuple(line.split()[:2]): float(line.split()[2]) for line in lines[1:]}


def matrices():
    cases = [(name, path, []) for name, path in stirred_scenes()]
    cloth = scene("cloth-led", "cloth", 9)
    cases += [("led", changed(cloth, "led", led), []), ("line", one_dimensional(), [])]
    cases += [(f"led-{option}", WORK / "led.json", ["--stiffness", option]) for option in ("tension", "axial")]
    for name, path, options in cases:
        folder = WORK / f"matrix-{name}"
        one("matrix", path, "--dt", 0.01, "--out", folder, *(options or ["--stiffness", "full"]))
        order, expected = matrix_of(folder)
        size = max(map(abs, expected.values()))
        for ranks in RANKS:
            preconditioner = "icc" if ranks == 3 else "gamg"
            there = WORK / f"matrix-{name}-{ranks}"
            many(ranks, "matrix", path, "--dt", 0.01, "--out", there, "--preconditioner", preconditioner,
                 *(options or ["--stiffness", "full"]))
            found_order, found = matrix_of(there)
            # Zeros beside the diagonal may be stored in one and not in the other.
            worst = max(abs(found.get(at, 0.0) - expected.get(at, 0.0)) for at in expected.keys() | found.keys())
            check(f"matrix of {name} on {ranks}", order == found_order and worst <= 1e-14 * size, (order, found_order, worst / size))


def compare_runs(name, path, steps, dt, options, same, bound=None, ranks=RANKS, only_here=()):
    reference = velocities(path, steps, dt, *options, *same)
    if bound is None:
        other = velocities(disturbed(path, f"{path.stem}-disturbed"), steps, dt, *options, *same)
        # A disturbance of 1e-10 of a spring stands for errors of solves of 1e-10; ten times what becomes of it is allowed.
        bound = 10 * distance(other["positions"], reference["positions"]) / norm(reference["positions"]) + 1e-12
    for count in ranks:
        folder = WORK / f"many-{path.stem}"
        done = many(count, "run", path, "--dt", dt, "--steps", steps, "--allow-unstable", "--out", folder, *options, *only_here)
        if done.returncode != 0:
            continue
        found = final(folder)
        # After one step of backward Euler velocities are δx/dt.
        what = "velocities" if steps == 1 else "positions"
        wrong = distance(found[what], reference[what]) / norm(reference[what])
        check(f"{name} on {count}: {steps} steps", wrong <= bound, f"{wrong:.2e} > {bound:.2e}")
        energies = [summary(there)["energy"]["final"] for there in (folder, WORK / f"one-{path.stem}")]
        scale = max(abs(summary(folder)["energy"]["initial"]), abs(energies[0]), 1e-9)
        check(f"energy of {name} on {count}", abs(energies[0] - energies[1]) <= max(1e-6, 1e3 * bound) * scale, energies)


LLT = ["--solver", "llt"]


def steps():
    """δx of one step, to 1e-8, of every ready scene and kind of constraint."""
    cases = [(name, path) for name, path in stirred_scenes()]
    cases += [("led", changed(scene("cloth-led", "cloth", 9), "led", led)), ("line", one_dimensional()), ("sphere", mesh_scene()),
              *repository_scenes()]
    for name, path in cases:
        for option in ["tension", "axial", "full"] if name in ("led", "cloth") else ["tension"]:
            # The full stiffness is positive definite with short steps alone.
            dt = 0.0005 if option == "full" else 0.004
            compare_runs(f"{name} {option}", path, 1, dt, ["--stiffness", option], LLT, 1e-8)
    for preconditioner in ("icc", "hypre", "block-jacobi"):
        path = WORK / "cloth-stirred.json"
        there = ["--stiffness", "tension"]
        reference = velocities(path, 1, 0.004, *there, *LLT)
        folder = WORK / "other"
        many(2, "run", path, "--dt", 0.004, "--steps", 1, "--out", folder, "--preconditioner", preconditioner, *there)
        wrong = distance(final(folder)["velocities"], reference["velocities"]) / norm(reference["velocities"])
        check(f"{preconditioner} on 2", wrong <= 1e-8, wrong)


def runs():
    """Twenty steps, by every method, in what a disturbance grows to."""
    for name, path in [*stirred_scenes(), ("led", changed(scene("cloth-led", "cloth", 9), "led", led)), ("line", one_dimensional()),
                       *repository_scenes()]:
        compare_runs(name, path, 20, 0.004, ["--stiffness", "tension"], LLT)
    for name in ("cloth-stirred", "led", "lattice-stirred"):
        # Iterations of bdf2 end at 1e-6 of what they correct, wherever they are done: a factorization is compared with another.
        compare_runs(f"{name} bdf2", WORK / f"{name}.json", 20, 0.004, ["--method", "bdf2"], LLT, only_here=["--solver", "mumps"])
        compare_runs(f"{name} verlet", WORK / f"{name}.json", 20, 0.0002, ["--method", "verlet"], [])


def outcomes():
    """What ends or changes a solve, in the same words as on one machine."""
    # MUMPS proves indefiniteness as the one-machine Cholesky factorization does, and drops the same terms.
    path = changed(scene("column", "column", 30), "column-stirred", lambda content: stir(content, 1e-3))
    for ranks in (1, 3):
        folder, there = WORK / "demand", WORK / "one-demand"
        one("run", path, "--dt", 0.02, "--steps", 8, "--allow-unstable", "--out", there, *LLT)
        many(ranks, "run", path, "--dt", 0.02, "--steps", 8, "--allow-unstable", "--out", folder, "--solver", "mumps")
        a, b = summary(there), summary(folder)
        check(f"on-demand on {ranks}", a["softened_solves"] == b["softened_solves"] > 0 and a["dropped_terms"] == b["dropped_terms"],
              [(s["softened_solves"], s["dropped_terms"]) for s in (a, b)])
        wrong = distance(final(there)["positions"], final(folder)["positions"]) / norm(final(there)["positions"])
        check(f"on-demand positions on {ranks}", wrong <= 1e-6, wrong)
    # A compressed column with the full stiffness: negative curvature is met and named.
    done = many(2, "run", path, "--dt", 0.05, "--steps", 3, "--stiffness", "full", "--out", WORK / "curved", status=1)
    check("negative curvature", summary(WORK / "curved")["status"] == "indefinite", done.stderr[-500:])
    # One that cannot iterate says that it was not solved.
    changed(scene("cloth", "cloth", 9), "cloth-stirred", stir)
    done = many(2, "run", WORK / "cloth-stirred.json", "--dt", 0.01, "--steps", 2, "--stiffness", "tension", "--preconditioner",
                "block-jacobi", "--tolerance", "1e-30", "--out", WORK / "stuck", status=1)
    check("not converged", summary(WORK / "stuck")["status"] == "not-converged", done.stderr[-500:])


def splits():
    """Scenes from files and formulas, of which every rank takes its share, are those of one file."""
    for kind, size in (("cloth", 9), ("lattice", 5)):
        whole = WORK / "whole"
        many(1, "split", scene(kind, kind, size), "--out", whole)
        for ranks in (1, 3):
            made = WORK / f"made-{kind}-{ranks}"
            many(ranks, "split", "--ready", kind, "--size", size, "--out", made)
            for name in ("particles.bin", "springs.bin", "leads.bin"):
                check(f"{name} of {kind} on {ranks}", (whole / name).read_bytes() == (made / name).read_bytes())
    path = changed(scene("cloth-led", "cloth", 9), "led", led)
    many(2, "split", path, "--out", WORK / "led.split")
    reference = velocities(path, 3, 0.01, "--stiffness", "tension", *LLT)
    many(3, "run", WORK / "led.split", "--dt", 0.01, "--steps", 3, "--stiffness", "tension", "--out", WORK / "from-split")
    wrong = distance(final(WORK / "from-split")["positions"], reference["positions"]) / norm(reference["positions"])
    check("a split scene", wrong <= 1e-8, wrong)


def blocked(folder, step):
    """Where rank 1 cannot write its piece of a frame."""
    piece = folder / "frames" / f"frame_{step:06}_0001.vtp"
    piece.unlink(missing_ok=True)
    piece.mkdir(parents=True)


def resume():
    """A run that was killed goes on, on another number of ranks, to the end of one that was not."""
    path = changed(scene("cloth-led", "cloth", 9), "led", led)
    arguments = ["run", path, "--dt", 0.01, "--stiffness", "tension", "--checkpoint", 3, "--frames", 2, "--steps", 11]
    whole, parted = WORK / "unbroken", WORK / "broken"
    many(2, *arguments, "--out", whole)
    blocked(parted, 8)
    many(3, *arguments, "--out", parted, status=None)
    (parted / "frames" / "frame_000008_0001.vtp").rmdir()
    check("a checkpoint is left", (parted / "checkpoint-mpi.json").exists())
    check("nothing else is finished", not (parted / "final.json").exists())
    many(2, *arguments, "--resume", "--out", parted)
    a, b = final(whole), final(parted)
    wrong = distance(a["positions"], b["positions"]) / norm(a["positions"])
    check("resumed positions", a["steps"] == b["steps"] == 11 and wrong <= 1e-8, wrong)
    lines = [(there / "energy.csv").read_text().splitlines() for there in (whole, parted)]
    check("resumed energies", len(lines[0]) == len(lines[1]) == 13, [len(text) for text in lines])
    last = [list(map(float, text[-1].split(","))) for text in lines]
    check("resumed account", all(abs(x - y) <= 1e-6 * (abs(x) + 1e-3) for x, y in zip(*last)), last)
    check("frames", len(list((parted / "frames").glob("*.pvtp"))) == 6)
    check("no checkpoint is left", not list(parted.glob("checkpoint-mpi*")))
    listed = (whole / "frames.pvd").read_text().count("DataSet")
    pieces = (whole / "frames" / "frame_000010.pvtp").read_text().count("<Piece")
    check("frames are listed with their pieces", listed == 6 and pieces == 2, (listed, pieces))
    lines = sum(int(piece.read_text().split('NumberOfLines="')[1].split('"')[0])
                for piece in (whole / "frames").glob("frame_000010_*.vtp"))
    check("every spring is in one piece", lines == len(json.loads(path.read_text())["springs"]["pairs"]), lines)
    # A damaged state is not gone on with.
    blocked(parted, 8)
    many(2, *arguments, "--out", parted, status=None)
    (parted / "frames" / "frame_000008_0001.vtp").rmdir()
    for state in parted.glob("checkpoint-mpi-*.state"):
        state.write_bytes(b"\x01" + state.read_bytes()[1:])
    done = many(2, *arguments, "--resume", "--out", parted, status=2)
    check("damaged", "is damaged" in done.stderr, done.stderr)


def process_of_rank(rank, argument):
    for entry in Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
            variables = (entry / "environ").read_bytes().split(b"\0")
        except (OSError, NotADirectoryError):
            continue
        if argument.encode() in words and f"OMPI_COMM_WORLD_RANK={rank}".encode() in variables:
            return int(entry.name)
    return None


def iterations():
    """Over 60 steps of 1/60 s iterations stay within 1.5 times the fewest; the cloth's first step, from rest in a plane, needs one."""
    for kind, size in (("cloth", 40), ("lattice", 10)):
        for ranks in (1, 2):
            done = many(ranks, "run", "--ready", kind, "--size", size, "--dt", 1 / 60, "--steps", 60, "--stiffness", "tension",
                        "--out", WORK / "flat", "--petsc", "-ksp_converged_reason")
            counts = [int(line.rsplit(" ", 1)[1]) for line in done.stdout.splitlines() if " iterations " in line and "onverge" in line]
            # Behind the solve of every step stands that of its error estimate.
            counts, estimates = counts[::2], counts[1::2]
            check(f"iterations of {kind} on {ranks}", len(counts) == 60 and max(counts[1:]) <= 1.5 * min(counts[1:]), counts)
            check(f"iterations of estimates of {kind} on {ranks}", len(estimates) == 60 and max(estimates) <= 10, estimates)


def waiting():
    """Ranks that wait for another one sleep: those that poll have used up their share of a busy machine when they could go on."""
    there = WORK / "waiting"
    command = ["mpirun", "--bind-to", "none", "-n", "3", MPI, "run", "--ready", "cloth", "--size", "9", "--dt", "0.001", "--steps",
               "10000000", "--stiffness", "tension", "--quiet", "--checkpoint", "5", "--out", str(there)]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
    def sleeps(process):
        """How often its main thread has given up its core to wait; giving it up by `sched_yield` is not counted."""
        return int(Path(f"/proc/{process}/status").read_text().split("\nvoluntary_ctxt_switches:")[1].split()[0])
    try:
        for _ in range(600):
            time.sleep(0.1)
            if (there / "checkpoint-mpi.json").exists():
                break
        ranks = [process_of_rank(rank, str(there)) for rank in range(3)]
        check("three ranks are found", all(ranks), ranks)
        os.kill(ranks[1], signal.SIGSTOP)
        time.sleep(1)
        for rank in (0, 2):
            # They wait for rank 1 alone. Who polls does not sleep once.
            begin, enough = sleeps(ranks[rank]), False
            for _ in range(200):
                time.sleep(0.1)
                enough = sleeps(ranks[rank]) >= begin + 100
                if enough:
                    break
            check(f"rank {rank} sleeps while it waits", enough, sleeps(ranks[rank]) - begin)
        os.kill(ranks[1], signal.SIGCONT)
    finally:
        running.terminate()
        running.wait(timeout=60)


def faults():
    """What happens to one rank ends all of them, soon, and is named."""
    path = WORK / "cloth-stirred.json"
    if not path.exists():
        changed(scene("cloth", "cloth", 9), "cloth-stirred", stir)
    arguments = ["run", path, "--dt", 0.001, "--stiffness", "tension"]
    # An error of one rank.
    begin = time.monotonic()
    blocked(WORK / "fault", 3)
    done = many(3, *arguments, "--steps", 100000, "--frames", 1, "--out", WORK / "fault", status=1)
    check("an error ends all", time.monotonic() - begin < 60)
    check("an error is named", "rank 1: " in done.stderr and "frame_000003_0001.vtp" in done.stderr, done.stderr[-1000:])
    # The end of one process.
    command = ["mpirun", "--bind-to", "none", "-n", "3", MPI, *map(str, arguments), "--steps", "10000000", "--out", str(WORK / "killed")]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, text=True)
    victim = None
    for _ in range(200):
        time.sleep(0.1)
        victim = victim or process_of_rank(1, str(WORK / "killed"))
        if victim and (WORK / "killed").exists():
            break
    time.sleep(1)
    os.kill(victim, signal.SIGABRT)
    begin = time.monotonic()
    text, _ = running.communicate(timeout=60)
    check("a killed rank ends all", running.returncode not in (0, 2) and time.monotonic() - begin < 30, running.returncode)
    check("a killed rank is named", "rank 1" in text and "Abort" in text, text[-1000:])
    done = many(2, "run", WORK / "missing.json", "--dt", 0.01, "--steps", 1, status=2)
    check("a missing file is named", "missing.json" in done.stderr and done.stderr.count("error:") == 1, done.stderr)
    bad = changed(path, "bad", lambda content: content["particles"].update(masses=-1.0))
    done = many(2, "run", bad, "--dt", 0.01, "--steps", 1, status=2)
    check("a bad value is named", "particles.masses" in done.stderr, done.stderr)
    many(2, "run", path, "--dt", "0", "--steps", 1, status=2)
    # One file of a split scene is missing, one too short.
    many(1, "split", path, "--out", WORK / "holes")
    springs = WORK / "holes" / "springs.bin"
    springs.write_bytes(springs.read_bytes()[:-8])
    done = many(3, "run", WORK / "holes", "--dt", 0.01, "--steps", 1, status=2)
    check("a short file is named", "springs.bin" in done.stderr, done.stderr)
    springs.unlink()
    done = many(3, "run", WORK / "holes", "--dt", 0.01, "--steps", 1, status=2)
    check("a missing share is named", "springs.bin" in done.stderr, done.stderr)
    # More rows than 32 bits can number, of which nothing is made or read before it is said.
    if "petsc64" not in subprocess.run(["ldd", MPI], capture_output=True, text=True).stdout:
        done = many(2, "run", "--ready", "cloth", "--size", 30000, "--dt", 0.01, "--steps", 1, status=2)
        check("too many rows are named", "2700000000 rows" in done.stderr and "64-bit" in done.stderr, done.stderr)
        many(1, "split", path, "--out", WORK / "vast")
        content = json.loads((WORK / "vast" / "scene.json").read_text())
        content["scene"]["particles"] = 10**9
        (WORK / "vast" / "scene.json").write_text(json.dumps(content))
        done = many(2, "run", WORK / "vast", "--dt", 0.01, "--steps", 1, status=2)
        check("a vast scene is named", "scene.json" in done.stderr and "64-bit" in done.stderr, done.stderr)
    full = WORK / "full"
    full.mkdir()
    if os.getuid() == 0 and subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", full], capture_output=True).returncode == 0:
        try:
            done = many(2, *arguments, "--steps", 5000, "--frames", 1, "--out", full / "out", status=None)
            check("a full disk", done.returncode == 1, done.returncode)
            check("a full disk is named", "rank" in done.stderr and "No space left" in done.stderr, done.stderr[-1000:])
        finally:
            subprocess.run(["umount", full])
    else:
        # A limit on the size of files stands for a full disk where none can be made.
        limited = f"ulimit -f 40; trap '' XFSZ; exec mpirun --bind-to none -n 2 {MPI} " + " ".join(map(str, arguments)) \
            + f" --steps 5000 --frames 1 --out {full / 'out'}"
        done = subprocess.run(["bash", "-c", limited], capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=120)
        check("files that may not grow", done.returncode == 1 and "rank" in done.stderr, (done.returncode, done.stderr[-1000:]))


ALL = {"matrices": matrices, "steps": steps, "runs": runs, "outcomes": outcomes, "splits": splits, "iterations": iterations,
       "waiting": waiting, "resume": resume, "faults": faults}
for name, group in ALL.items():
    if not GROUPS or name in GROUPS:
        begin = time.monotonic()
        if name == "runs":
            list(stirred_scenes())
        group()
        print(f"{name}: {time.monotonic() - begin:.0f} s", flush=True)
shutil.rmtree(WORK)
if failures:
    print(f"{len(failures)} checks failed")
    sys.exit(1)
print("sprung-mpi agrees with sprung")
