"""What is raised where a step or a run breaks down, or is doubtful; unusable arguments are plain ``ValueError``."""

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
        appeared from nowhere).
    result : Result or None
        Of a run: everything up to the last good state, which the stepper has, too. ``None`` for a single step.
    """

    def __init__(self, message: str, status: str, result: Result | None = None) -> None:
        super().__init__(message)
        self.status = status
        self.result = result


class DoubtWarning(UserWarning):
    """A run came to its end and is doubtful; the message names the cause."""
