#!/usr/bin/env python3
"""Normal modes beside those of scipy, SLEPc and ProDy: elastic networks of proteins, planted scenes, and scenes of a million degrees of freedom.

    benches/peers/modes.py proteins FOLDER [NAME ...]
    benches/peers/modes.py planted
    benches/peers/modes.py large [NAME ...]

Needs the command sprung (`cargo build --release`; another than that in target/release by SPRUNG=FILE) and numpy, scipy, prody and the Python
package of this repository; SLEPC_PYTHON may name a Python with slepc4py and scipy. FOLDER holds pdb1ubi.pdb, mmcif_3o21.cif and pdb4v8r_h36.pdb, which are among the data of ProDy's
own tests (in its source distribution, prody/tests/datafiles). Results go to docs/performance/modes.json, and tables made of them to
docs/performance/modes.md.

Every run is a process of its own that begins with coordinates (of the command: with the scene as NumPy arrays) and ends with 20 modes.
Times are those of the whole process. A run may take 180 s of processor time and 12 GB; with the largest network 90 s, where that is five
times as long as another needs. Medians of three runs
(of as many as REPEATS says); what takes more than 5 s of processor time runs once.
"""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE, DATA = ROOT / "docs/performance/modes.md", ROOT / "docs/performance/modes.json"
SPRUNG = os.environ.get("SPRUNG", str(ROOT / "target/release/sprung"))
PROTEINS = {"1UBI": "pdb1ubi.pdb", "3O21": "mmcif_3o21.cif", "4V8R": "pdb4v8r_h36.pdb"}
COUNT, LIMIT, MEMORY, REPEATS = 20, 180, 12 << 30, int(os.environ.get("REPEATS", "3"))
# Where the results begin on the page; the text above is written by hand and stays.
MARK = "## Results\n"
PEERS = {
    "command": "`sprung modes`",
    "python": "`sprung.modes`",
    "zero": "scipy `eigsh`, `sigma=0`",
    "negative": "scipy `eigsh`, `sigma=-0.01`",
    "slepc": "SLEPc, shift-invert at -0.01 with MUMPS",
    "smallest": "scipy `eigsh`, `which='SA'`",
    "prody": "ProDy, dense",
    "prody-sparse": "ProDy, sparse",
}


# The processes. Only they import numpy: the peak of memory that the system reports for a process is no less than that of its parent.


def example():
    import runpy
    import types

    # The Python of SLEPc need not have this package: the matrix of the model is made without.
    try:
        import sprung  # noqa: F401
    except ImportError:
        sys.modules["sprung"] = types.ModuleType("sprung")
    return runpy.run_path(str(ROOT / "python/examples/elastic_network.py"))


def prepare(source, coordinates, scene):
    import numpy as np

    network = example()
    x, _ = network["carbons"](Path(source).read_text())
    system = network["network"](x)
    np.save(coordinates, x)
    system.save(scene)
    print(json.dumps({"residues": len(x), "springs": len(system.pairs)}))


def truth(coordinates):
    """All eigenvalues, densely."""
    import numpy as np

    network, x = example(), np.load(coordinates)
    values = np.linalg.eigvalsh(network["hessian"](x, network["network"](x).pairs).toarray())
    print(json.dumps({"values": values[: COUNT + 6].tolist(), "zeros": int((values < 1e-10 * values[-1]).sum())}))


def peer(name, coordinates):
    """The eigenvalues that a peer finds, zeros among them."""
    import numpy as np

    x = np.load(coordinates)
    if name == "python":
        import sprung

        found = sprung.modes(example()["network"](x), COUNT)
        values = np.concatenate([np.zeros(found.zero_modes), found.eigenvalues])
        print(json.dumps({"values": values.tolist(), "complete": found.complete}))
        return
    if name == "slepc":
        values = slepc(x)
    elif name.startswith("prody"):
        import prody

        prody.confProDy(verbosity="none")
        model = prody.ANM()
        model.buildHessian(x, cutoff=15.0, sparse=name == "prody-sparse")
        model.calcModes(COUNT, zeros=False)
        values = np.concatenate([np.zeros(6), model.getEigvals()])
    else:
        from scipy.sparse.linalg import eigsh
        from scipy.spatial import cKDTree

        hessian = example()["hessian"](x, cKDTree(x).query_pairs(15.0, output_type="ndarray")).tocsc()
        how = {"zero": {"sigma": 0}, "negative": {"sigma": -0.01}, "smallest": {"which": "SA"}}[name]
        values, vectors = eigsh(hessian, k=COUNT + 6, **how)
        values = np.sort(values)
    print(json.dumps({"values": values.tolist()}))


