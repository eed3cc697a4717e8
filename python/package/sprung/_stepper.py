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
    """A system in motion: a state and a time stepping method.

    Parameters
    ----------
    system : System
    state : State, optional
        The initial state, which is copied; default that of the system.
    method : str, optional
        ``"linear-backward-euler"``, ``"backward-euler"``, ``"bdf2"``, ``"w2"``, ``"rodas4"``,
        ``"implicit-midpoint"``, ``"verlet"``, ``"dop853"``, ``"forward-euler"``, ``"symplectic-euler"``, or ``"auto"``.
        The defaults are those of the command: ``"linear-backward-euler"`` for fixed steps, ``"dop853"`` or ``"rodas4"`` by the
        stiffness of the scene for adaptive ones, and an automatic choice for a required accuracy.
    stiffness : {"on-demand", "progressive", "full", "tension", "axial", "absolute"}, optional
        The stiffness that enters the matrix; forces do not depend on it.
    solver : {"auto", "llt", "ldlt", "cg", "cg-assembled"}, optional
    preconditioner : {"auto", "none", "jacobi", "block-jacobi", "multigrid"}, optional
    tolerance : float, optional
        Conjugate gradients stop at ``|b - A dx| <= tolerance |b|``; default 1e-10.

    Notes
    -----
    Results have the same bits as those of ``sprung run``, for any number of threads.

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
        """A copy of the current state; assign a state to continue from there."""
        return State._of(self._native.state())

    @state.setter
    def state(self, state: State) -> None:
        self._native.set_state(state._given())

    @property
    def statistics(self) -> dict[str, Any]:
        """Work and residuals of all single steps."""
        return json.loads(self._native.statistics())

    def step(self, dt: float) -> None:
        """Take one step of ``dt`` seconds.

        The method keeps its history between steps, such as a factorization or earlier states.

        Raises
        ------
        Breakdown
            If the step fails; the state does not change.
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
        """Run from the current state, and keep the final one.

        The method restarts, as in a run of the command.

        Parameters
        ----------
        duration : float
            In s; the last step is shorter if ``dt`` does not divide it.
        dt : float, optional
            The step, in s; with ``rtol`` the first step and the interval of records (dense output). Without ``dt`` and ``rtol``,
            steps are adaptive with ``rtol=1e-2``, and there are 300 records.
        rtol : float, optional
            The tolerance of adaptive steps: the relative position error at the end is about ``rtol``. For ``"bdf2"``, ``"w2"``, ``"rodas4"`` and ``"dop853"``.
        accuracy : float, optional
            The required relative position error at the end, confirmed by a second run.
        callback : callable, optional
            Called as ``callback(number, state)`` at every frame, in this thread; raise ``StopIteration`` to end the run. Not with
            ``accuracy``, which makes several runs.
        every : int
            The number of records per frame; the first and the last state are always frames.
        allow_unstable : bool
            Continue if energy appears without cause.
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
            If the run breaks down; ``result`` contains the motion before, and the stepper has the last good state. With
            ``differentiable`` there is no ``result``, and the stepper keeps its state.
        ValueError
            For wrong arguments; with ``differentiable`` also for methods and systems without a gradient.
        KeyboardInterrupt
            On Ctrl-C; the stepper then has the state of the last step, or with ``accuracy`` or ``differentiable`` its previous one.

        Warns
        -----
        DoubtWarning
            If the run is doubtful, or an accuracy could not be confirmed.
        """
        if differentiable:
            if rtol is not None or accuracy is not None or callback is not None:
                raise ValueError("differentiable: takes steps dt, and neither rtol, accuracy nor callback")
            return self._run_differentiable(duration, dt, checkpoints)
        if checkpoints is not None:
            raise ValueError("checkpoints: are those of a run with differentiable=True")
        if accuracy is not None and rtol is not None:
            raise ValueError("accuracy and rtol: give only one of the two")
        if accuracy is not None and callback is not None:
            raise ValueError("callback: has no run to follow, accuracy makes several")
        every = _arrays.count("every", every)
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
        checkpoints = None if checkpoints is None else _arrays.count("checkpoints", checkpoints, least=2)
        step, time = self.system._step(dt), _arrays.number("duration", duration)
        given = self.state._given()
        native = _native.differentiable_run(self.system._native, given, self._method, step, time, checkpoints)
        run = DifferentiableRun(self.system, native)
        self.state = run.state
        return run

    def __repr__(self) -> str:
        return f"<Stepper of {self.system.name!r} at t = {self.state.time:.6g} s>"
