"""Parameters of springs from a measured motion or a measured shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arrays
from ._arrays import Floats
from ._errors import Breakdown
from ._gradient import DifferentiableRun
from ._state import State
from ._statics import equilibrium
from ._stepper import Stepper
from ._system import System

#: The parameters that can be fitted, in the order of a change.
_NAMES = ("stiffness", "rest_lengths", "damping")


class Fit:
    """Fitted parameters of springs.

    Attributes
    ----------
    system : System
        The system with the fitted parameters.
    stiffness, rest_lengths, damping : ndarray, shape (springs,)
        Of that system.
    standard_errors : dict of ndarray
        For each fitted parameter its standard errors, shape (springs,), from ``inv(J.T @ J) * sigma**2``. They are infinite where the
        measurements do not determine the parameter.
    covariance : ndarray, shape (unknowns, unknowns)
        Of the unknowns: values by spring, or factors by group.
    residual : ndarray
        Computed minus measured coordinates, in m, in the shape of the measurements; NaN where nothing was measured, and for prescribed
        coordinates, which are left out.
    sigma : float
        The standard deviation of a coordinate: as given, or estimated from the residual.
    cost : float
        Half the sum of squares of the residual, in m**2.
    success : bool
        Whether the search converged.
    message : str
    evaluations : int
        Runs or equilibria computed.
    """

    def __init__(self, system: System, found: dict[str, Any]) -> None:
        self.system = system
        self.stiffness, self.rest_lengths, self.damping = system.stiffness, system.rest_lengths, system.damping
        self.standard_errors: dict[str, Floats] = found["standard_errors"]
        self.covariance: Floats = found["covariance"]
        self.residual: Floats = found["residual"]
        self.sigma: float = found["sigma"]
        self.cost: float = found["cost"]
        self.success: bool = found["success"]
        self.message: str = found["message"]
        self.evaluations: int = found["evaluations"]

    def __repr__(self) -> str:
        state = "converged" if self.success else "not converged"
        return f"<Fit of {', '.join(self.standard_errors)}: {state}, sigma {self.sigma:.3g} m>"


class _Unknowns:
    """The unknowns u, with ``p = scale * u[index]`` for the parameter p of every spring."""

    def __init__(self, system: System, parameters: str | Sequence[str] | Mapping[str, Any]) -> None:
        wanted: dict[str, Any]
        if isinstance(parameters, str):
            wanted = {parameters: "each"}
        elif isinstance(parameters, Mapping):
            wanted = dict(parameters)
        else:
            wanted = dict.fromkeys(parameters, "each")
        if not wanted:
            raise ValueError("parameters = []: must name at least one of stiffness, rest_lengths, damping")
        springs = len(system.pairs)
        self.system = system
        self.parts: dict[str, tuple[NDArray[np.integer], Floats]] = {}
        start, low, size = [], [], []
        count = 0
        for name, kind in wanted.items():
            if name not in _NAMES:
                raise ValueError(f"parameters = {name!r}: must be stiffness, rest_lengths or damping")
            value = getattr(system, name)
            groups: NDArray[np.integer]
            if isinstance(kind, str) and kind == "each":
                groups = np.arange(springs)
            elif isinstance(kind, str) and kind == "common":
                groups = np.zeros(springs, dtype=np.int64)
            elif isinstance(kind, str):
                raise ValueError(f'parameters[{name!r}] = {kind!r}: must be "each", "common", or the group of every spring')
            else:
                groups = _arrays.integers(f"parameters[{name!r}]", kind)
                if groups.shape != (springs,):
                    raise ValueError(f"parameters[{name!r}] = an array of shape {groups.shape}: must have shape {(springs,)}")
                groups = np.unique(groups, return_inverse=True)[1].reshape(springs)
            number = int(groups.max(initial=-1)) + 1
            is_zero = value == 0
            if name != "damping" and is_zero.any():
                at = int(np.flatnonzero(is_zero)[0])
                raise ValueError(f"{name}[{at}] = 0.0: must be positive to be fitted")
            own = np.bincount(groups, minlength=number) == 1
            # A factor on what the springs of a group have; the value itself for a group of one spring, and where it starts from zero.
            by_value = own[groups] | is_zero
            scale = np.where(by_value, 1.0, value)
            first = np.ones(number)
            first[groups[by_value]] = value[by_value]
            self.parts[name] = (groups + count, scale)
            start.append(first)
            low.append(np.zeros(number) if name == "damping" else 1e-6 * first)
            size.append(np.where(first > 0, first, max(float(value.mean()), 1.0) if value.any() else 1.0))
            count += number
        self.start, self.low, self.size = np.concatenate(start), np.concatenate(low), np.concatenate(size)

    def __len__(self) -> int:
        return len(self.start)

    def value(self, name: str, unknowns: Floats) -> Floats:
        index, scale = self.parts[name]
        return scale * unknowns[index]

    def system_at(self, unknowns: Floats) -> System:
        return self.system.with_springs(**{name: self.value(name, unknowns) for name in self.parts})

    def derivative(self, by_spring: Mapping[str, Floats]) -> Floats:
        """The derivative by the unknowns from those by the parameters of every spring."""
        found = np.zeros(len(self))
        for name, (index, scale) in self.parts.items():
            np.add.at(found, index, scale * by_spring[name])
        return found

    def changes(self) -> list[dict[str, Floats]]:
        """For every unknown the change of the parameters."""
        springs = len(self.system.pairs)
        found = [{name: np.zeros(springs) for name in _NAMES} for _ in range(len(self))]
        for name, (index, scale) in self.parts.items():
            for spring, unknown in enumerate(index):
                found[unknown][name][spring] = scale[spring]
        return found


class _Motion:
    """A model of the positions of some particles after some steps."""

    def __init__(self, unknowns: _Unknowns, measured: NDArray[np.bool_], particles: NDArray[np.integer], **how: Any) -> None:
        self.unknowns, self.measured, self.particles = unknowns, measured, particles
        self.state, self.method, self.dt, self.steps = how["state"], how["method"], how["dt"], how["steps"]

    def run(self, unknowns: Floats) -> DifferentiableRun:
        stepper = Stepper(self.unknowns.system_at(unknowns), self.state, method=self.method)
        found = stepper.run(self.dt * int(self.steps[-1]), dt=self.dt, differentiable=True)
        assert isinstance(found, DifferentiableRun)
        if len(found.times) <= found.steps:
            raise MemoryError("the states of all steps do not fit the memory: fit a shorter motion")
        return found

    def output(self, run: DifferentiableRun) -> Floats:
        return run.positions[self.steps][:, self.particles]

    def jacobian(self, run: DifferentiableRun) -> Floats:
        outputs = np.argwhere(self.measured)
        if len(self.unknowns) <= len(outputs):
            zeros = [np.zeros(shape) for shape in run._shapes()]
            changes = [(*(change[name] for name in _NAMES), *zeros[3:]) for change in self.unknowns.changes()]
            ascending, back = np.unique(self.steps, return_inverse=True)
            moved = run._tangents(changes, ascending.tolist())[0][:, back.reshape(-1)][:, :, self.particles]
            return moved[:, self.measured].T
        rows = []
        for record, particle, axis in outputs:
            cotangent = np.zeros((len(run.system.masses), run.system.dimension))
            cotangent[self.particles[particle], axis] = 1.0
            found = run.gradient(records=[(int(self.steps[record]), cotangent, None)], check=False)
            rows.append(self.unknowns.derivative(vars(found)))
        return np.array(rows)


class _Shape:
    """A model of the positions of some particles at equilibrium."""

    def __init__(self, unknowns: _Unknowns, measured: NDArray[np.bool_], particles: NDArray[np.integer], state: State | None) -> None:
        self.unknowns, self.measured, self.particles = unknowns, measured, particles
        self.state = unknowns.system.initial_state() if state is None else state

    def run(self, unknowns: Floats) -> Any:
        found = equilibrium(self.unknowns.system_at(unknowns), self.state)
        if found.status != "stable":
            raise ValueError(f"the equilibrium is {found.status!r}: a fit needs a stable one")
        # The next search begins here.
        self.state = found.state
        return found

    def output(self, found: Any) -> Floats:
        return found.positions[self.particles]

    def jacobian(self, found: Any) -> Floats:
        rows = []
        for particle, axis in np.argwhere(self.measured):
            cotangent = np.zeros(found.positions.shape)
            cotangent[self.particles[particle], axis] = 1.0
            rows.append(self.unknowns.derivative(vars(found.gradient(cotangent))))
        return np.array(rows)


def fit(
    system: System,
    measurements: ArrayLike,
    parameters: str | Sequence[str] | Mapping[str, Any] = "stiffness",
    *,
    times: ArrayLike | None = None,
    steps: ArrayLike | None = None,
    particles: ArrayLike | None = None,
    method: str = "implicit-midpoint",
    dt: float | None = None,
    state: State | None = None,
    sigma: float | None = None,
    **options: Any,
) -> Fit:
    """Fit parameters of springs to a measured motion or to a measured equilibrium, by least squares with exact Jacobians.

    Parameters
    ----------
    system : System
        Its parameters are where the search starts.
    measurements : array_like
        Positions in m: of a motion with shape (times, particles, dimension); without ``times`` and ``steps``, of an equilibrium with
        shape (particles, dimension). NaN where nothing was measured.
    parameters : str, sequence or mapping
        Any of ``"stiffness"``, ``"rest_lengths"`` and ``"damping"``. A mapping says for each whether every spring has its own value,
        ``"each"``, or all have one ``"common"`` factor on what the system has; an array of integers puts springs with the same number
        into one group with a common factor.
    times : array_like, optional
        Times of the measurements in s, from the time of the state on; each must be a whole number of steps.
    steps : array_like of int, optional
        Instead of times, numbers of steps of ``dt``.
    particles : array_like of int, optional
        The measured particles; by default all.
    method : {"implicit-midpoint", "backward-euler", "bdf2", "verlet"}
        Of the motion.
    dt : float, optional
        Its step in s; by default that of the scene, or 0.01.
    state : State, optional
        The start of the motion, or where the search for the equilibrium starts; by default the initial state.
    sigma : float, optional
        The standard deviation of a measured coordinate; by default estimated from the residual.
    **options
        For :func:`scipy.optimize.least_squares`, such as ``max_nfev`` or ``loss``.

    Returns
    -------
    Fit

    Raises
    ------
    ValueError
        For wrong arguments, and where the first run or equilibrium fails.

    Notes
    -----
    A Jacobian costs one linear solve a step for each unknown, by tangents, or for each measured coordinate, by gradients, whichever are
    fewer; of an equilibrium one gradient for each measured coordinate. The search finds the nearest minimum: the motion of many periods
    has many.

    Examples
    --------
    >>> import numpy as np
    >>> import sprung
    >>> made = dict(positions=[[0.0], [1.2]], pairs=[[0, 1]], masses=1.0, rest_lengths=1.0, constraints=[sprung.Constraint(0)])
    >>> truth = sprung.Stepper(sprung.System(stiffness=20.0, **made), method="implicit-midpoint").run(1.0, dt=0.01, differentiable=True)
    >>> found = sprung.fit(sprung.System(stiffness=10.0, **made), truth.positions[::10], steps=range(0, 101, 10), dt=0.01)
    >>> found.stiffness.round(6).tolist()
    [20.0]
    """
    from scipy.optimize import least_squares

    unknowns = _Unknowns(system, parameters)
    measured = _arrays.real("measurements", measurements)
    count = len(system.masses)
    chosen = np.arange(count) if particles is None else _arrays.integers("particles", particles)
    if chosen.ndim != 1 or ((chosen < 0) | (chosen >= count)).any():
        raise ValueError(f"particles = {np.asarray(chosen).tolist()}: must be a list of particles from 0 to {count - 1}")
    shape: tuple[int, ...] = (len(chosen), system.dimension)
    how: dict[str, Any] = {}
    if times is not None or steps is not None:
        step = system._step(dt)
        begin = (system.initial_state() if state is None else state).time
        numbers = _steps(times, steps, step, begin)
        shape = (len(numbers), *shape)
        how = {"state": state, "method": method, "dt": step, "steps": numbers}
    if measured.shape != shape:
        raise ValueError(f"measurements = an array of shape {measured.shape}: must have shape {shape}")
    # Prescribed coordinates depend on no parameter, and say nothing about the noise.
    is_free = np.zeros((count, system.dimension), dtype=bool)
    is_free[system.dofs[:, 0], system.dofs[:, 1]] = True
    is_known = np.isfinite(measured) & is_free[chosen]
    if np.isinf(measured).any() or not is_known.any():
        raise ValueError("measurements: must be finite, or NaN where nothing was measured, and hold a free coordinate")
    if sigma is not None:
        sigma = _arrays.positive("sigma", sigma)
    model: _Motion | _Shape = _Motion(unknowns, is_known, chosen, **how) if how else _Shape(unknowns, is_known, chosen, state)
    known: dict[str, Any] = {"at": None, "run": None, "jacobian": None}

    def run(values: Floats) -> Any:
        if known["at"] is None or not np.array_equal(known["at"], values):
            known.update(run=model.run(values), at=values.copy(), jacobian=None)
        return known["run"]

    def jacobian(values: Floats) -> Floats:
        found = run(values)
        if known["jacobian"] is None:
            known["jacobian"] = model.jacobian(found)
        return known["jacobian"]

    def difference(values: Floats) -> Floats:
        try:
            return (model.output(run(values)) - measured)[is_known]
        except (ValueError, Breakdown):
            if known["at"] is None:
                raise
            # The search goes back and takes a shorter step.
            return np.full(np.count_nonzero(is_known), np.inf)

    options = {"x_scale": unknowns.size, "bounds": (unknowns.low, np.inf), "xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, **options}
    difference(unknowns.start)
    # Robust losses scale the Jacobian in its place.
    found = least_squares(difference, unknowns.start, jac=lambda values: jacobian(values).copy(), **options)

    residual = np.full(measured.shape, np.nan)
    residual[is_known] = difference(found.x)
    squares = float(np.nansum(residual**2))
    if sigma is None:
        freedom = np.count_nonzero(is_known) - len(unknowns)
        sigma = float(np.sqrt(squares / freedom)) if freedom > 0 else np.nan
    covariance, deviation = _covariance(jacobian(found.x) * unknowns.size, sigma)
    covariance *= np.outer(unknowns.size, unknowns.size)
    deviation *= unknowns.size
    return Fit(
        unknowns.system_at(found.x),
        {
            "standard_errors": {name: unknowns.value(name, deviation) for name in unknowns.parts},
            "covariance": covariance,
            "residual": residual,
            "sigma": sigma,
            "cost": 0.5 * squares,
            "success": bool(found.success),
            "message": str(found.message),
            "evaluations": int(found.nfev),
        },
    )


def _steps(times: ArrayLike | None, steps: ArrayLike | None, dt: float, begin: float) -> NDArray[np.int64]:
    if times is not None and steps is not None:
        raise ValueError("times and steps: must have one of the two")
    if times is not None:
        exact = (np.atleast_1d(_arrays.real("times", times)) - begin) / dt
        numbers = np.rint(exact).astype(np.int64)
        wrong = np.flatnonzero(np.abs(exact - numbers) > 1e-6)
        if wrong.size:
            at = int(wrong[0])
            raise ValueError(f"times[{at}]: must be a whole number of steps of {dt:.6g} s from the start at {begin:.6g} s")
    else:
        assert steps is not None
        numbers = np.atleast_1d(_arrays.integers("steps", np.asarray(steps))).astype(np.int64)
    if numbers.ndim != 1 or numbers.size == 0 or (numbers < 0).any() or (np.diff(numbers) <= 0).any():
        raise ValueError("times, steps: must be a list that ascends from the start")
    return numbers


def _covariance(jacobian: Floats, sigma: float) -> tuple[Floats, Floats]:
    """``inv(J.T @ J) * sigma**2`` and standard deviations, infinite for unknowns that J does not determine."""
    # R of J = QR has the singular values and the right singular vectors of J, and is no longer than there are unknowns.
    _, values, rows = np.linalg.svd(np.linalg.qr(jacobian, mode="r"), full_matrices=True)
    order = jacobian.shape[1]
    padded = np.zeros(order)
    padded[: len(values)] = values
    kept = padded > max(jacobian.shape) * np.finfo(float).eps * padded.max(initial=0.0)
    scaled = rows[kept] / padded[kept, np.newaxis]
    covariance = sigma**2 * (scaled.T @ scaled)
    deviation = np.sqrt(np.diag(covariance))
    open_ones = (rows[~kept] ** 2).sum(axis=0) > 1e-12
    deviation[open_ones] = np.inf
    covariance[open_ones] = np.inf
    covariance[:, open_ones] = np.inf
    return covariance, deviation
