"""Exceptions and warnings of steps and runs. Invalid arguments raise ``ValueError``."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._result import Result


class Breakdown(RuntimeError):
    """A step or a run broke down.

    Attributes
    ----------
    status : str
        ``"indefinite"``, ``"not-converged"``, ``"non-finite"``, ``"degenerate-spring"`` or ``"unstable"`` (energy
        appeared without cause).
    result : Result or None
        The run up to the last good state, which is also that of the stepper. ``None`` for a single step and a differentiable run.
    """

    def __init__(self, message: str, status: str, result: Result | None = None) -> None:
        super().__init__(message)
        self.status = status
        self.result = result


class DoubtWarning(UserWarning):
    """A completed run is doubtful; the message names the cause."""
