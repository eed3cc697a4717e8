"""Definiteness of A, the springs that affect it, and step limits."""

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
    """The numbers of eigenvalues of each sign."""

    negative: int
    zero: int
    positive: int


class Inspection:
    """The result of an inspection.

    Attributes
    ----------
    data : dict
        The output of ``sprung inspect --json``. Steps without limit are ``None``.
    eigenvalues : ndarray
        The computed lowest eigenvalues of A, ascending, in N/m.
    eigenvectors : ndarray, shape (rows, found)
        Unit eigenvectors, as columns over the free coordinates.
    """

    def __init__(self, native: _native.Inspection) -> None:
        self._native = native
        self.data: dict[str, Any] = json.loads(native.json())
        values, vectors = native.eigenpairs()
        self.eigenvalues: Floats = values
        self.eigenvectors: Floats = vectors.T

    @property
    def dt(self) -> float:
        """The step, in s."""
        return self.data["dt"]

    @property
    def stiffness(self) -> str:
        """The stiffness option of the examined A."""
        return self.data["stiffness"]

    @property
    def definite(self) -> bool:
        """True if A is positive definite."""
        return self.data["definite"]

    @property
    def inertia(self) -> Inertia:
        """The signs of the eigenvalues of A."""
        signs = self.data["inertia"]
        return Inertia(signs["negative"], signs["zero"], signs["positive"])

    @property
    def condition(self) -> float:
        """``max|lambda| / min|lambda|`` of A; infinite if it is singular."""
        value = self.data["condition"]
        return math.inf if value is None else value

    @property
    def critical_dt(self) -> float:
        """The largest step for which A is positive definite at this state, in s; infinite if A is for every step."""
        return _step(self.data["critical_dt"])

    @property
    def stable_dt(self) -> float:
        """The largest step for which linearised backward Euler is stable at this state, in s."""
        return _step(self.data["stable_dt"])

    @property
    def turning_dt(self) -> float:
        """The largest step within the rotation limit of all springs, in s."""
        return _step(self.data["turning_dt"])

    @property
    def options(self) -> dict[str, dict[str, Any]]:
        """The same results under ``"full"``, ``"tension"``, ``"axial"`` and ``"absolute"``."""
        return self.data["options"]

    @property
    def culprits(self) -> list[dict[str, Any]]:
        """The springs that cause the lowest eigenvalue, worst first: ``spring``, ``particles``, ``strain``, ``share``."""
        return self.data["culprits"]

    def to_html(self, path: str | os.PathLike[str] | None = None) -> str:
        """A self-contained page with pictures, also written to ``path`` if given."""
        page = self._native.html()
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(page)
        return page

    def __str__(self) -> str:
        return self._native.text()

    def __repr__(self) -> str:
        what = "positive definite" if self.definite else f"{self.inertia.negative} negative eigenvalues"
        return f"<Inspection: A under {self.stiffness} with dt = {self.dt:.6g} s: {what}>"

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
    stiffness : {"full", "tension", "axial", "absolute"}
        The option of the eigenvectors; other results are given for all.

    Examples
    --------
    >>> import sprung
    >>> sprung.inspect(sprung.System.ready("column"), dt=0.1).definite
    False
    """
    return Inspection(_native.inspect(system._native, system._given(state), system._step(dt), stiffness))
