"""Measures scipy and pyamg on the linear system that `ours.rs` has written to FOLDER, by the processor time of one thread; one
JSON object a line.

    amg.py NAME PARTICLES FOLDER
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pyamg
import scipy.sparse

from near_null import rigid_modes


def line(library, stage, seconds, **more):
    print(json.dumps({"scene": NAME, "particles": PARTICLES, "library": library, "threads": 1, "stage": stage,
                      "ms": 1e3 * seconds, **more}), flush=True)


def median(kernel):
    kernel()
    times = []
    while sum(times) < 1.0 and len(times) < 21:
        start = time.process_time()
        kernel()
        times.append(time.process_time() - start)
    return float(np.median(times))


def read(folder):
    """A from its lower triangle, and b."""
    with open(folder / "a.bin", "rb") as file:
        n, entries = np.fromfile(file, np.uint64, 2).astype(int)
        starts, rows = np.fromfile(file, np.int32, n + 1), np.fromfile(file, np.int32, entries)
        lower = scipy.sparse.csc_matrix((np.fromfile(file, float, entries), rows, starts), shape=(n, n))
    return (lower + scipy.sparse.tril(lower, -1).T).tocsr(), np.fromfile(folder / "b.bin")


def main(folder):
    a, b = read(folder)
    dofs = np.fromfile(folder / "dofs.bin", np.uint32).reshape(-1, 2)
    positions = np.fromfile(folder / "positions.bin").reshape(-1, 3)
    line("scipy", "product", median(lambda: a @ b))

    start = time.process_time()
    levels = pyamg.smoothed_aggregation_solver(
        a.tobsr(blocksize=(3, 3)) if a.shape[0] % 3 == 0 else a,
        B=rigid_modes(dofs, positions), symmetry="symmetric",
        presmoother=("block_gauss_seidel", {"sweep": "symmetric"}),
        postsmoother=("block_gauss_seidel", {"sweep": "symmetric"}))
    setup = time.process_time() - start
    residuals = []
    x = levels.solve(b, tol=1e-10, accel="cg", maxiter=500, residuals=residuals)
    seconds = time.process_time() - start
    line("pyamg", "cg multigrid", seconds, setup_ms=1e3 * setup, iterations=len(residuals) - 1,
         residual=float(np.linalg.norm(b - a @ x) / np.linalg.norm(b)))


if __name__ == "__main__":
    NAME, PARTICLES = sys.argv[1], int(sys.argv[2])
    main(Path(sys.argv[3]))
