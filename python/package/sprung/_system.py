"""Systems, states and constraints."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import LinearOperator

from . import _arrays, _native
from ._arrays import Floats
from ._html import framed
from ._matrices import Factor, Matrices, linear_operator

Given = tuple[Floats, Floats, float]


class Energy(NamedTuple):
    """The energy of a state by kind, in J."""

    #: ``sum(m v**2 / 2)``, prescribed particles included.
    kinetic: float
    #: ``sum(k (l - l0)**2 / (2 l0))`` over all springs.
    elastic: float
    #: ``-sum(m gravity . x)``, zero at the origin.
    gravitational: float

    @property
    def total(self) -> float:
        """The sum of all kinds."""
        return self.kinetic + self.elastic + self.gravitational


class State:
    """Positions and velocities of all particles at one time.

    The arrays belong to numpy and may be changed; what computes with a state reads it and changes nothing.

    Parameters
    ----------
    positions : array_like, shape (particles, dimension)
        In m.
    velocities : array_like, shape (particles, dimension), optional
        In m/s; at rest where it is absent.
    time : float
        In s.
    """

    __slots__ = ("positions", "time", "velocities")

    def __init__(self, positions: ArrayLike, velocities: ArrayLike | None = None, time: float = 0.0) -> None:
        self.positions: Floats = _arrays.rows("positions", positions)
        if velocities is None:
            self.velocities: Floats = np.zeros_like(self.positions)
        else:
            self.velocities = _arrays.rows("velocities", velocities, width=self.positions.shape[1])
        self.time = _arrays.number("time", time)

    @classmethod
    def _of(cls, handed: Given) -> State:
        state = cls.__new__(cls)
        state.positions, state.velocities, state.time = handed
        return state

    def _given(self) -> Given:
        width = self.positions.shape[1] if getattr(self.positions, "ndim", 0) == 2 else None
        return (
            _arrays.rows("positions", self.positions),
            _arrays.rows("velocities", self.velocities, width=width),
            _arrays.number("time", self.time),
        )

    def copy(self) -> State:
        """A state of its own."""
        positions, velocities, time = self._given()
        return State._of((positions.copy(), velocities.copy(), time))

    def __repr__(self) -> str:
        return f"<State of {len(self.positions)} particles at t = {self.time} s>"


@dataclass(frozen=True)
class Constraint:
    """Particles whose coordinates along some axes are prescribed; later constraints override earlier ones.

    Parameters
    ----------
    particles : int or array_like of int
        The kinematic particles.
    axes : str or sequence of str, optional
        The prescribed axes, as ``"xy"`` or ``["x", "y"]``; absent: all.
    velocity : array_like, optional
        In m/s: ``x(t) = x(0) + t velocity``.
    path : (times, offsets) or mapping with these keys, optional
        ``x(t) = x(0) + offset(t)``, piecewise linear and clamped at both ends; times in s, one row in m for each.
        With neither a velocity nor a path the coordinates are held.
    """

    particles: Any
    axes: Union[str, Sequence[str], None] = None
    velocity: Any = None
    path: Any = None

    def _given(self, index: int, particles: int, dimension: int) -> tuple[Any, ...]:
        key = f"constraints[{index}]"
        numbers = np.atleast_1d(_arrays.integers(f"{key}.particles", self.particles))
        wrong = np.flatnonzero((numbers.ravel() < 0) | (numbers.ravel() >= particles))
        if wrong.size:
            at = int(wrong[0])
            raise ValueError(
                f"{key}.particles[{at}] = {int(numbers.ravel()[at])}: names a particle that does not exist "
                f"(there are {particles})"
            )
        axes = None if self.axes is None else [_axis(key, at, axis, dimension) for at, axis in enumerate(self.axes)]
        if self.velocity is not None and self.path is not None:
            raise ValueError(f"{key} = velocity and path: must have at most one of the two")
        velocity = path = None
        if self.velocity is not None:
            velocity = _vector(f"{key}.velocity", self.velocity, dimension)
        if self.path is not None:
            path = _path(f"{key}.path", self.path, dimension)
        return numbers.ravel().tolist(), axes, velocity, path


def _axis(key: str, at: int, axis: str, dimension: int) -> int:
    number = "xyz".find(axis) if isinstance(axis, str) and len(axis) == 1 else -1
    if not 0 <= number < dimension:
        known = ", ".join("xyz"[:dimension])
        raise ValueError(f"{key}.axes[{at}] = {axis!r}: must be one of {known}")
    return number


def _vector(key: str, value: ArrayLike, dimension: int) -> list[float]:
    vector = _arrays.real(key, value)
    if vector.shape != (dimension,):
        raise ValueError(f"{key} = an array of shape {vector.shape}: must have length {dimension}, as the positions")
    return [*vector.tolist(), *[0.0] * (3 - dimension)]


def _path(key: str, path: Any, dimension: int) -> tuple[list[float], list[list[float]]]:
    if isinstance(path, Mapping):
        unknown = sorted(set(path) - {"times", "offsets"})
        if unknown or len(path) != 2:
            raise ValueError(f"{key} = {sorted(path)}: must have the keys times and offsets")
        path = path["times"], path["offsets"]
    try:
        times, offsets = path
    except (TypeError, ValueError):
        raise ValueError(f"{key} = {path!r}: must be (times, offsets)") from None
    times = np.atleast_1d(_arrays.real(f"{key}.times", times)).ravel()
    offsets = _arrays.rows(f"{key}.offsets", offsets, of="time", width=dimension)
    absent = np.zeros((len(offsets), 3 - dimension))
    return times.tolist(), np.hstack([offsets, absent]).tolist()


class System:
    """A mass-spring system: everything that does not change while it moves.

    Every value is checked; a system is valid by construction.

    Parameters
    ----------
    positions : array_like, shape (particles, dimension)
        ``x(0)`` in m; rows of 2 or 1 make a planar or one-dimensional system.
    pairs : array_like of int, shape (springs, 2)
        End points of every spring.
    masses : float or array_like, shape (particles,)
        In kg.
    stiffness : float or array_like, shape (springs,)
        k in N, the force per unit strain: ``f = k (l/l0 - 1)``.
    rest_lengths : float or array_like, shape (springs,), optional
        l0 in m; absent: the initial distances.
    damping : float or array_like, shape (springs,)
        In N s/m, along the spring.
    velocities : array_like, shape (particles, dimension), optional
        ``v(0)`` in m/s; absent: at rest.
    gravity : array_like, shape (dimension,), optional
        An acceleration, in m/s**2; absent: none.
    constraints : iterable of Constraint or mapping
        Kinematic particles; mappings have the keys of a scene file.
    name : str
        For reports.

    Raises
    ------
    ValueError
        For the first value that breaks a rule, with argument, index and value.

    Examples
    --------
    >>> import sprung
    >>> system = sprung.System([[0, 0], [1, 0]], [[0, 1]], masses=1.0, stiffness=10.0, constraints=[sprung.Constraint(0)])
    >>> system
    <System 'system': 2 particles, 1 spring, 2 degrees of freedom>
    """

    def __init__(
        self,
        positions: ArrayLike,
        pairs: ArrayLike = (),
        *,
        masses: ArrayLike,
        stiffness: ArrayLike | None = None,
        rest_lengths: ArrayLike | None = None,
        damping: ArrayLike = 0.0,
        velocities: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        constraints: Iterable[Constraint | Mapping[str, Any]] = (),
        name: str = "system",
    ) -> None:
        places = _arrays.rows("positions", positions)
        count, dimension = places.shape
        moving = np.zeros_like(places) if velocities is None else velocities
        moving = _arrays.rows("velocities", moving, width=dimension)
        if len(moving) != count:
            raise ValueError(f"velocities = an array of shape {moving.shape}: must have the shape {places.shape}")
        ends = _arrays.pairs("pairs", pairs, count)
        springs = len(ends)
        if stiffness is None:
            if springs:
                raise ValueError(f"stiffness = absent: must be given, one number for all {springs} springs or one for each")
            stiffness = 1.0
        entries = [entry if isinstance(entry, Constraint) else _constraint(at, entry) for at, entry in enumerate(constraints)]
        self._native = _native.System.from_arrays(
            str(name),
            places,
            moving,
            _arrays.each("masses", masses, count, "particles"),
            ends,
            _arrays.each("stiffness", stiffness, springs, "springs"),
            None if rest_lengths is None else _arrays.each("rest_lengths", rest_lengths, springs, "springs"),
            _arrays.each("damping", damping, springs, "springs", zero=True),
            [0.0] * 3 if gravity is None else _vector("gravity", gravity, dimension),
            [entry._given(at, count, dimension) for at, entry in enumerate(entries)],
        )

    @classmethod
    def _of(cls, native: _native.System) -> System:
        system = cls.__new__(cls)
        system._native = native
        return system

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> System:
        """Read a scene file, TOML or JSON by its extension.

        Raises
        ------
        ValueError
            For a file that does not follow the format or breaks a rule, with file, key, index and value.
        OSError
            For a file that cannot be read.
        """
        return cls._of(_native.System.load(os.fspath(path)))

    @classmethod
    def parse(cls, text: str, format: str = "toml") -> System:
        """Read the text of a scene file, ``"toml"`` or ``"json"``."""
        return cls._of(_native.System.parse(text, format))

    @classmethod
    def ready(cls, kind: str, size: int | None = None) -> System:
        """A ready scene, as ``sprung new KIND --size N`` prints it.

        Parameters
        ----------
        kind : {"chain", "cloth", "lattice", "column", "pendulum", "string", "network"}
        size : int, optional
            Particles along a side, links, joints or bobs; absent: one that shows what the kind is about.
        """
        return cls._of(_native.System.ready(kind, size))

    def to_toml(self, state: State | None = None) -> str:
        """The system as a scene file that starts at a state, by default the initial one."""
        return self._native.write(self._given(state), "toml")

    def to_json(self, state: State | None = None) -> str:
        """As :meth:`to_toml`, as JSON."""
        return self._native.write(self._given(state), "json")

    def save(self, path: str | os.PathLike[str], state: State | None = None) -> None:
        """Write a scene file, TOML or JSON by its extension, for the command ``sprung`` or :meth:`load`."""
        name = os.fspath(path)
        if not name.endswith((".toml", ".json")):
            raise ValueError(f"path = {name!r}: a scene file must end in .toml or .json")
        text = self.to_json(state) if name.endswith(".json") else self.to_toml(state)
        with open(name, "w", encoding="utf-8") as file:
            file.write(text)

    @property
    def name(self) -> str:
        """The scene's name."""
        return self._native.name

    @property
    def dimension(self) -> int:
        """Number of modelled axes: 1, 2 or 3."""
        return self._native.dimension

    @cached_property
    def masses(self) -> Floats:
        """Mass of every particle, in kg. A copy, as all arrays of a system are."""
        return self._native.masses

    @cached_property
    def pairs(self) -> NDArray[np.uint32]:
        """End points of every spring, shape (springs, 2)."""
        return self._native.pairs

    @cached_property
    def _springs(self) -> list[Floats]:
        return self._native.springs

    @property
    def stiffness(self) -> Floats:
        """k of every spring, in N."""
        return self._springs[0]

    @property
    def rest_lengths(self) -> Floats:
        """l0 of every spring, in m."""
        return self._springs[1]

    @property
    def damping(self) -> Floats:
        """Damping of every spring, in N s/m."""
        return self._springs[2]

    @cached_property
    def gravity(self) -> Floats:
        """The acceleration of gravity, in m/s**2."""
        return np.array(self._native.gravity)

    @property
    def time_settings(self) -> tuple[float | None, float | None]:
        """``time.dt`` and ``time.duration`` of the scene file, in s, where it has them."""
        return self._native.time

    @cached_property
    def dofs(self) -> NDArray[np.int64]:
        """Particle and axis (0, 1, 2) of every row of the matrices, shape (rows, 2): the coordinates that are free."""
        particles, axes = self._native.dofs
        return np.column_stack([particles, axes.astype(np.int64)])

    def initial_state(self) -> State:
        """The state that the system starts from, to be changed as one likes."""
        return State._of(self._native.start())

    def _given(self, state: State | None) -> Given:
        return self._native.start() if state is None else state._given()

    def gather(self, full: ArrayLike) -> Floats:
        """The free coordinates of an array of shape (particles, dimension), in the order of the matrices' rows."""
        array = _arrays.rows("full", full, width=self.dimension)
        return array[self.dofs[:, 0], self.dofs[:, 1]]

    def scatter(self, reduced: ArrayLike, full: ArrayLike | None = None) -> Floats:
        """An array of shape (particles, dimension) with the free coordinates set; the others are those of ``full``, or zero."""
        values = _arrays.real("reduced", reduced)
        if values.shape != (len(self.dofs),):
            raise ValueError(f"reduced = an array of shape {values.shape}: must have the {len(self.dofs)} free coordinates")
        shape = (len(self.masses), self.dimension)
        array = np.zeros(shape) if full is None else _arrays.rows("full", full, width=self.dimension).copy()
        array[self.dofs[:, 0], self.dofs[:, 1]] = values
        return array

    def force(self, state: State | None = None, kind: str = "all") -> Floats:
        """Forces on all particles, in N.

        Parameters
        ----------
        state : State, optional
            By default the initial one.
        kind : {"all", "elastic", "damping", "weight"}

        Returns
        -------
        ndarray, shape (particles, dimension)
        """
        return self._native.force(self._given(state), kind)

    def energy(self, state: State | None = None) -> Energy:
        """Energies of a state, by default the initial one, in J."""
        return Energy(*self._native.energy(self._given(state)))

    def matrices(self, state: State | None = None, dt: float | None = None, stiffness: str = "full") -> Matrices:
        """Everything of the linear system ``A dx = b`` of a step, over the free coordinates.

        Parameters
        ----------
        state : State, optional
            By default the initial one.
        dt : float
            The step, in s; by default that of the scene file, or 0.01.
        stiffness : {"full", "tension", "axial"}
            Which part of every spring's stiffness enters K and A: all of it, without the transverse terms of
            compressed springs, or without any transverse terms.

        Returns
        -------
        Matrices

        Notes
        -----
        ``A = M/dt**2 - G/dt - K``, ``b = M v/dt + M gravity + f_elastic - A_fc dx_c``, with the prescribed motion moved
        to the right-hand side.
        """
        return Matrices(self, self._given(state), self._step(dt), stiffness)

    def operator(
        self, state: State | None = None, dt: float | None = None, stiffness: str = "full", matrix: str = "A"
    ) -> LinearOperator:
        """Products with A, M, G or K spring by spring, without a matrix.

        Parameters
        ----------
        state, dt, stiffness
            As for :meth:`matrices`.
        matrix : {"A", "M", "G", "K"}
        """
        return linear_operator(self, self._given(state), self._step(dt), stiffness, matrix)

    def factor(
        self, state: State | None = None, dt: float | None = None, stiffness: str = "full", kind: str = "llt"
    ) -> Factor:
        """A, factored; see :meth:`Matrices.factor`."""
        return self.matrices(state, dt, stiffness).factor(kind)

    def _step(self, dt: float | None) -> float:
        return _arrays.positive("dt", self.time_settings[0] or 0.01 if dt is None else dt)

    def __reduce__(self) -> tuple[Any, ...]:
        return System.parse, (self.to_json(), "json")

    def __repr__(self) -> str:
        def count(number: int, what: str) -> str:
            return f"{number} {what}" if number == 1 else f"{number} {what}s"

        parts = count(len(self.masses), "particle"), count(len(self.pairs), "spring")
        rows = self._native.order
        return f"<System {self.name!r}: {', '.join(parts)}, {rows} degree{'' if rows == 1 else 's'} of freedom>"

    def _repr_html_(self) -> str:
        start = self.initial_state()
        page = _native.view(self._native, self.name, [], np.zeros(1), start.positions[np.newaxis], [], 4_000_000)
        return framed(page, 480)


def _constraint(index: int, entry: Any) -> Constraint:
    if not isinstance(entry, Mapping):
        raise ValueError(f"constraints[{index}] = {entry!r}: must be a Constraint or a mapping")
    unknown = sorted(set(entry) - {"particles", "axes", "velocity", "path"})
    if unknown:
        raise ValueError(f"constraints[{index}] = {unknown[0]!r}: unknown key")
    if "particles" not in entry:
        raise ValueError(f"constraints[{index}].particles = absent: must be given")
    return Constraint(**entry)