def slepc(x):
    import numpy as np
    import slepc4py
    from scipy.spatial import cKDTree

    slepc4py.init([])
    from petsc4py import PETSc
    from slepc4py import SLEPc

    hessian = example()["hessian"](x, cKDTree(x).query_pairs(15.0, output_type="ndarray")).tocsr()
    matrix = PETSc.Mat().createAIJ(hessian.shape, csr=(hessian.indptr, hessian.indices, hessian.data))
    solver = SLEPc.EPS().create()
    solver.setOperators(matrix)
    solver.setProblemType(SLEPc.EPS.ProblemType.HEP)
    solver.setDimensions(COUNT + 6)
    solver.setTarget(-0.01)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    transform = solver.getST()
    transform.setType(SLEPc.ST.Type.SINVERT)
    transform.getKSP().setType(PETSc.KSP.Type.PREONLY)
    transform.getKSP().getPC().setType(PETSc.PC.Type.CHOLESKY)
    transform.getKSP().getPC().setFactorSolverType("mumps")
    solver.solve()
    values = [solver.getEigenvalue(k).real for k in range(min(solver.getConverged(), COUNT + 6))]
    return np.sort(values)


# Measuring.


def run(arguments, threads, limit=LIMIT, memory=MEMORY):
    """Output, wall time, processor time and peak of memory of a process."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}

    def bounds():
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as errors:
        start = time.monotonic()
        child = subprocess.Popen(arguments, stdout=out, stderr=errors, env=environment, preexec_fn=bounds)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        wall = time.monotonic() - start
        out.seek(0)
        errors.seek(0)
        text, complaint = out.read(), errors.read().strip().splitlines()[-1:]
    measured = {"wall": wall, "cpu": usage.ru_utime + usage.ru_stime, "memory": usage.ru_maxrss * 1024}
    if child.returncode:
        measured["failed"] = "time" if child.returncode in (-signal.SIGKILL, -signal.SIGXCPU) else "".join(complaint) or f"status {child.returncode}"
    return text, measured


def own(*arguments):
    python = os.environ["SLEPC_PYTHON"] if "slepc" in arguments else sys.executable
    return [python, __file__, *map(str, arguments)]


def middle(runs):
    """The run of the median processor time, with the median wall time."""
    runs = sorted(runs, key=lambda run: run["cpu"])
    walls = sorted(run["wall"] for run in runs)
    return {**runs[len(runs) // 2], "wall": walls[len(walls) // 2]}


def proteins(folder, *names):
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in names or PROTEINS:
            source = PROTEINS[name]
            coordinates, scene = f"{scratch}/{name}.npy", f"{scratch}/{name}.npz"
            size = json.loads(run(own("prepare", Path(folder) / source, coordinates, scene), 2)[0])
            exact = json.loads(run(own("truth", coordinates), 2)[0]) if size["residues"] < 5000 else None
            rows = []
            is_long = size["residues"] > 5000
            # What fails by the limits comes early, and the two of this library next to each other.
            for which in [*list(PEERS)[3:], "zero", "python", "command"]:
                if which == "slepc" and "SLEPC_PYTHON" not in os.environ:
                    continue
                for threads in (2, 1):
                    # Once each: what takes minutes has one thread, and a shift of zero takes as long as another.
                    if is_long and which not in ("command", "python") and (threads == 2 or which == "zero"):
                        continue
                    limit = 90 if is_long and which in ("smallest", "prody-sparse") else LIMIT
                    if rows and rows[-1]["peer"] == which and rows[-1].get("failed"):
                        continue
                    measured = []
                    while len(measured) < REPEATS and not (measured and (is_long or measured[0]["cpu"] > 5 or measured[0].get("failed"))):
                        if which == "command":
                            out = f"{scratch}/out"
                            arguments = [SPRUNG, "modes", scene, "-n", COUNT, "--json", "--threads", threads, "--out", out]
                            text, figures = run([str(a) for a in arguments], threads)
                            if not figures.get("failed"):
                                found = json.loads(text)
                                figures["values"] = [0.0] * found["zero_modes"] + found["eigenvalues"]
                                figures["complete"] = found["complete"]
                        else:
                            text, figures = run(own("peer", which, coordinates), threads, limit)
                            if not figures.get("failed"):
                                figures |= json.loads(text)
                        measured.append(figures)
                    rows.append({"peer": which, "threads": threads, "limit": limit, **middle(measured)})
                    print(name, which, threads, {k: v for k, v in rows[-1].items() if k != "values"}, flush=True)
            if exact is None:
                exact = {"values": next(row["values"] for row in rows if row.get("complete")), "zeros": 6, "counted": True}
            rows.sort(key=lambda row: list(PEERS).index(row["peer"]))
            results.append({"name": name, **size, "exact": exact, "rows": rows, "load": os.getloadavg()[1]})
    return {"date": str(date.today()), "scenes": results}


LARGE = {"cloth in a frame, 577²": ("framed", "cloth", 577), "free lattice, 69³": ("release", "lattice", 69)}


def large(*names):
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in names or LARGE:
            change, kind, size = LARGE[name]
            scene = f"{scratch}/{kind}.npz"
            subprocess.run([SPRUNG, "new", kind, "--size", str(size), "-q", "-o", scene], check=True)
            subprocess.run(own(change, scene), check=True)
            state = ["--at", "equilibrium"] if kind == "cloth" else []
            arguments = [SPRUNG, "modes", scene, "-n", "5", "--json", *state, "--out", f"{scratch}/out"]
            text, figures = run(arguments, 2, limit=1800, memory=20 << 30)
            if not figures.get("failed"):
                found = json.loads(text)
                figures |= {key: found[key] for key in ("zero_modes", "rigid_motions", "eigenvalues", "residuals", "complete")}
            results.append({"name": name, **figures})
            print(results[-1], flush=True)
    return {"date": str(date.today()), "scenes": results}


def framed(scene):
    """The cloth held along its edge, with rest lengths 2 % shorter: it sags under its weight."""
    import numpy as np
    import sprung

    cloth = sprung.System.load(scene)
    start, side = cloth.initial_state(), round(len(cloth.masses) ** 0.5)
    row, column = np.divmod(np.arange(side**2), side)
    edge = np.flatnonzero((row % (side - 1) == 0) | (column % (side - 1) == 0))
    springs = {"stiffness": cloth.stiffness, "rest_lengths": 0.98 * cloth.rest_lengths, "damping": cloth.damping}
    frame = [sprung.Constraint(edge.tolist())]
    sprung.System(start.positions, cloth.pairs, masses=cloth.masses, gravity=cloth.gravity, constraints=frame, name="cloth in a frame", **springs).save(scene)


def release(scene):
    """The scene without what holds it, and without gravity."""
    import sprung

    held = sprung.System.load(scene)
    start = held.initial_state()
    springs = {"stiffness": held.stiffness, "rest_lengths": held.rest_lengths, "damping": held.damping}
    sprung.System(start.positions, held.pairs, masses=held.masses, gravity=[0, 0, 0], name="free lattice", **springs).save(scene)


# Planted scenes.


def body(rng, particles):
    """A random network in which everything within reach is joined: positions, pairs, masses and k/l0."""
    import numpy as np
    from scipy.spatial import cKDTree

    x = rng.uniform(size=(particles, 3))
    reach = np.sort(cKDTree(x).query(x, k=min(7, particles))[0][:, -1])[-1]
    pairs = cKDTree(x).query_pairs(reach, output_type="ndarray")
    return x, pairs, rng.uniform(1, 3, particles), rng.uniform(50, 200, len(pairs))


def planted_scene(kind, seed):
    import numpy as np
    import sprung

    rng = np.random.default_rng(seed)

    def system(x, pairs, masses, kappa, rest=None, hold=()):
        lengths = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
        rest = lengths if rest is None else rest * lengths
        held = [sprung.Constraint(list(hold))] if len(hold) else []
        return sprung.System(x, pairs, masses=masses, stiffness=kappa * rest, rest_lengths=rest, constraints=held)

    def copies(number, factors):
        x, pairs, masses, kappa = body(rng, 30)
        shift = np.zeros((number, 1, 3))
        shift[:, 0, 0] = 3.0 * np.arange(number)
        all_pairs = np.concatenate([pairs + k * len(x) for k in range(number)])
        return (x + shift).reshape(-1, 3), all_pairs, np.tile(masses, number), np.concatenate([kappa * f for f in factors])

    if kind == "free bodies":
        return system(*body(rng, int(rng.integers(100, 300))))
    if kind == "3 copies":
        return system(*copies(3, np.ones(3)))
    if kind == "12 copies":
        scene = copies(12, np.ones(12))
        return system(*scene, hold=[30 * k + p for k in range(12) for p in range(3)])
    if kind == "clusters of 1e-9":
        scene = copies(6, 1 + 1e-9 * np.arange(6))
        return system(*scene, hold=[30 * k + p for k in range(6) for p in range(3)])
    if kind == "rings":
        size = int(rng.integers(40, 120))
        angle = 2 * np.pi * np.arange(size) / size
        x = np.concatenate([np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(size, z)]) for r, z in ((5, 0), (4, 1), (5, 2))])
        ring, after = np.arange(size), (np.arange(size) + 1) % size
        pairs = [(a * size + p, b * size + q) for a in range(3) for b in range(3) for p, q in ((ring, ring), (ring, after)) if (a, b) < (b, a) or p is not q]
        pairs = np.concatenate([np.column_stack(np.broadcast_arrays(p, q)) for p, q in pairs])
        return system(x, pairs[pairs[:, 0] != pairs[:, 1]], 2.0, 100.0)
    size = int(rng.integers(100, 300))
    if kind == "taut chains":
        x = np.column_stack([np.arange(size), np.zeros(size), np.zeros(size)]).astype(float)
        pairs = np.column_stack([np.arange(size - 1), np.arange(1, size)])
        return system(x, pairs, 1.0, 100.0, rest=rng.uniform(0.5, 0.9), hold=[0, size - 1])
    x, pairs, masses, kappa = body(rng, size)
    return system(x, pairs, masses, kappa, rest=rng.uniform(0.8, 1.25, len(pairs)))


KINDS = ["free bodies", "3 copies", "12 copies", "clusters of 1e-9", "rings", "taut chains", "indefinite"]
ASKED = {"zero": {"sigma": 0}, "negative": {"sigma": None}, "small": {"which": "SM"}, "smallest": {"which": "SA"}}
ASKED_NAMES = {
    "sprung": "`sprung.modes`",
    "zero": "`eigsh`, `sigma=0`",
    "negative": "`eigsh`, `sigma=-1e-4 ‖M⁻¹K‖`",
    "small": "`eigsh`, `which='SM'`",
    "smallest": "`eigsh`, `which='SA'`",
}


def unmatched(wanted, candidates, tolerance):
    """How many of the wanted values have no counterpart of their own, by ascending pairs within a tolerance."""
    left, place = 0, 0
    for value in sorted(wanted):
        while place < len(candidates) and candidates[place] < value - tolerance(value):
            place += 1
        if place < len(candidates) and candidates[place] <= value + tolerance(value):
            place += 1
        else:
            left += 1
    return left


def planted():
    """Sixty scenes, with dense eigenvalues as the truth."""
    import warnings

    import numpy as np
    import scipy.linalg
    import scipy.sparse as sparse
    import sprung
    from scipy.sparse.linalg import eigsh

    warnings.simplefilter("ignore")
    table = {who: {kind: {"missed": 0, "invented": 0, "failed": 0} for kind in KINDS} for who in ASKED_NAMES}
    counts, worst, complete = dict.fromkeys(KINDS, 0), 0.0, 0
    for seed in range(60):
        kind = KINDS[seed % len(KINDS)]
        system = planted_scene(kind, seed)
        matrices = system.matrices(dt=1.0)
        stiffness, masses = -matrices.K.tocsc(), np.asarray(matrices.M.diagonal())
        exact = scipy.linalg.eigh(stiffness.toarray(), np.diag(masses), eigvals_only=True)
        norm = abs(exact).max()
        zeros = int((abs(exact) < 1e-11 * norm).sum())
        number = min(COUNT + zeros, len(exact) - 1)
        counts[kind] += 1

        def tolerance(value):
            return 1e-7 * abs(value) + 1e-9 * norm

        def judge(who, values, ranks):
            # Any of the values that tie with the last one asked for may be missing.
            order = np.argsort(ranks, kind="stable")
            last = ranks[order[min(len(values), number) - 1]] if len(values) else np.inf
            asked = [exact[k] for k in order[:number] if ranks[k] < last - tolerance(last)]
            cell = table[who][kind]
            cell["missed"] += unmatched(asked, np.sort(values), tolerance)
            cell["invented"] += unmatched(values, exact, tolerance)

        found = sprung.modes(system, number - zeros)
        values = np.sort(np.concatenate([np.zeros(found.zero_modes), found.eigenvalues]))
        complete += found.complete
        judge("sprung", values, exact)
        if len(values) == number:
            worst = max(worst, float((abs(values - exact[:number]) / (abs(exact[:number]) + 1e-4 * norm)).max()))
        for who, how in ASKED.items():
            shift = -1e-4 * norm if who == "negative" else 0.0
            how = {**how, "sigma": shift} if "sigma" in how else how
            try:
                values = eigsh(stiffness, k=number, M=sparse.diags_array(masses).tocsc(), return_eigenvectors=True, **how)[0]
            except Exception as error:  # noqa: BLE001
                table[who][kind]["failed"] += 1
                print(seed, kind, who, type(error).__name__, str(error)[:80], flush=True)
                continue
            judge(who, values, exact if who == "smallest" else abs(exact - shift))
    result = {"date": str(date.today()), "table": table, "counts": counts, "worst": worst, "complete": complete}
    Path(sys.argv[2]).write_text(json.dumps(result))


# The page.


def number(value):
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"


def compared(row, exact):
    """Modes found, and the largest relative error."""
    if row.get("failed"):
        return ["–", "–"]
    values, zeros = row["values"], exact["zeros"]
    expected = exact["values"][zeros:]
    found = sorted(values)[zeros:] if len(values) >= len(exact["values"]) else sorted(values)
    errors = [min(abs(value - e) / e for value in found) for e in expected] if found else []
    correct = [error for error in errors if error < 1e-6]
    return [f"{len(correct)} of {COUNT}", f"{max(correct):.0e}" if correct else "–"]


def page(results):
    processor = next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "")
    text = f"\nWritten by `benches/peers/modes.py`, {processor}, {os.cpu_count()} cores.\n"
    if found := results.get("proteins"):
        text += f"\n### Elastic networks\n\n`benches/peers/modes.py proteins FOLDER`, {found['date']}.\n"
        for scene in found["scenes"]:
            text += f"\n**{scene['name']}**: {scene['residues']:,} residues, {scene['springs']:,} springs; at the end {scene['load']:.0f} processes wanted the two cores.\n\n"
            text += "| by | threads | wall, s | processor, s | peak, MB | modes found | largest error | |\n|---|---|---|---|---|---|---|---|\n"
            for row in scene["rows"]:
                correct, error = compared(row, scene["exact"])
                remark = "complete" if row.get("complete") else ""
                if failed := row.get("failed"):
                    remark = f"no answer in {row['limit']} s" if failed == "time" else "not enough memory" if "memory" in failed.lower() else failed
                figures = [number(row["wall"]), number(row["cpu"]), f"{row['memory'] / 1e6:.0f}"]
                text += f"| {' | '.join([PEERS[row['peer']], str(row['threads']), *figures, correct, error, remark])} |\n"
    if found := results.get("planted"):
        text += f"\n### Planted scenes\n\n`benches/peers/modes.py planted`, {found['date']}: {sum(found['counts'].values())} scenes, seeds 0 to 59. Missed / invented eigenvalues.\n\n"
        text += f"| scenes | {' | '.join(ASKED_NAMES.values())} |\n|---|{'---|' * len(ASKED_NAMES)}\n"

        def cell(of):
            failed = f", {of['failed']} failed" if of["failed"] else ""
            return f"{of['missed']} / {of['invented']}{failed}"

        for kind in KINDS:
            text += f"| {found['counts'][kind]} {kind} | {' | '.join(cell(found['table'][who][kind]) for who in ASKED_NAMES)} |\n"
        sums = [{key: sum(of[key] for of in found["table"][who].values()) for key in ("missed", "invented", "failed")} for who in ASKED_NAMES]
        text += f"| all | {' | '.join(map(cell, sums))} |\n"
        text += f"\n`complete` on {found['complete']} of {sum(found['counts'].values())}; largest error of an eigenvalue {found['worst']:.0e}.\n"
    if found := results.get("large"):
        text += f"\n### A million degrees of freedom\n\n`benches/peers/modes.py large`, {found['date']}.\n\n"
        text += "| scene | wall, s | processor, s | peak, GB | zero modes | lowest ω², 1/s² | largest residual over ω² | counted |\n|---|---|---|---|---|---|---|---|\n"
        for row in found["scenes"]:
            figures = [row["name"], number(row["wall"]), number(row["cpu"]), f"{row['memory'] / 1e9:.1f}"]
            if row.get("failed"):
                figures += ["–", "–", "–", row["failed"]]
            else:
                values = row["eigenvalues"]
                error = max((r / abs(v) for r, v in zip(row["residuals"], values)), default=0.0)
                figures += [str(row["zero_modes"]), ", ".join(f"{v:.5g}" for v in values), f"{error:.0e}", "yes" if row["complete"] else "no"]
            text += f"| {' | '.join(figures)} |\n"
    return text


def main(what, *arguments):
    if what in (parts := {"prepare": prepare, "truth": truth, "peer": peer, "release": release, "framed": framed}):
        return parts[what](*arguments)
    if what == "planted-child":
        return planted()
    results = json.loads(DATA.read_text()) if DATA.exists() else {}
    if what == "planted":
        with tempfile.TemporaryDirectory() as scratch:
            out = f"{scratch}/planted.json"
            subprocess.run(own("planted-child", out), check=True)
            results = json.loads(DATA.read_text()) if DATA.exists() else {}
            results["planted"] = json.loads(Path(out).read_text())
    elif what == "proteins":
        new = proteins(*arguments)
        # Other parts may have been written meanwhile.
        results = json.loads(DATA.read_text()) if DATA.exists() else {}
        kept = {scene["name"]: scene for scene in results.get("proteins", {}).get("scenes", [])} | {scene["name"]: scene for scene in new["scenes"]}
        results["proteins"] = {"date": new["date"], "scenes": [kept[name] for name in PROTEINS if name in kept]}
    elif what == "large":
        new = large(*arguments)
        results = json.loads(DATA.read_text()) if DATA.exists() else {}
        kept = {scene["name"]: scene for scene in results.get("large", {}).get("scenes", [])} | {scene["name"]: scene for scene in new["scenes"]}
        results["large"] = {"date": new["date"], "scenes": [kept[name] for name in LARGE if name in kept]}
    elif what != "page":
        sys.exit(__doc__)
    DATA.write_text(json.dumps(results, indent=1) + "\n")
    before = PAGE.read_text().partition(MARK)[0] if PAGE.exists() else "# Normal modes beside scipy, SLEPc and ProDy\n\n"
    PAGE.write_text(before + MARK + re.sub(r" +\n", "\n", page(results)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
