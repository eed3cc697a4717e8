"""sprung, by its command: the processor time of a run less that of one that makes no step (loading and writing)."""

import json
import resource
import statistics
import subprocess
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from .contender import STEPS, Contender, explicit_steps
from .scene import RATE

NAME = "sprung"
TOLERANCES = [1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9]
ACCURACIES = [1e-1, 1e-2, 1e-3, 1e-4, 1e-6]
ORDERS = {"verlet": 2, "linear-backward-euler": 1, "bdf2": 2, "w2": 2}


def version(program):
    return subprocess.run([program, "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout.split()[-1]


def command(program, scene, *arguments):
    """Processor time in s and what is in the output folder; None where the run did not complete."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "scene.json")
        file.write_text(scene.text)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        ended = subprocess.run([program, "run", file, "--threads", "1", "--quiet", "--out", Path(folder, "out"), *map(str, arguments)],
                               stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if ended.returncode == 2:
            raise RuntimeError(ended.stderr)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        positions = json.loads(Path(folder, "out", "final.json").read_text())["positions"]
        summary = json.loads(Path(folder, "out", "summary.json").read_text())
        return np.array(positions) if summary["status"] in ("completed", "unconfirmed") else None, seconds


def contenders(program, scene):
    """Methods of fixed steps, adaptive ones, and the search for an accuracy."""
    def typical(*arguments):
        """The median of as many runs as give a steady one: starting a program takes half a millisecond more or less."""
        positions, seconds = command(program, scene, *arguments)
        again = min(20, int(0.2 / seconds))
        return positions, statistics.median([seconds, *(command(program, scene, *arguments)[1] for _ in range(again))])

    _, idle = typical("--method", "verlet", "--dt", "1e-6", "--steps", 0)

    def run(*arguments):
        positions, seconds = typical(*arguments)
        return np.full_like(scene.positions, np.nan) if positions is None else positions, max(seconds - idle, 1e-5)

    def steps(method, per_frame):
        return run("--method", method, "--dt", repr(1 / (RATE * per_frame)), "--steps", scene.frames * per_frame)

    def tolerance(method, rtol):
        return run("--method", method, "--rtol", rtol, "--duration", repr(scene.duration))

    def accuracy(wanted):
        return run("--accuracy", wanted, "--duration", repr(scene.duration))

    found = [Contender(NAME, method, partial(steps, method), explicit_steps(scene) if method == "verlet" else STEPS, order)
             for method, order in ORDERS.items()]
    found += [Contender(NAME, f"{method}, adaptive", partial(tolerance, method), TOLERANCES, 0) for method in ("rodas4", "dop853")]
    return [*found, Contender(NAME, "--accuracy", accuracy, ACCURACIES, 0)]
