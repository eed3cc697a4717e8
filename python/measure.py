"""Times the matrices of a cloth: in Python, in the library, and assembled by numpy and scipy.

    python measure.py [SIDE] [REPEATS]        # 316 × 316 particles and 5 repeats without arguments

All in one process and in turns, so that what else the machine does falls on all alike; the least time of each counts. It
prints the table of docs/guide/src/how-to/python.md.
"""

import sys
import time
from pathlib import Path

import numpy as np
import sprung
from sprung import _native

sys.path.insert(0, str(Path(__file__).parent / "tests"))
from conftest import assemble  # noqa: E402

side = int(sys.argv[1]) if len(sys.argv) > 1 else 316
repeats = int(sys.argv[2]) if len(sys.argv) > 2 else 5
dt = 0.01
system = sprung.System.ready("cloth", side)
state = system.initial_state()
system.dofs, system.pairs, system.stiffness  # made once, as the library's own lists are
given = state._given()


def library():
    _native.assemble(system._native, given, dt, "full")


def package():
    matrices = system.matrices(state, dt)
    return matrices.A, matrices.M, matrices.G, matrices.K, matrices.b


parts = package()


def copies():
    for part in parts[:4]:
        part.copy()
    parts[4].copy()


def scipy():
    assemble(system, state, dt, "full")


tasks = {"library": library, "copy": copies, "package": package, "scipy": scipy}
best = {name: np.full(2, np.inf) for name in tasks}
for _ in range(repeats):
    for name, task in tasks.items():
        begun = np.array([time.perf_counter(), time.process_time()])
        task()
        best[name] = np.minimum(best[name], [time.perf_counter(), time.process_time()] - begun)

allowed = best["library"] + best["copy"]
entries = sum(part.nnz for part in parts[:4])
print(f"cloth of {side} × {side} particles, {len(system.pairs)} springs, {entries} entries in A, M, G and K\n")
print("| | elapsed, ms | of the library and a copy | processor, ms | of the library and a copy |")
print("|---|---|---|---|---|")
for name, words in (
    ("library", "the library assembles, one triangle each"),
    ("copy", "a copy of both triangles by numpy"),
    ("package", "`system.matrices(state, dt)`, all four and b"),
    ("scipy", "the same formulas by numpy and scipy"),
):
    (wall, cpu), (wall_share, cpu_share) = 1e3 * best[name], best[name] / allowed
    print(f"| {words} | {wall:.0f} | {wall_share:.2f} | {cpu:.0f} | {cpu_share:.2f} |")
