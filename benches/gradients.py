"""Times gradients of runs, and writes docs/performance/gradients.md.

    python benches/gradients.py [--write]

User time of the processor, medians of three, on one thread and on two: each case is a process of its own.
"""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
import sys
import warnings
from pathlib import Path

#: Side of the cloth, method, steps, checkpoints and repeats.
CASES = [
    (32, "backward-euler", 100, None, 3),
    (32, "implicit-midpoint", 100, None, 3),
    (32, "verlet", 1000, None, 3),
    (32, "verlet", 1000, 20, 3),
    (100, "backward-euler", 10, None, 3),
    (100, "implicit-midpoint", 10, None, 3),
    (100, "verlet", 100, None, 3),
    (32, "implicit-midpoint", 1000, 20, 1),
]
DT = {"backward-euler": 2e-3, "implicit-midpoint": 2e-3, "verlet": 1e-4}


def measured(side: int, method: str, steps: int, checkpoints: int | None, repeats: int) -> dict[str, float]:
    import numpy as np
    import sprung

    warnings.simplefilter("ignore")
    system, dt = sprung.System.ready("cloth", side), DT[method]
    if side == 100 and method == "verlet":
        dt /= 4

    def median(task):
        times, found = [], None
        for _ in range(repeats):
            begun = os.times().user
            found = task()
            times.append(os.times().user - begun)
        return float(np.median(times)), found

    ordinary, _ = median(lambda: sprung.Stepper(system, method=method, solver=None if method == "verlet" else "llt").run(steps * dt, dt=dt, allow_unstable=True))
    forward, run = median(lambda: sprung.Stepper(system, method=method).run(steps * dt, dt=dt, differentiable=True, checkpoints=checkpoints))
    weights = np.ones(run.state.positions.shape)
    gradient, _ = median(lambda: run.gradient(weights, check=False))
    return {"ordinary": ordinary, "forward": forward, "gradient": gradient}


def processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []:
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor()


def main() -> None:
    if "--case" in sys.argv:
        print(json.dumps(measured(*json.loads(sys.argv[-1]))))
        return
    lines = [
        "# Gradients of runs",
        "",
        f"Written by `python benches/gradients.py --write` on {datetime.date.today()}, {processor()}. User time of the processor, medians of three (of 1000 implicit steps one), for the ready scene `cloth`.",
        "*Gradient / run* is the time of `gradient` over that of the run with `differentiable=True` before it; *gradient / ordinary run* over that of a run with energies and",
        "estimates of errors, by sparse Cholesky. Where there are 20 checkpoints for 1000 steps, a gradient computes 1748 steps again, the fewest possible.",
        "",
        "| side | method | steps | checkpoints | run, s | gradient, s | gradient / run, 1 thread | 2 threads | gradient / ordinary run |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for case in CASES:
        found = {}
        for threads in (1, 2):
            done = subprocess.run(
                [sys.executable, __file__, "--case", json.dumps(case)],
                env={**os.environ, "RAYON_NUM_THREADS": str(threads)}, capture_output=True, text=True, check=True,
            )  # fmt: skip
            found[threads] = json.loads(done.stdout)
        one, two = found[1], found[2]
        side, method, steps, checkpoints, _ = case
        lines.append(
            f"| {side} | {method} | {steps} | {checkpoints or 'all states'} | {one['forward']:.2f} | {one['gradient']:.2f} | "
            f"{one['gradient'] / one['forward']:.2f} | {two['gradient'] / two['forward']:.2f} | {one['gradient'] / one['ordinary']:.2f} |"
        )
        print(lines[-1], flush=True)
        if "--write" not in sys.argv:
            continue
        path = Path(__file__).parents[1] / "docs/performance/gradients.md"
        path.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
