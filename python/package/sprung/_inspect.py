"""Is A positive definite, which springs spoil it, and which step is safe?"""

from __future__ import annotations

import json
import math
import os
from typing import Any, NamedTuple

from . import _native
from ._arrays import Floats
from ._html import framed
from ._state import State
from ._system import System


class Inertia(NamedTuple):
    """How many eigenvalues have each sign."""

    negative: int
    zero: int
    positive: int


class Inspection:
    """What an inspection found.

    Attributes
    ----------
    data : dict
        Everything, as ``sprung inspect --json`` prints it. Steps without limit are ``None``.
    eigenvalues : ndarray
        The lowest eigenvalues of A that were found, ascending, in N/m.
    eigenvectors : ndarray, shape (rows, found)
        Theirs, of length 1, as columns over the free coordinates.
    """

    def __init__(self, native: _native.Inspection) -> None:
        self._native = native
        self.data: dict[str, Any] = json.loads(native.json())
        values, vectors = native.eigenpairs()
        self.eigenvalues: Floats = values
        self.eigenvectors: Floats = vectors.T

    @property
    def dt(self) -> float:
        """The step that was asked about, in s."""
        return self.data["dt"]

    @property
    def stiffness(self) -> str:
        """The option under which A was examined."""
        return self.data["stiffness"]

    @property
    def definite(self) -> bool:
        """Whether A is positive definite."""
        return self.data["definite"]

    @property
    def inertia(self) -> Inertia:
        """Signs of the eigenvalues of A."""
        signs = self.data["inertia"]
        return Inertia(signs["negative"], signs["zero"], signs["positive"])

    @property
    def condition(self) -> float:
        """``max|lambda| / min|lambda|`` of A; infinite where it is singular."""
        value = self.data["condition"]
        return math.inf if value is None else value

    @property
    def critical_dt(self) -> float:
        """The largest step for which A is positive definite at this state, in s; infinite where all are."""
        return _step(self.data["critical_dt"])

    @property
    def stable_dt(self) -> float:
        """The largest step for which linearised backward Euler is stable at this state, in s."""
        return _step(self.data["stable_dt"])

    @property
    def turning_dt(self) -> float:
        """The largest step that turns no spring so far that this stretches or brakes it, in s."""
        return _step(self.data["turning_dt"])

    @property
    def options(self) -> dict[str, dict[str, Any]]:
        """The same figures under ``"full"``, ``"tension"`` and ``"axial"``."""
        return self.data["options"]

    @property
    def culprits(self) -> list[dict[str, Any]]:
        """The springs behind the lowest eigenvalue, worst first: ``spring``, ``particles``, ``strain``, ``share``."""
        return self.data["culprits"]

    def to_html(self, path: str | os.PathLike[str] | None = None) -> str:
        """A page with pictures, which loads nothing; written to ``path`` where one is given."""
        page = self._native.html()
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(page)
        return page

    def __str__(self) -> str:
        return self._native.text()

    def __repr__(self) -> str:
        what = "positive definite" if self.definite else f"{self.inertia.negative} negative eigenvalues"
        return f"<Inspection: A under {self.stiffness} with dt = {self.dt} s: {what}>"

    def _repr_html_(self) -> str:
        return framed(self.to_html(), 640)


def _step(value: float | None) -> float:
    return math.inf if value is None else value


def inspect(
    system: System, state: State | None = None, dt: float | None = None, stiffness: str = "full"
) -> Inspection:
    """Inspect A at a state.

    Parameters
    ----------
    system : System
    state : State, optional
        By default the initial one.
    dt : float, optional
        The step, in s; by default that of the scene file, or 0.01.
    stiffness : {"full", "tension", "axial"}
        The option under which eigenvectors are examined; the figures are given for all three.

    Examples
    --------
    >>> import sprung
    >>> sprung.inspect(sprung.System.ready("column"), dt=0.1).definite
    False
    """
    return Inspection(_native.inspect(system._native, system._given(state), system._step(dt), stiffness))
