#!/usr/bin/env python3
"""Measures sprung beside Eigen, CHOLMOD, scipy and pyamg on the same scenes, in one run.

    benches/compare/run.py [SCENE…]        for example: benches/compare/run.py "cloth 100" "lattice 22"
    benches/compare/run.py --before COMMIT [SCENE…]

Needs Rust, a C++ compiler, the Debian packages libeigen3-dev, libsuitesparse-dev and libopenblas-dev, and the Python
packages numpy, scipy, pyamg and matplotlib. Builds everything, writes every scene's system, measures
scene by scene, one program after the other, and writes docs/performance/{results.json, README.md, *.svg}.

`--before` measures sprung alone, as it is and as it was at a commit, by turns on every scene, and writes docs/performance/since.json. Other
libraries are not measured, which saves half an hour.

The peers get their best settings: CHOLMOD is supernodal with its better ordering of AMD and METIS and a BLAS tuned for the
processor, whose threads it may not nest (it is several times slower otherwise); Eigen stores one triangle where it can
and is compiled for this machine; pyamg gets rigid-body modes and block Gauss-Seidel. Ours is compiled without options.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path

import numpy as np

import report

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
DOCS = ROOT / "docs" / "performance"
SCENES = ["cloth 10", "cloth 32", "cloth 100", "cloth 316", "cloth 1000", "lattice 5", "lattice 10", "lattice 22", "lattice 46"]
# What `--before` measures, by the beginnings of names, and how often; of the largest scenes kernels alone.
KERNELS = ["product", "refill", "right-hand"]
SOLVERS = ["cg none", "cg block-jacobi", "cg multigrid", "direct"]
LARGEST = {"cloth 1000", "lattice 46"}
TURNS = 5
DT = 0.01
# Beyond this many degrees of freedom only sprung and CHOLMOD are measured: the others would take hours.
LARGEST_FOR_ALL = 350_000
# Factorizations of more operations than this are measured on two threads only, as in `ours.rs`.
LARGE_FACTOR = 2e11
# Eigen's factorization works column by column; on this scene it would take hours.
NOT_FACTORED_BY_EIGEN = {"lattice 46"}


def output(*command, **keywords):
    return subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True, **keywords).stdout


def build_ours(root):
    messages = output("cargo", "bench", "--bench", "compare", "--no-run", "--message-format", "json", cwd=root)
    targets = [message for message in map(json.loads, messages.splitlines()) if message.get("executable")]
    return next(message["executable"] for message in targets if message["target"]["name"] == "compare")


def build_before(folder, commit):
    """sprung as it was at a commit, built from a checkout of its own, in a folder of its own below ours so that a second time is quick."""
    checkout = folder / "before"
    output("git", "worktree", "add", "--detach", checkout, commit, cwd=ROOT)
    try:
        os.environ["CARGO_TARGET_DIR"] = str(ROOT / "target" / "before")
        return build_ours(checkout)
    finally:
        del os.environ["CARGO_TARGET_DIR"]
        output("git", "worktree", "remove", "--force", checkout, cwd=ROOT)


def build(folder):
    ours = build_ours(ROOT)
    peers = folder / "peers"
    output("g++", "-std=c++17", "-O3", "-march=native", "-fopenmp", "-I/usr/include/eigen3", HERE / "peers.cpp", "-o", peers,
           "-lcholmod", "-lopenblas")
    return ours, peers


def write_triplets(folder):
    """What assembly without a slot map sorts: the lower triangle of every spring's four blocks and of every mass."""
    dofs = np.fromfile(folder / "dofs.bin", np.uint32).reshape(-1, 2)
    x = np.fromfile(folder / "positions.bin").reshape(-1, 3)
    pairs = np.fromfile(folder / "springs.bin", np.uint32).reshape(-1, 2)
    k, l0, damping = np.fromfile(folder / "parameters.bin").reshape(-1, 3).T
    d = x[pairs[:, 0]] - x[pairs[:, 1]]
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    across = np.maximum(k * (1 / l0 - 1 / length), 0.0)
    excess = k / l0 + damping / DT - across
    blocks = across[:, None, None] * np.eye(3) + excess[:, None, None] * n[:, :, None] * n[:, None, :]
    row = np.full((len(x), 3), -1)
    row[dofs[:, 0], dofs[:, 1]] = np.arange(len(dofs))
    parts = [(row[pairs[:, p]], row[pairs[:, q]], sign * blocks) for p, q, sign in
             [(0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)]]
    masses = np.fromfile(folder / "masses.bin") / DT**2
    parts.append((row, row, masses[:, None, None] * np.eye(3)))
    triplets = []
    for rows, columns, values in parts:
        rows, columns = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
        keep = (rows >= columns) & (columns >= 0) & ~((values == 0) & (rows != columns))
        part = np.empty(keep.sum(), dtype=[("row", "i4"), ("column", "i4"), ("value", "f8")])
        part["row"], part["column"], part["value"] = rows[keep], columns[keep], values[keep]
        triplets.append(part)
    np.concatenate(triplets).tofile(folder / "triplets.bin")


