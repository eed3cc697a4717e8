"""What is measured: a method of a simulator, with a ladder of settings from coarse to fine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .scene import RATE

# Steps a frame: halved twice an octave, so that nobody is held to a step much shorter than it needs.
STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096)


@dataclass(frozen=True)
class Contender:
    """`run(setting)` gives positions at the end and the processor time in s that the steps took."""

    simulator: str
    method: str
    run: Callable[[float], tuple[np.ndarray, float]]
    settings: Sequence[float] = STEPS
    # Order in the length of the step; 0 where the setting is a tolerance.
    order: int = 1


def explicit_steps(scene):
    """The part of the ladder where an explicit method can be stable.

    No vibration is faster than ω² = max 2 Σ κ / m, the sum over the springs at a particle of mass m (Gershgorin's theorem),
    and ω dt may be 2 with Euler's and Verlet's methods, 2.8 with RK4; the bound is at most some three times too large.
    """
    sums = np.bincount(scene.pairs.ravel(), np.repeat(scene.per_length, 2), len(scene.masses))
    fastest = np.sqrt((2 * sums / scene.masses)[~scene.held].max())
    return tuple(steps for steps in STEPS if fastest / (RATE * steps) < 6)
