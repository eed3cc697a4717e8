"""Results of runs."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays, _native
from ._arrays import Floats
from ._html import framed
from ._state import State

if TYPE_CHECKING:
    from ._system import System

#: Columns of the energies, as in ``energy.csv``.
_COLUMNS = ("kinetic", "elastic", "gravitational", "total", "work", "dissipated", "imbalance")


class Result:
    """A run: frames, energies, error estimate and work.

    Attributes
    ----------
    system : System
    state : State
        At the end.
    times : ndarray, shape (frames,)
        In s.
    positions, velocities : ndarray, shape (frames, particles, dimension)
        In m and m/s.
    energies : dict of ndarray
        ``time`` and, in J, ``kinetic``, ``elastic``, ``gravitational`` and ``total``; ``work`` done by moving
        constraints, ``dissipated`` by damping, and the remaining ``imbalance``, at every record.
    summary : dict
        The content of ``summary.json``.
    """

    def __init__(self, system: System, handed: dict[str, Any]) -> None:
        self.system = system
        self.summary: dict[str, Any] = json.loads(handed["summary"])
        self.state: State = State._of(handed["state"])
        self.times: Floats = handed["times"]
        self.positions: Floats = handed["positions"]
        self.velocities: Floats = handed["velocities"]
        self.energies: dict[str, Floats] = {"time": handed["record_times"]}
        self.energies.update(zip(_COLUMNS, handed["energies"].T))

    @property
    def status(self) -> str:
        """``"completed"``, ``"interrupted"`` by a callback, ``"unconfirmed"``, or the cause of a breakdown."""
        return self.summary["status"]

    @property
    def steps(self) -> int:
        """The number of completed steps."""
        return self.summary["steps"]

    @property
    def error(self) -> float | None:
        """The estimated relative position error at the end; ``None`` if unknown.

        It is accurate to about a factor of ten if ``error_kind`` is ``"indicator"``, and confirmed by another run if ``"confirmed"``.
        """
        return None if self.summary["error"] is None else self.summary["error"]["estimate"]

    @property
    def error_kind(self) -> str | None:
        """``"indicator"`` or ``"confirmed"``."""
        return None if self.summary["error"] is None else self.summary["error"]["kind"]

    @property
    def warnings(self) -> list[str]:
        """Reasons for doubt, as text."""
        return self.summary["warnings"]

    @property
    def reactions(self) -> Floats:
        """Forces with which constraints act at the end, in N, shape (particles, dimension); see ``System.reactions``."""
        return self.system.reactions(self.state)

    @property
    def work(self) -> dict[str, int]:
        """Counts of force evaluations, assemblies, factorizations, solves and iterations."""
        return self.summary["work"]

    def at(self, times: ArrayLike) -> Floats:
        """Positions at any times of the run, in m, by cubic Hermite interpolation of frames (fourth order).

        Parameters
        ----------
        times : float or array_like
            In s, from the first frame to the last.

        Returns
        -------
        ndarray, shape (*times.shape, particles, dimension)
        """
        wanted = _arrays.real("times", times)
        outside = np.flatnonzero(~((wanted.ravel() >= self.times[0]) & (wanted.ravel() <= self.times[-1])))
        if outside.size:
            at = int(outside[0])
            span = f"from {self.times[0]} to {self.times[-1]} s"
            raise ValueError(f"times[{at}] = {wanted.ravel()[at]}: must be within the run, {span}")
        if len(self.times) == 1:
            return np.broadcast_to(self.positions[0], (*wanted.shape, *self.positions.shape[1:])).copy()
        from scipy.interpolate import CubicHermiteSpline

        after = int(np.clip(np.searchsorted(self.times, wanted.max(initial=self.times[0])), 1, len(self.times) - 1))
        before = int(max(np.searchsorted(self.times, wanted.min(initial=self.times[-1]), side="right") - 1, 0))
        used = slice(min(before, after - 1), after + 1)
        return CubicHermiteSpline(self.times[used], self.positions[used], self.velocities[used])(wanted)

    def to_html(self, path: str | os.PathLike[str] | None = None, limit: int = 38_000_000) -> str:
        """A self-contained page that plays the motion in any browser, also written to ``path`` if given.

        Parameters
        ----------
        path : path-like, optional
        limit : int
            The maximum size of the frames, in bytes; beyond it frames are dropped, and the page says so.
        """
        energies = [(name, self.energies[name].tolist()) for name in _COLUMNS]
        page = _native.view(
            self.system._native,
            self.system.name,
            json.dumps(self.summary),
            self.times,
            self.positions,
            self.energies["time"].tolist(),
            energies,
            limit,
        )
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(page)
        return page

    def _repr_html_(self) -> str:
        return framed(self.to_html(limit=4_000_000), 640)

    def __repr__(self) -> str:
        error = "" if self.error is None else f", error about {self.error:.1e} ({self.error_kind})"
        return (
            f"<Result of {self.system.name!r}: {self.status} at t = {self.state.time:.6g} s after {self.steps} "
            f"step{'' if self.steps == 1 else 's'}, "
            f"{len(self.times)} frames{error}>"
        )
