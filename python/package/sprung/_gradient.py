"""Gradients through runs and equilibria."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
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
            Whether to warn where the motion magnifies errors so much that the gradient means nothing; it takes one more run.

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
            message = (
                f"from t = {until:.6g} s on errors are as large as the motion itself: "
                "gradients of later states are exact for the computed numbers, but say nothing about the scene"
            )
            warnings.warn(message, DoubtWarning, stacklevel=2)
        return found

    def tangent(
        self,
        *,
        stiffness: ArrayLike | None = None,
        rest_lengths: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        masses: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        loads: ArrayLike | None = None,
        positions: ArrayLike | None = None,
        velocities: ArrayLike | None = None,
        steps: Sequence[int] | None = None,
    ) -> tuple[Floats, Floats]:
        """How the motion changes, to first order, when parameters change: forward differentiation.

        One tangent gives the derivatives of all outputs along one change. One gradient gives those of one output by all parameters.

        Parameters
        ----------
        stiffness, rest_lengths, damping, masses, gravity, loads, positions, velocities : array_like, optional
            The change of each parameter, in the shape of :class:`Gradient`; zero where absent.
        steps : sequence of int, optional
            Numbers of steps, ascending; by default the last one.

        Returns
        -------
        positions, velocities : ndarray, shape (steps, particles, dimension)
            The changes of the states after these steps.
        """
        given = {
            "stiffness": stiffness,
            "rest_lengths": rest_lengths,
            "damping": damping,
            "masses": masses,
            "gravity": gravity,
            "loads": loads,
            "positions": positions,
            "velocities": velocities,
        }
        change = []
        for (name, value), shape in zip(given.items(), self._shapes()):
            array = np.zeros(shape) if value is None else _arrays.real(name, value)
            if array.shape != shape:
                raise ValueError(f"{name} = an array of shape {array.shape}: must have shape {shape}")
            change.append(array)
        found = self._tangents([tuple(change)], [self.steps] if steps is None else steps)
        return found[0][0], found[1][0]

    def _shapes(self) -> list[tuple[int, ...]]:
        springs, particles, width = len(self.system.pairs), len(self.system.masses), self.system.dimension
        return [*3 * [(springs,)], (particles,), (width,), *3 * [(particles, width)]]

    def _tangents(self, changes: list[tuple[Floats, ...]], steps: Sequence[int]) -> tuple[Floats, Floats]:
        """By changes, steps, particles and axes."""
        numbers = [int(step) for step in _arrays.integers("steps", np.asarray(steps))]
        if any(not 0 <= step <= self.steps for step in numbers) or any(a >= b for a, b in zip(numbers, numbers[1:])):
            raise ValueError(f"steps = {numbers}: must ascend, from 0 to at most {self.steps}")
        flat = [(*(list(part) for part in change[:5]), *map(np.ascontiguousarray, change[5:])) for change in changes]
        positions, velocities = self._native.tangents(flat, numbers)
        shape = (len(changes), len(numbers), len(self.system.masses), self.system.dimension)
        return positions.reshape(shape), velocities.reshape(shape)

    def __repr__(self) -> str:
        return f"<DifferentiableRun of {self.steps} steps to t = {self.state.time:.6g} s>"
