"""The verification suite on a system."""

from __future__ import annotations

import json
import os
from typing import Any

from . import _arrays, _native
from ._html import framed
from ._state import State
from ._system import System


class Verification:
    """Every check that applies to a system, each a measured value held to a bound.

    Attributes
    ----------
    passed, failed : int
        Numbers of checks.
    checks : list of dict
        ``name``, ``claim``, ``value``, ``bound``, ``passed`` and ``why`` the bound is what it is.
    not_judged : list of dict
        ``name``, ``claim`` and ``why``: what the numbers of this system do not allow to be judged, with the reason.
    dt : float
        The step with which the system was checked, in s.
    """

    def __init__(self, handed: dict[str, Any]) -> None:
        report = json.loads(handed["json"])
        self.passed: int = report["passed"]
        self.failed: int = report["failed"]
        self.checks: list[dict[str, Any]] = report["checks"]
        self.not_judged: list[dict[str, Any]] = report["not_judged"]
        self.dt: float = handed["dt"]
        self._text: str = handed["text"]
        self._html: str = handed["html"]

    @property
    def failures(self) -> list[dict[str, Any]]:
        """The checks that failed."""
        return [check for check in self.checks if not check["passed"]]

    def __bool__(self) -> bool:
        return self.failed == 0

    def to_html(self, path: str | os.PathLike[str] | None = None) -> str:
        """The report as a page, which loads nothing; written to ``path`` where one is given."""
        if path is not None:
            with open(path, "w", encoding="utf-8") as file:
                file.write(self._html)
        return self._html

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"<Verification: {self.passed} checks passed, {self.failed} failed>"

    def _repr_html_(self) -> str:
        return framed(self._html, 640)


def verify(system: System, dt: float | None = None, state: State | None = None) -> Verification:
    """Hold forces to their energy, matrices to the forces, steps to their equations, methods to their order.

    Parameters
    ----------
    system : System
    dt : float, optional
        The step, in s; by default that of the scene file, or one that resolves every vibration.
    state : State, optional
        By default the initial one.
    """
    step = None if dt is None else _arrays.positive("dt", dt)
    return Verification(_native.verify(system._native, system._given(state), step))
