"""A scene as every simulator here needs it: arrays in SI units, with doubles.

sprung's stiffness k is a force per unit strain, f = k (l/l0 - 1); the others want force per length, k/l0. Damping is the
same with all of them: b in N s/m times the rate at which the spring's length changes, along the spring.
"""

import json
import subprocess
from dataclasses import dataclass

import numpy as np

# Frames a second; a run is a whole number of frames, a step a whole fraction of one.
RATE = 60


@dataclass(frozen=True)
class Scene:
    name: str
    text: str
    frames: int
    gravity: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    pairs: np.ndarray
    stiffness: np.ndarray
    rest_lengths: np.ndarray
    damping: np.ndarray
    held: np.ndarray

    @property
    def duration(self):
        return self.frames / RATE

    @property
    def per_length(self):
        """Stiffness in N/m."""
        return self.stiffness / self.rest_lengths


def ready(sprung, name, frames):
    """The ready scene `sprung new KIND --size N` of a name such as "cloth 32", for some frames."""
    kind, size = name.split()
    text = subprocess.run([sprung, "new", kind, "--size", size, "--json"], check=True, stdout=subprocess.PIPE, text=True).stdout
    return read(name, text, frames)


def read(name, text, frames):
    """A scene from its JSON, for some frames."""
    data = json.loads(text)
    particles, springs = data["particles"], data["springs"]
    positions = np.array(particles["positions"], float)
    count, pairs = len(positions), np.array(springs["pairs"])
    each = lambda value, size: np.broadcast_to(np.asarray(value, float), size).copy()
    lengths = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    constraints = data.get("constraints") or []
    if positions.shape[1] < 3 or any(set(entry) - {"particles", "axes"} or len(entry.get("axes", "xyz")) < 3 for entry in constraints):
        raise ValueError(f"{name}: particles in space that are held, in all directions, are all that is converted")
    held = np.zeros(count, bool)
    for entry in constraints:
        held[entry["particles"]] = True
    return Scene(name, text, frames, np.array(data.get("gravity") or np.zeros(3), float), positions,
                 np.array(particles.get("velocities") or np.zeros((count, 3)), float), each(particles["masses"], count), pairs,
                 each(springs["stiffness"], len(pairs)), each(springs["rest_lengths"], len(pairs)) if springs.get("rest_lengths") is not None
                 else lengths, each(springs.get("damping") or 0.0, len(pairs)), held)


def error(positions, reference):
    """Relative position error: both norms over all coordinates, the denominator about the centroid of the reference."""
    distance = np.linalg.norm(positions - reference)
    return float(distance / np.linalg.norm(reference - reference.mean(axis=0)))
