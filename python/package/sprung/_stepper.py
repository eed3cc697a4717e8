"""Time stepping."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from typing import Any

from . import _arrays, _native
from ._errors import Breakdown, DoubtWarning
from ._gradient import DifferentiableRun
from ._result import Result
from ._state import State
from ._system import System


class Stepper:
    """A system in motion: a state, and the method that leads on from it.

    Parameters
    ----------
    system : System
    state : State, optional
        Where to start; by default the system's initial state. It is copied.
    method : str, optional
        ``"linear-backward-euler"``, ``"backward-euler"``, ``"bdf2"``, ``"w2"``, ``"rodas4"``,
        ``"implicit-midpoint"``, ``"verlet"``, ``"dop853"``, ``"forward-euler"``, ``"symplectic-euler"``, or ``"auto"``.
        By default what the command takes: ``"linear-backward-euler"`` for steps of a given length, ``"rodas4"`` for
        adaptive ones, a choice of its own for a required accuracy.
    stiffness : {"on-demand", "full", "tension", "axial"}, optional
        Which part of every spring's stiffness enters the matrix; forces are never changed.
    solver : {"auto", "llt", "ldlt", "cg", "cg-assembled"}, optional
    preconditioner : {"auto", "none", "jacobi", "block-jacobi", "multigrid"}, optional
    tolerance : float, optional
        Conjugate gradients stop at ``|b - A dx| <= tolerance |b|``; 1e-10.

    Notes
    -----
    Results have the same bits as those of the command ``sprung run``, for any number of threads.

    Examples
    --------
    >>> import sprung
    >>> stepper = sprung.Stepper(sprung.System.ready("pendulum"), method="bdf2")
    >>> for _ in range(10):
    ...     stepper.step(0.001)
    >>> round(stepper.state.time, 12)
    0.01
    """

    def __init__(
        self,
        system: System,
        state: State | None = None,
        *,
        method: str | None = None,
        stiffness: str | None = None,
        solver: str | None = None,
        preconditioner: str | None = None,
        tolerance: float | None = None,
    ) -> None:
        self.system = system
        self._method = method
        given = system._given(state)
        self._native = _native.Stepper(system._native, given, method, stiffness, solver, preconditioner, tolerance)

    @property
    def state(self) -> State:
        """A copy of the state that the stepper has come to; assigning one goes on from there."""
        return State._of(self._native.state())

    @state.setter
    def state(self, state: State) -> None:
        self._native.set_state(state._given())

    @property
    def statistics(self) -> dict[str, Any]:
        """Work and residuals of all single steps so far."""
        return json.loads(self._native.statistics())

    def step(self, dt: float) -> None:
        """One step of ``dt`` seconds.

        The method keeps its memory from step to step, such as a factorization or older states.

        Raises
        ------
        Breakdown
            When the step cannot be done; the state is then as it was.
        """
        failed = self._native.step(_arrays.positive("dt", dt))
        if failed is not None:
            status, message = failed
            raise Breakdown(message, status)

    def run(
        self,
        duration: float,
        *,
        dt: float | None = None,
        rtol: float | None = None,
        accuracy: float | None = None,
        callback: Callable[[int, State], Any] | None = None,
        every: int = 1,
        allow_unstable: bool = False,
        differentiable: bool = False,
        checkpoints: int | None = None,
    ) -> Any:
        """Run from the state for a time, and leave the stepper at its end.

        The method begins anew, as that of a run of the command does.

        Parameters
        ----------
        duration : float
            In s; the run ends exactly there, with a shorter last step where ``dt`` does not divide it.
        dt : float, optional
            Length of the steps, in s; with ``rtol`` the first step to try, and the interval of records, which lie
            between the method's own steps (dense output). With neither, steps are adaptive with ``rtol=1e-2``, and
            there are 300 records, whatever the duration.
        rtol : float, optional
            Adaptive steps whose local errors are so small that positions at the end are wrong by about ``rtol`` times
            their distance from their centroid. For ``"bdf2"``, ``"w2"``, ``"rodas4"`` and ``"dop853"``.
        accuracy : float, optional
            Runs are made until two that could disagree agree to this relative position error; the last is the answer.
        callback : callable, optional
            Called as ``callback(number, state)`` at every frame, in this thread; it may raise ``StopIteration`` to end
            the run in order. Not with ``accuracy``, which makes several runs.
        every : int
            A frame is kept of every so many records, beside the first and the last state.
        allow_unstable : bool
            Go on where energy appears from nowhere.
        differentiable : bool
            Keep what gradients through the run need, and return a :class:`DifferentiableRun`: for methods
            ``"backward-euler"``, ``"implicit-midpoint"``, ``"bdf2"`` and ``"verlet"`` with steps ``dt``. Steps are
            solved to rounding, by sparse Cholesky.
        checkpoints : int, optional
            With ``differentiable`` the number of states to keep at most; others are computed again when a gradient needs
            them, to the same bits. By default as many as half of the memory holds.

        Returns
        -------
        Result
            A :class:`DifferentiableRun` with ``differentiable``.

        Raises
        ------
        Breakdown
            When the run does not come to its end; ``result`` has what came before, and the stepper is at the last
            good state.
        KeyboardInterrupt
            On Ctrl-C; the stepper is then at the state of the last step, or with ``accuracy`` where it was.

        Warns
        -----
        DoubtWarning
            Where the run itself finds that it may be wrong, or that an accuracy could not be confirmed.
        """
        if differentiable:
            if rtol is not None or accuracy is not None or callback is not None:
                raise ValueError("differentiable: takes steps dt, and neither rtol, accuracy nor callback")
            return self._run_differentiable(duration, dt, checkpoints)
        if checkpoints is not None:
            raise ValueError("checkpoints: are those of a run with differentiable=True")
        if accuracy is not None and rtol is not None:
            raise ValueError("accuracy and rtol: must have at most one of the two")
        if accuracy is not None and callback is not None:
            raise ValueError("callback: has no run to follow, accuracy makes several")
        if isinstance(every, bool) or not isinstance(every, int) or every < 1:
            raise ValueError(f"every = {every!r}: must be a positive integer")
        handed = _native.run(
            self._native,
            _arrays.number("duration", duration),
            None if dt is None else _arrays.positive("dt", dt),
            None if rtol is None else _arrays.number("rtol", rtol),
            None if accuracy is None else _arrays.number("accuracy", accuracy),
            bool(allow_unstable),
            every,
            None if callback is None else lambda number, state: callback(number, State._of(state)),
        )
        result = Result(self.system, handed)
        if result.status not in ("completed", "interrupted", "unconfirmed"):
            failure = result.summary["failure"]
            where = f"{result.status} in step {failure['step']}, at t = {failure['time']:.6g} s"
            raise Breakdown(f"{where}: {failure['message']}", result.status, result)
        for warning in result.warnings:
            warnings.warn(warning, DoubtWarning, stacklevel=2)
        return result

    def _run_differentiable(self, duration: float, dt: float | None, checkpoints: int | None) -> DifferentiableRun:
        if self._method is None:
            raise ValueError("method: must be named for a gradient, such as \"backward-euler\"")
        if checkpoints is not None and (isinstance(checkpoints, bool) or not isinstance(checkpoints, int) or checkpoints < 2):
            raise ValueError(f"checkpoints = {checkpoints!r}: must be an integer, at least 2")
        step, time = self.system._step(dt), _arrays.number("duration", duration)
        given = self.state._given()
        native = _native.differentiable_run(self.system._native, given, self._method, step, time, checkpoints)
        run = DifferentiableRun(self.system, native)
        self.state = run.state
        return run

    def __repr__(self) -> str:
        return f"<Stepper of {self.system.name!r} at t = {self.state.time:.6g} s>"
