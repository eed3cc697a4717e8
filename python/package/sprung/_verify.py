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
    """All checks that apply to a system, each a measured value with a bound.

    Attributes
    ----------
    passed, failed : int
        The numbers of checks.
    checks : list of dict
        ``name``, ``claim``, ``value``, ``bound``, ``passed`` and ``why``, the reason for the bound.
    not_judged : list of dict
        ``name``, ``claim`` and ``why``: checks that rounding does not allow on this system, with the reason.
    dt : float
        The step of the checks, in s.
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
        """The report as a self-contained page, also written to ``path`` if given."""
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
    """Check forces against energies, matrices against forces, steps against their equations, and methods against their order.

    Parameters
    ----------
    system : System
    dt : float, optional
        The step, in s; default that of the scene file, or one that resolves every vibration.
    state : State, optional
        By default the initial one.
    """
    step = None if dt is None else _arrays.positive("dt", dt)
    return Verification(_native.verify(system._native, system._given(state), step))
