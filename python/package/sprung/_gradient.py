"""Gradients through runs and equilibria."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays, _native
from ._arrays import Floats
from ._errors import DoubtWarning
from ._state import State

if TYPE_CHECKING:
    from ._system import System


class Gradient:
    """The derivatives of a number by the parameters of a scene.

    Attributes
    ----------
    stiffness, rest_lengths, damping : ndarray, shape (springs,)
        By k, l0 and b of every spring.
    masses : ndarray, shape (particles,)
    gravity : ndarray, shape (dimension,)
    loads : ndarray, shape (particles, dimension)
        By a constant force on every particle.
    positions, velocities : ndarray, shape (particles, dimension)
        By those of the start; for held and moved coordinates by a shift of the whole path.
    """

    def __init__(self, handed: tuple[Floats, ...]) -> None:
        self.stiffness, self.rest_lengths, self.damping, self.masses = handed[:4]
        self.gravity, self.loads, self.positions, self.velocities = handed[4:]

    def __repr__(self) -> str:
        return f"<Gradient by {len(self.stiffness)} springs and {len(self.masses)} particles>"


class DifferentiableRun:
    """A run whose end, and whatever was on the way, can be differentiated.

    Attributes
    ----------
    system : System
    state : State
        At the end.
    times : ndarray, shape (states,)
    positions, velocities : ndarray, shape (states, particles, dimension)
        After every step, beginning with the start; of a run with fewer checkpoints than steps the first and the last.
    """

    status = "completed"

    def __init__(self, system: System, native: Any) -> None:
        self.system = system
        self._native = native
        times, positions, velocities = native.states()
        shape = (len(times), len(system.masses), system.dimension)
        self.times: Floats = times
        self.positions: Floats = positions.reshape(shape)
        self.velocities: Floats = velocities.reshape(shape)
        self.state = State(self.positions[-1], self.velocities[-1], float(times[-1]))

    @property
    def steps(self) -> int:
        """Steps done."""
        return self._native.steps()

    def gradient(
        self,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        *,
        records: Sequence[tuple[int, ArrayLike | None, ArrayLike | None]] = (),
        check: bool = True,
    ) -> Gradient:
        """The derivatives of a cost J by all parameters, exact for the numbers that this run computed.

        Parameters
        ----------
        positions, velocities : array_like, shape (particles, dimension), optional
            The derivatives of J by the last state; zero where absent.
        records : sequence of (step, positions, velocities), optional
            The same for states on the way, by the number of the step; ``None`` for zero.
        check : bool
            Whether to warn where the motion magnifies differences so much that the gradient means nothing; it takes
            one more run.

        Warns
        -----
        DoubtWarning
            With the time from which on the motion is not predictable.
        """
        width = self.system.dimension
        zero = np.zeros((len(self.system.masses), width))

        def rows(name: str, value: ArrayLike | None) -> Floats:
            found = zero if value is None else _arrays.rows(name, value, width=width)
            if found.shape != zero.shape:
                raise ValueError(f"{name} = an array of shape {found.shape}: must have shape {zero.shape}")
            return found

        given = [(self.steps, rows("positions", positions), rows("velocities", velocities))]
        for number, (step, x, v) in enumerate(records):
            if isinstance(step, bool) or not isinstance(step, (int, np.integer)) or not 0 <= step <= self.steps:
                raise ValueError(f"records[{number}] = step {step!r}: must be a step from 0 to {self.steps}")
            given.append((int(step), rows(f"records[{number}].positions", x), rows(f"records[{number}].velocities", v)))
        found = Gradient(self._native.gradient(given))
        until = self._native.predictable_until() if check else None
        if until is not None:
            message = f"the motion magnifies differences to its own size from t = {until:.6g} s on: beyond, gradients mean nothing"
            warnings.warn(message, DoubtWarning, stacklevel=2)
        return found

    def __repr__(self) -> str:
        return f"<DifferentiableRun of {self.steps} steps to t = {self.state.time:.6g} s>"
