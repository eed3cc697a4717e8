#!/usr/bin/env python3
"""MuJoCo's methods on the scenes of this package, for its tables and pictures: writes mujoco.json beside this file.

    cargo run --release --manifest-path benches/peers/Cargo.toml -- scenes FOLDER
    benches/peers/mujoco_curves.py FOLDER

FOLDER has the scenes, their durations and where they end in truth, as the first command writes them. Needs the Python packages numpy
and mujoco. Scenes are converted as for `frames.py`, by `simulators/mujoco.py`; those that cannot be are named and left out. Only the
steps are timed, in processor time of one thread, not what prepares them.
"""

import json
import sys
import warnings
from pathlib import Path

import numpy as np

from simulators import mujoco
from simulators import scene as scenes

RESULTS = Path(__file__).resolve().parent / "mujoco.json"
# As for everybody else: three numbers of steps to a power of two, until the error is small enough, a good run takes longer than LAST or any
# run longer than LONGEST (in s).
RUNGS = range(120)
SMALLEST = 2e-9
LAST = 1.0
LONGEST = 8.0
# A run shorter than this is timed again, so often that all of it takes about this long.
AGAIN = 0.1


def steps(rung):
    return round(4 * 2 ** (rung / 3))


def shortest(run, integrator, count):
    """Positions at the end, and the shortest of several times."""
    positions, seconds = run(integrator, count)
    repeats = min(40, max(2, int(AGAIN / max(seconds, 1e-6)))) if seconds < 0.6 else 0
    return positions, min([seconds, *(run(integrator, count)[1] for _ in range(repeats))])


def climb(run, integrator, reference, extent):
    """Pairs of a time in s and an error, none where the run failed, from coarse to fine."""
    curve = []
    for rung in RUNGS:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            positions, seconds = shortest(run, integrator, steps(rung))
            error = float(np.linalg.norm(positions - reference) / extent)
        curve.append([float(f"{seconds:.4g}"), float(f"{error:.4g}") if error < 1 else None])
        if error < SMALLEST or seconds > (LAST if error < 1 else LONGEST):
            break
    return curve


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    results = {"version": mujoco.version(), "scenes": {}, "left_out": {}}
    for file in sorted(Path(sys.argv[1]).glob("*.json")):
        given = json.loads(file.read_text())
        name = given["scene"]["name"]
        try:
            scene = scenes.read(name, json.dumps(given["scene"]), given["frames"])
        except ValueError as why:
            print(why, flush=True)
            results["left_out"][name] = "it has particles that are moved"
            continue
        run, reference = mujoco.runs(scene), np.array(given["reference"])
        results["scenes"][name] = {}
        for method, (integrator, _) in mujoco.INTEGRATORS.items():
            curve = climb(run, integrator, reference, given["extent"])
            results["scenes"][name][method] = curve
            least = min((error for _, error in curve if error is not None), default=None)
            print(f"{name}, {method}: {len(curve)} runs, least error {least}", flush=True)
    RESULTS.write_text(json.dumps(results) + "\n")


if __name__ == "__main__":
    main()
