#!/usr/bin/env python3
"""Solves every step of a motion with PETSc's GAMG, beside this library's multigrid.

    benches/compare/gamg.py [STEPS]

Needs Rust and petsc4py (the Debian package python3-petsc4py-real, with the Python that it is for). The bench `multigrid` makes the steps
of linear backward Euler and writes their systems, and what its own steps took: assembly, right-hand side and everything else of them
counts. PETSc then solves the same systems to the same residual, ‖b − A x‖ ≤ 1e-10 ‖b‖, by conjugate gradients from the solution of
the step before, preconditioned by GAMG with rigid-body modes and Chebyshev smoothing with incomplete Cholesky factors (`icc`) or as PETSc
has it by default. Aggregates and interpolation are kept from the second step on, as ours keeps its aggregates, or made anew in every step; with the
default smoother kept ones do not last. Only set-up and solve count.
Processor time of one thread; writes docs/performance/gamg.md.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from near_null import rigid_modes
from petsc4py import PETSc

ROOT = Path(__file__).resolve().parent.parent.parent
SCENES = [("cloth:100", "cloth 100, swings down", "0.01"), ("cloth:100", "cloth 100, swings down", "0.016666667"),
          ("rough:100", "cloth 100, stiff and crumpled by 3 %", "0.01"), ("rough:100", "cloth 100, stiff and crumpled by 3 %", "0.016666667"),
          ("lattice:22", "lattice 22", "0.016666667"), ("verification/scenes/bunny.toml", "bunny", "0.016666667")]
VARIANTS = {"icc, kept": {"mg_levels_pc_type": "icc", "pc_gamg_reuse_interpolation": True},
            "icc, anew": {"mg_levels_pc_type": "icc"}, "defaults, anew": {}}
TOLERANCE = 1e-10


def build():
    """The bench as a program."""
    command = ["cargo", "bench", "--bench", "multigrid", "--no-run", "--message-format", "json"]
    lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout.splitlines()
    built = [message for message in map(json.loads, lines) if message.get("executable")]
    return next(message["executable"] for message in built if message["target"]["name"] == "multigrid")


def near_null_space(dofs, positions):
    """Rigid motions, orthonormal."""
    modes = np.linalg.qr(rigid_modes(dofs, positions))[0].T
    return PETSc.NullSpace().create(vectors=[PETSc.Vec().createWithArray(np.ascontiguousarray(mode)) for mode in modes])


def solver(options):
    """Conjugate gradients with GAMG."""
    for key in PETSc.Options().getAll():
        PETSc.Options().delValue(key)
    chosen = {"ksp_type": "cg", "ksp_norm_type": "unpreconditioned", "pc_type": "gamg", "pc_gamg_reuse_interpolation": False, **options}
    for key, value in chosen.items():
        PETSc.Options().setValue(key, value)
    ksp = PETSc.KSP().create()
    ksp.setTolerances(rtol=TOLERANCE, atol=0.0, max_it=1000)
    ksp.setInitialGuessNonzero(True)
    ksp.setFromOptions()
    return ksp


def gamg(folder, steps, options):
    """Iterations and milliseconds of every step, the largest residual, and how many steps were not solved."""
    with open(folder / "pattern.bin", "rb") as file:
        n, entries = np.fromfile(file, np.uint64, 2).astype(int)
        starts, columns = np.fromfile(file, np.int32, n + 1), np.fromfile(file, np.int32, entries)
    dofs = np.fromfile(folder / "dofs.bin", np.uint32).reshape(-1, 2)
    a, ksp = None, solver(options)
    x = PETSc.Vec().createSeq(n)
    iterations, times, worst, failed = [], [], 0.0, 0
    for step in range(steps):
        values, b = (np.fromfile(folder / f"{name}-{step}.bin") for name in ("values", "b"))
        positions = np.fromfile(folder / f"positions-{step}.bin").reshape(-1, 3)
        if a is None:
            a = PETSc.Mat().createAIJ((n, n), csr=(starts, columns, values), bsize=3)
            a.setOption(PETSc.Mat.Option.SPD, True)
        else:
            a.setValuesCSR(starts, columns, values)
            a.assemble()
        if step <= 1:
            a.setNearNullSpace(near_null_space(dofs, positions))
        right = PETSc.Vec().createWithArray(b)
        began = time.process_time()
        ksp.setOperators(a)
        ksp.solve(right, x)
        took = 1e3 * (time.process_time() - began)
        if ksp.getConvergedReason() < 0:
            failed += 1
            x.set(0.0)
            continue
        times.append(took)
        iterations.append(ksp.getIterationNumber())
        residual = right.copy()
        a.multAdd(-x, right, residual)
        worst = max(worst, residual.norm() / right.norm())
        if step == 0:
            # The first step of a motion from rest may take one iteration; the aggregates are made with the second.
            ksp = solver(options)
    return iterations, times, worst, failed


def row(name, dt, label, iterations, times, remark):
    first = ", ".join(map(str, iterations[:3]))
    return (f"| {name} | {dt} | {label} | {first} | {max(iterations)} | {sum(iterations)} | "
            f"{np.median(times[1:]):.1f} | {remark} |")


def main(steps):
    program = build()
    rows = []
    for scene, name, dt in SCENES:
        shown = "1/60" if dt.startswith("0.016") else dt
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            subprocess.run([program, "export", folder, dt, str(steps), scene], check=True, stdout=subprocess.DEVNULL, cwd=ROOT)
            ours = json.loads((folder / "steps.json").read_text())
            rows.append(row(name, shown, "sprung", ours["iterations"], ours["ms"], f"{sum(ours['setups'])} set-ups of the coarse levels"))
            print(rows[-1], flush=True)
            for label, options in VARIANTS.items():
                iterations, times, worst, failed = gamg(folder, steps, options)
                remark = f"residual at most {worst:.1e}" + (f"; {failed} steps not solved" if failed else "")
                rows.append(row(name, shown, f"GAMG, {label}", iterations, times, remark))
                print(rows[-1], flush=True)
    version = ".".join(map(str, PETSc.Sys.getVersion()))
    page = f"""# Multigrid in motion, beside PETSc's GAMG

Written by `benches/compare/gamg.py` on {date.today()} with PETSc {version}. {steps} steps of linear backward Euler under `tension`, every system solved to
‖b − A x‖ ≤ 1e-10 ‖b‖ by conjugate gradients from the solution of the step before. Times are processor times of one thread, medians of the steps from the second on: of
sprung whole steps, with assembly, right-hand side and what decides when the coarse levels are made anew; of PETSc set-up and solve alone. GAMG's
aggregates and interpolation are kept from the second step on, or made anew in every step.

| scene | dt, s | by | iterations of the first steps | most | all | ms a step | |
|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}
"""
    (ROOT / "docs/performance/gamg.md").write_text(page)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 60)
