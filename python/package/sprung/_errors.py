"""What is raised where a computation breaks down; unusable arguments are plain ``ValueError``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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


class NotPositiveDefinite(np.linalg.LinAlgError):
    """A matrix that was to be factored is not positive definite, or has a pivot of zero.

    Attributes
    ----------
    row : int
        The row of the matrix whose pivot stopped the factorization.
    particle, axis : int
        The coordinate of that row.
    """

    def __init__(self, message: str, row: int, particle: int, axis: int) -> None:
        super().__init__(message)
        self.row = row
        self.particle = particle
        self.axis = axis


class DoubtWarning(UserWarning):
    """A run came to its end and is doubtful; the message names the cause."""