def environment(library, threads):
    """CHOLMOD's own threads would nest those of the BLAS; Eigen has only its own."""
    tuned = dict(os.environ, OMP_NUM_THREADS=str(threads), OPENBLAS_NUM_THREADS=str(threads))
    if library == "cholmod":
        tuned["OMP_THREAD_LIMIT"] = "1"
    if "avx512f" in Path("/proc/cpuinfo").read_text():
        # This BLAS takes newer processors for older ones.
        tuned["OPENBLAS_CORETYPE"] = "SkylakeX"
    return tuned


def measure(folder, name, ours, peers):
    output(ours, "--bench", "export", *name.split(), folder)
    particles = (folder / "positions.bin").stat().st_size // 24
    lines = output(ours, "--bench", "measure", *name.split())
    lines += output(ours, "--bench", "steps", *name.split())
    for preconditioner in ("block-jacobi", "multigrid"):
        lines += output(ours, "--bench", "memory", *name.split(), preconditioner)
    is_huge = 3 * particles > LARGEST_FOR_ALL
    if not is_huge:
        write_triplets(folder)
    for threads in (1, 2):
        for library in ("eigen", "cholmod"):
            if is_huge and (library, threads) != ("cholmod", 2):
                continue
            largest = 0 if library == "eigen" and name in NOT_FACTORED_BY_EIGEN else LARGE_FACTOR if threads == 1 else 1e15
            lines += output(peers, library, name, particles, folder, threads, largest, env=environment(library, threads))
    if not is_huge:
        lines += output(sys.executable, HERE / "amg.py", name, particles, folder, env=environment("pyamg", 1))
    return [json.loads(line) for line in lines.splitlines()]


def since(name, ours, before):
    """sprung as it is and as it was, by turns: on a machine that others work on too, the medians of several turns can be compared. Of the stages
    that `report.SINCE` names the times on one thread are kept."""
    times = {}
    for _ in range(TURNS):
        for program, library in ((ours, "sprung"), (before, "sprung before")):
            for stage in KERNELS if name in LARGEST else KERNELS + SOLVERS:
                for row in map(json.loads, output(program, "--bench", "measure", *name.split(), stage).splitlines()):
                    if row["threads"] == 1 and row["stage"] in report.SINCE:
                        times.setdefault((library, row["stage"]), []).append({**row, "library": library})
    return [sorted(rows, key=lambda row: row["ms"])[len(rows) // 2] for rows in times.values()]


def main():
    parser = argparse.ArgumentParser(description="Measures sprung beside other libraries: see the head of this file.")
    parser.add_argument("--before", metavar="COMMIT")
    parser.add_argument("scenes", metavar="SCENE", nargs="*")
    arguments = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        programs = (build_ours(ROOT), build_before(folder, arguments.before)) if arguments.before else build(folder)
        for name in arguments.scenes or SCENES:
            print(f"measuring {name}", file=sys.stderr, flush=True)
            results += since(name, *programs) if arguments.before else measure(folder, name, *programs)
    DOCS.mkdir(parents=True, exist_ok=True)
    if arguments.before:
        day = date.today().isoformat()
        record = {"commit": arguments.before, "day": day, "results": results}
        (DOCS / "since.json").write_text(json.dumps(record, indent=1) + "\n")
        report.render_again()
    else:
        (DOCS / "results.json").write_text("[\n" + ",\n".join(map(json.dumps, results)) + "\n]\n")
        report.write(results, DOCS)


if __name__ == "__main__":
    main()
