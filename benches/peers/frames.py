#!/usr/bin/env python3
"""What a frame of a motion costs at equal error: sprung beside MuJoCo, Newton (VBD, XPBD, semi-implicit) and Taichi.

    benches/peers/frames.py [--limit S] [SCENE [NAME…]]      for example: benches/peers/frames.py "cloth 32" MuJoCo "sprung w2"
    benches/peers/frames.py --page                           the page again, from what was measured

Measures a scene (all of them), those contenders whose names begin with a NAME (all of them), and writes
docs/performance/frames.json, frames.md and a picture a scene. Every call adds one time to each point, the page has
medians: call it several times, so that the rounds of all contenders alternate. `--limit` is the longest run that is tried,
in s of processor time (6).

Needs Rust and the Python packages numpy, scipy and matplotlib; of the peers those that are installed are measured:
`pip install mujoco newton taichi` (Python 3.10 to 3.12; Newton brings Warp). Everybody has one thread, timed by its
processor time. Loading, compiling and preparing a peer's model does not count; of sprung only reading the scene and
writing the results do not.

Every scene is converted by a file in `simulators/`: particles, masses, springs with their damping, gravity, held particles,
no contacts. That a conversion is right is seen by convergence: with shorter steps the peer must come to the reference, an
integrator of scipy's on forces of numpy's, at its order or very near. A conversion of which no method does is named, here and on
the page, and the exit status is then 1.
"""

import argparse
import json
import os
import subprocess
import sys
import warnings
from datetime import date
from pathlib import Path

for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"
HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
RESULTS = ROOT / "docs" / "performance" / "frames.json"
CACHE = ROOT / "target" / "frames"

import numpy as np

import frames_page
import simulators
from simulators import ours, reference
from simulators import scene as scenes

# Frames of each scene. All of them are as `sprung new` prints them and last half a second: longer, cloths fold.
SCENES = {"chain 20": 30, "lattice 10": 30, "cloth 32": 30, "cloth 100": 30}
# Of the true motion, computed twice. Tighter ones only cost more: the two agree far below every error here.
REFERENCE_TOLERANCE = 1e-10
# A run that ends farther away than this has failed.
LOST = 3.0


def truth(program, scene):
    """The reference, and how far sprung's own is from it; kept beside what is built."""
    file = CACHE / f"{scene.name.replace(' ', '-')}-{scene.frames}.npz"
    if not file.exists():
        positions = reference.solve(scene, REFERENCE_TOLERANCE)
        own, _ = ours.command(program, scene, "--method", "dop853", "--rtol", REFERENCE_TOLERANCE, "--duration", repr(scene.duration))
        CACHE.mkdir(parents=True, exist_ok=True)
        np.savez(file, positions=positions, difference=scenes.error(own, positions))
    kept = np.load(file)
    return kept["positions"], float(kept["difference"])


def climb(contender, scene, true, known, limit):
    """Runs along the ladder, as far as they are worth their time: times, and errors, join those that are known."""
    least, worse, spent, before = np.inf, 0, 0.0, None
    for setting in contender.settings:
        growth = 2.0 if contender.order == 0 else setting / before if before else 1.0
        if spent * growth > limit or worse > 2:
            return
        point = known.setdefault((scene.name, contender.simulator, contender.method, setting), {"error": None, "ms": []})
        if point["ms"] and point["error"] is None:
            continue
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            positions, spent = contender.run(setting)
            error = scenes.error(positions, true)
        point["error"] = error if error < LOST else None
        point["ms"].append(round(1e3 * spent / scene.frames, 6))
        # Twice as far from the truth as with longer steps, time after time: rounding has taken over.
        worse = worse + 1 if least < 0.1 and error > 2 * least else 0
        least, before = min(least, error), setting
        print(f"  {contender.simulator} {contender.method}, {setting:g}: error {error:.2e}, {point['ms'][-1]:.3g} ms a frame", flush=True)


def measure(program, name, wanted, limit, results):
    scene = scenes.ready(program, name, SCENES[name])
    true, difference = truth(program, scene)
    results["scenes"][name] = {"frames": scene.frames, "particles": len(scene.masses), "springs": len(scene.pairs), "difference": difference}
    known = {tuple(point.pop(key) for key in ("scene", "simulator", "method", "setting")): point for point in results["points"]}
    chosen = lambda simulator: not wanted or any(name.startswith(simulator) for name in wanted)
    found, missing = simulators.installed()
    for peer, why in missing.items():
        print(f"{peer} is left out: {why}", file=sys.stderr)
    contenders = ours.contenders(program, scene) if chosen(ours.NAME) else []
    for peer in found.values():
        results["versions"][peer.NAME] = peer.version()
        if chosen(peer.NAME):
            contenders += peer.contenders(scene)
    print(name, flush=True)
    for contender in contenders:
        title = f"{contender.simulator} {contender.method}"
        results["methods"][title] = {"order": contender.order}
        if not wanted or any(title.startswith(name) for name in wanted):
            climb(contender, scene, true, known, limit)
    results["points"] = [dict(zip(("scene", "simulator", "method", "setting"), key), **point) for key, point in known.items()]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("scene", nargs="?", choices=SCENES)
    arguments.add_argument("names", nargs="*")
    arguments.add_argument("--limit", type=float, default=6.0)
    arguments.add_argument("--page", action="store_true")
    arguments.add_argument("--program", help="a sprung that is built already")
    given = arguments.parse_args()
    results = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"versions": {}, "methods": {}, "scenes": {}, "points": []}
    if not given.page:
        results["measured"] = f"{date.today().isoformat()}, {frames_page.processor()}"
        program = given.program
        if program is None:
            subprocess.run(["cargo", "build", "--release", "--bin", "sprung"], check=True, cwd=ROOT)
            program = ROOT / "target" / "release" / "sprung"
        results["versions"][ours.NAME] = ours.version(program)
        for name in [given.scene] if given.scene else SCENES:
            measure(program, name, given.names, given.limit, results)
            points = ",\n".join(map(json.dumps, results["points"]))
            head = json.dumps({key: value for key, value in results.items() if key != "points"})
            RESULTS.write_text(f'{head[:-1]}, "points": [\n{points}\n]}}\n')
    sys.exit(1 if frames_page.write(results, RESULTS.parent) else 0)


if __name__ == "__main__":
    main()
