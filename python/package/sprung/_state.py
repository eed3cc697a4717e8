"""States and their energies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
from ._arrays import Floats

#: Positions, velocities and time for the native module.
Given = tuple[Floats, Floats, float]


class Energy(NamedTuple):
    """The energies of a state, in J."""

    #: ``sum(m v**2 / 2)``, prescribed particles included.
    kinetic: float
    #: ``sum(k (l - l0)**2 / (2 l0))`` over all springs.
    elastic: float
    #: ``-sum(m gravity . x)``, zero at the origin.
    gravitational: float

    @property
    def total(self) -> float:
        """The total energy."""
        return self.kinetic + self.elastic + self.gravitational


class State:
    """Positions and velocities of all particles at one time.

    The arrays may be modified. Computations do not change a state.

    Parameters
    ----------
    positions : array_like, shape (particles, dimension)
        In m.
    velocities : array_like, shape (particles, dimension), optional
        In m/s; default zero.
    time : float
        In s.
    """

    __slots__ = ("positions", "time", "velocities")

    def __init__(self, positions: ArrayLike, velocities: ArrayLike | None = None, time: float = 0.0) -> None:
        self.positions: Floats = _arrays.rows("positions", positions)
        if velocities is None:
            self.velocities: Floats = np.zeros_like(self.positions)
        else:
            self.velocities = _arrays.rows("velocities", velocities, width=self.positions.shape[1])
        self.time = _arrays.number("time", time)

    @classmethod
    def _of(cls, handed: Given) -> State:
        state = cls.__new__(cls)
        state.positions, state.velocities, state.time = handed
        return state

    def _given(self) -> Given:
        width = self.positions.shape[1] if getattr(self.positions, "ndim", 0) == 2 else None
        return (
            _arrays.rows("positions", self.positions),
            _arrays.rows("velocities", self.velocities, width=width),
            _arrays.number("time", self.time),
        )

    def copy(self) -> State:
        """A copy."""
        positions, velocities, time = self._given()
        return State._of((positions.copy(), velocities.copy(), time))

    def __repr__(self) -> str:
        return f"<State of {len(self.positions)} particles at t = {self.time:.6g} s>"
