#!/usr/bin/env python3
"""Static equilibria beside other methods: trust regions and L-BFGS of scipy, and dynamic relaxation of compas_dr.

    benches/peers/equilibria.py [NAME ...]

Needs the command sprung (`cargo build --release`; another than that in target/release by SPRUNG=FILE), the program `study` of verification/ beside
it for random scenes, numpy, scipy, compas_dr and the Python package of this repository. Writes docs/performance/equilibria.md.

Every method starts at the start of the scene, at rest. The energy, its gradient and its second derivative times a vector are numpy's here, written from the
law of a spring; residuals and, up to 1500 degrees of freedom, the lowest eigenvalue at the end are judged with them.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np
import sprung
from compas_dr.numdata import InputData
from compas_dr.solvers import dr_numpy
from scipy.optimize import minimize

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/performance/equilibria.md"
SPRUNG = os.environ.get("SPRUNG", str(ROOT / "target/release/sprung"))
STUDY = Path(SPRUNG).with_name("study")
MARK = "## Results\n"
# Largest force left over the largest that acts, at most: of the peers, which compare energies, whose rounding hides less; and the seconds of processor time
TOLERANCE, LIMIT = 1e-6, float(os.environ.get("LIMIT", "60"))
FIRST_SEED, SEEDS, DENSE = 41000, 24, 1500
OPTIONS = ["on-demand", "progressive", "tension", "absolute"]
PEERS = ["trust region", "L-BFGS", "dynamic relaxation"]


class Stop(Exception):
    """The residual is small, or the time is up."""


def in_space(x):
    """Vectors of fewer axes with zeros for the others."""
    x = np.atleast_2d(np.array(x, dtype=float))
    return np.pad(x, ((0, 0), (0, 3 - x.shape[1])))


class Energy:
    """The energy E(x) = sum k (l - l0)²/(2 l0) - sum m g·x of the free coordinates."""

    def __init__(self, system):
        self.x = in_space(system.initial_state().positions)
        self.pairs = np.asarray(system.pairs, dtype=int)
        self.k, self.l0 = np.array(system.stiffness), np.array(system.rest_lengths)
        self.weight = np.asarray(system.masses)[:, None] * in_space(system.gravity)
        particles, axes = np.asarray(system.dofs).T
        self.free = 3 * particles + axes
        self.start = self.x.ravel()[self.free]
        self.acting = 0.0
        self.gradient(self.start)
        self.acting = self.acts

    def springs(self, u):
        x = self.x.ravel().copy()
        x[self.free] = u
        d = x.reshape(-1, 3)[self.pairs[:, 0]] - x.reshape(-1, 3)[self.pairs[:, 1]]
        length = np.linalg.norm(d, axis=1)
        return x.reshape(-1, 3), d, length

    def value(self, u):
        x, _, length = self.springs(u)
        return (self.k * (length - self.l0) ** 2 / (2 * self.l0)).sum() - (self.weight * x).sum()

    def summed(self, forces):
        total = np.zeros((len(self.x), 3))
        np.add.at(total, self.pairs[:, 0], forces)
        np.add.at(total, self.pairs[:, 1], -forces)
        return total

    def gradient(self, u):
        _, d, length = self.springs(u)
        tension = self.k * (length / self.l0 - 1)
        # A spring at rest has some roundings of tension.
        self.acts = max(abs(tension).max(), np.linalg.norm(self.weight, axis=1).max(), 1e-9 * self.k.max())
        return (self.summed((tension / length)[:, None] * d) - self.weight).ravel()[self.free]

    def product(self, u, p):
        """The second derivative times p."""
        _, d, length = self.springs(u)
        full = np.zeros(3 * len(self.x))
        full[self.free] = p
        change = full.reshape(-1, 3)[self.pairs[:, 0]] - full.reshape(-1, 3)[self.pairs[:, 1]]
        n = d / length[:, None]
        along = (n * change).sum(axis=1)[:, None] * n
        axial, transverse = self.k / self.l0, self.k * (1 / self.l0 - 1 / length)
        return self.summed(axial[:, None] * along + transverse[:, None] * (change - along)).ravel()[self.free]

    def residual(self, u):
        """The largest force left over the largest that acts, at the start or here."""
        left = abs(self.gradient(u)).max()
        return left / max(self.acts, self.acting) if left else 0.0

    def verdict(self, u):
        """The sign of the lowest eigenvalue, to rounding."""
        if len(u) > DENSE:
            return ""
        values = np.linalg.eigvalsh(np.column_stack([self.product(u, e) for e in np.eye(len(u))]))
        zero = 1e-9 * max(abs(values).max(), 1e-300)
        return "saddle" if values[0] < -zero else "indifferent" if values[0] < zero else "minimum"


def watched(energy, counts):
    """Stops a search at the tolerance and at the limit of time."""
    start = time.process_time()

    def check(u):
        counts["steps"] += 1
        counts["last"] = np.array(u)
        if energy.residual(u) <= TOLERANCE:
            raise Stop
        if time.process_time() - start > LIMIT:
            counts["late"] = True
            raise Stop

    return check


def by_scipy(energy, method):
    counts = {"steps": 0, "products": 0, "last": energy.start}
    check = watched(energy, counts)

    def product(u, p):
        counts["products"] += 1
        return energy.product(u, p)

    options = {"maxiter": 10**6, "gtol": 0.0}
    extra = {"hessp": product} if method == "trust-ncg" else {}
    if method == "L-BFGS-B":
        options |= {"maxfun": 10**7, "ftol": 0.0}
    try:
        minimize(energy.value, energy.start, jac=energy.gradient, method=method, callback=check, options=options, **extra)
    except Stop:
        pass
    return counts


def by_relaxation(energy):
    """compas_dr with its defaults, k as E A of a unit section, the tolerance as its own and no smallest displacement."""
    held = sorted(set(range(len(energy.x))) - set((energy.free // 3).tolist()))
    counts = {"steps": 0, "products": 0, "last": energy.start}
    check = watched(energy, counts)
    count = len(energy.pairs)
    data = InputData(
        vertices=energy.x.copy(),
        edges=energy.pairs.tolist(),
        fixed=held,
        loads=energy.weight,
        qpre=[0.0] * count,
        linit=energy.l0.tolist(),
        E=energy.k.tolist(),
        radius=[3.14159**-0.5] * count,
    )
    try:
        dr_numpy(data, kmax=10**7, tol1=0.0, tol2=0.0, callback=lambda k, x, *_: check(np.asarray(x).ravel()[energy.free]))
    except Stop:
        pass
    return counts


def own(scene, option):
    """The command: Newton steps and factorizations, to 1e-10."""
    with tempfile.TemporaryDirectory() as out:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run([SPRUNG, "equilibrium", scene, "--stiffness", option, "--json", "--threads", "1", "--out", out], capture_output=True, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        found = json.loads(run.stdout)
        positions = np.array(json.loads((Path(out) / "equilibrium.json").read_text())["positions"])
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return found, positions, seconds


def compare(name, scene):
    system = sprung.System.load(scene)
    energy = Energy(system)
    np.seterr(all="ignore")
    if energy.residual(energy.start) <= TOLERANCE:
        return None
    row = {"name": name, "particles": len(energy.x), "start": energy.value(energy.start)}
    for option in OPTIONS:
        found, positions, seconds = own(scene, option)
        u = in_space(positions).ravel()[energy.free]
        row[option] = {"status": found["status"], "steps": found["iterations"], "factorizations": found["factorizations"], "seconds": seconds}
        row[option] |= {"residual": energy.residual(u), "energy": energy.value(u), "verdict": energy.verdict(u)}
    if row["on-demand"]["status"] == "none":
        return None
    for peer in PEERS:
        start = time.process_time()
        counts = by_relaxation(energy) if peer == "dynamic relaxation" else by_scipy(energy, "trust-ncg" if peer == "trust region" else "L-BFGS-B")
        u = counts["last"]
        finite = np.isfinite(u).all()
        row[peer] = {"steps": counts["steps"], "products": counts["products"], "seconds": time.process_time() - start, "late": counts.get("late", False)}
        row[peer] |= {"residual": energy.residual(u), "energy": energy.value(u), "verdict": energy.verdict(u)} if finite else {"residual": np.inf, "energy": np.nan, "verdict": "diverged"}
    print(json.dumps(row), flush=True)
    return row


def scenes(scratch):
    """Ready scenes at sizes of their own, and random ones; names and files."""
    for kind, size in [("chain", 10), ("cloth", 12), ("cloth", 20), ("lattice", 6), ("pendulum", 5), ("string", 20), ("network", 30), ("network", 100)]:
        file = f"{scratch}/{kind}-{size}.npz"
        subprocess.run([SPRUNG, "new", kind, "--size", str(size), "-q", "-o", file], check=True)
        yield f"{kind} {size}", file
    for seed in range(FIRST_SEED, FIRST_SEED + SEEDS):
        file = f"{scratch}/{seed}.json"
        subprocess.run([STUDY, "--export", str(seed), file], check=True, capture_output=True)
        scene = json.loads(Path(file).read_text())
        # compas_dr holds whole particles.
        if all(set(c.get("axes", "xyz")) >= set("xyz"[: len(scene["particles"]["positions"][0])]) for c in scene.get("constraints", [])):
            yield f"{scene.get('name') or seed}", file


def converged(cell):
    return cell["residual"] <= TOLERANCE and cell.get("status") not in ("not-converged", "unstable")


def page(rows):
    processor = next((line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "")
    text = f"\nWritten by `benches/peers/equilibria.py` on {date.today()}, {processor}, one thread.\n\n"
    text += f"| of {len(rows)} scenes | arrived | at a saddle | steps, median | most | factorizations, median | most | seconds, median | most |\n|---|---|---|---|---|---|---|---|---|\n"
    for who in [*OPTIONS, *PEERS]:
        cells = [row[who] for row in rows]
        there = [cell for cell in cells if converged(cell)]
        saddles = sum(cell["verdict"] == "saddle" for cell in there)
        columns = [[cell[key] for cell in there] for key in ("steps", "factorizations", "seconds") if key in cells[0]]
        figures = [f"{np.median(c):.3g} | {max(c):.3g}" if c else "– | –" for c in columns]
        if len(figures) == 2:
            figures.insert(1, "– | –")
        text += f"| {'sprung, ' + who if who in OPTIONS else who} | {len(there)} | {saddles} | {' | '.join(figures)} |\n"
    text += f"\n| scene | particles | {' | '.join([*OPTIONS, *PEERS])} |\n|---|---|{'---|' * (len(OPTIONS) + len(PEERS))}\n"

    def cell(row, who):
        of = row[who]
        if not converged(of):
            return f"{of['residual']:.0e} after {of['steps']}" if np.isfinite(of["residual"]) else "diverged"
        count = f"{of['steps']} ({of['factorizations']})" if who in OPTIONS else f"{of['steps']}"
        lowest = min(row[w]["energy"] for w in [*OPTIONS, *PEERS] if converged(row[w]))
        higher = of["energy"] > lowest + 1e-6 * (row["start"] - lowest)
        return count + (" saddle" if of["verdict"] == "saddle" else "") + (" ↑" if higher else "")

    for row in rows:
        text += f"| {row['name']} | {row['particles']} | {' | '.join(cell(row, who) for who in [*OPTIONS, *PEERS])} |\n"
    return text


def main(*names):
    with tempfile.TemporaryDirectory() as scratch:
        rows = [compare(name, file) for name, file in scenes(scratch) if not names or name in names]
    rows = [row for row in rows if row]
    before = PAGE.read_text().partition(MARK)[0] if PAGE.exists() else "# Equilibria beside other methods\n\n"
    PAGE.write_text(before + MARK + page(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
