"""A thousand stiffnesses of a net from a noisy motion, with 95 % intervals, by `sprung.fit`; writes identification.md.

    python verification/identification.py [--write]

Needs sprung and scipy. Particles, masses, rest lengths, damping, velocities and the true stiffnesses are random; the search starts from the mean
stiffness.
"""

from __future__ import annotations

import datetime
import sys
from pathlib import Path

import numpy as np
import sprung

SIDE, DT = 23, 0.02
STEPS = np.arange(5, 31, 5)
#: Standard deviations of a measured coordinate in m, each with a net and a noise of its own.
NOISE = (1e-3, 1e-4)


def net(side: int, seed: int) -> sprung.System:
    """A net of cells of about a metre, held at its corners, that is thrown."""
    rng = np.random.default_rng(seed)
    count = side * side
    y, x = np.mgrid[:side, :side].astype(float)
    positions = np.column_stack([x.ravel(), y.ravel(), np.zeros(count)]) + rng.normal(0, 0.05, (count, 3))
    number = np.arange(count).reshape(side, side)
    pairs = np.concatenate([
        np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
    ])  # fmt: skip
    springs = len(pairs)
    return sprung.System(
        positions, pairs, masses=rng.uniform(0.5, 1.5, count), stiffness=rng.uniform(40, 80, springs), rest_lengths=rng.uniform(0.85, 0.95, springs),
        damping=rng.uniform(0.2, 0.6, springs), velocities=rng.normal(0, 1, (count, 3)), gravity=[0, 0, -9.81],
        constraints=[sprung.Constraint(number[[0, 0, -1, -1], [0, -1, 0, -1]])],
    )  # fmt: skip


def main() -> None:
    lines = [
        "# A thousand stiffnesses from a noisy motion",
        "",
        f"Written by `python verification/identification.py --write` on {datetime.date.today()}. A net of {SIDE} × {SIDE} particles is thrown. Its positions after",
        f"{len(STEPS)} of {STEPS[-1]} steps of `implicit-midpoint` of {DT:g} s are recorded, and normal noise is added to every coordinate. `sprung.fit` starts from one stiffness of 60 N for",
        "all springs, and finds one for each. A spring has 40 to 80 N, and its interval is the estimate ± 1.96 standard errors, which holds the truth in 95 of 100 cases.",
        "",
        "*Standardized* is the root mean square of the errors over their standard errors, and χ²/n the sum of squares of the errors, weighed with the inverse of the",
        "covariance, over their number: both are 1 on average. Beside χ²/n is its standard deviation.",
        "",
        "| noise, m | springs | measurements | intervals that hold the truth | standardized | χ²/n | median standard error, N | noise found, m | runs |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for seed, noise in enumerate(NOISE):
        truth = net(SIDE, seed)
        run = sprung.Stepper(truth, method="implicit-midpoint").run(DT * STEPS[-1], dt=DT, differentiable=True)
        measured = run.positions[STEPS] + noise * np.random.default_rng(100 + seed).normal(size=run.positions[STEPS].shape)
        found = sprung.fit(truth.with_springs(stiffness=60.0), measured, steps=STEPS, dt=DT)
        assert found.success, found.message
        error, deviation = found.stiffness - truth.stiffness, found.standard_errors["stiffness"]
        count = len(error)
        held = np.count_nonzero(abs(error) < 1.96 * deviation)
        squares = error @ np.linalg.solve(found.covariance, error)
        lines.append(
            f"| {noise:g} | {count} | {np.count_nonzero(np.isfinite(found.residual))} | {held} ({100 * held / count:.1f} %) | {np.sqrt(np.mean((error / deviation) ** 2)):.3f} | "
            f"{squares / count:.3f} ± {np.sqrt(2 / count):.3f} | {np.median(deviation):.2g} | {found.sigma:.4g} | {found.evaluations} |"
        )
        print(lines[-1], flush=True)
    if "--write" in sys.argv:
        Path(__file__).with_name("identification.md").write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
