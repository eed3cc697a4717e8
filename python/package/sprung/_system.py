"""Mass-spring systems, and their forces, energies and matrices at a state."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator
from scipy.spatial import KDTree

from . import _arrays, _functions, _native
from ._arrays import Floats
from ._constraint import Constraint, actuation as actuated, constraint, curve, vector, vectors
from ._functions import ExternalForce
from ._html import framed
from ._matrices import Factor, Matrices, linear_operator
from ._state import Energy, Given, State


#: The edges of cells by their meshio names.
_EDGES = {
    "line": [(0, 1)],
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quad": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    "pyramid": [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)],
    "wedge": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "hexahedron": [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
}


def _warn(notes: Iterable[str]) -> None:
    """Warns the caller of a method of the class."""
    for note in notes:
        warnings.warn(note, UserWarning, stacklevel=3)


def _sets(count: int, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """The first point of the set of every point, as pairs join them."""
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    labels = connected_components(joined, directed=False)[1]
    return np.unique(labels, return_index=True)[1][labels]


def _welded(points: Floats, pairs: NDArray[np.int64], distance: float) -> tuple[Floats, NDArray[np.int64]]:
    """The first of the points that are no farther apart, and the pairs by their numbers."""
    distance = _arrays.number("weld", distance)
    if not (np.isfinite(distance) and distance >= 0):
        raise ValueError(f"weld = {distance!r}: must be finite and not negative")
    if not np.isfinite(points).all():
        return points, pairs
    kept, numbers = np.unique(_sets(len(points), KDTree(points).query_pairs(distance, output_type="ndarray")), return_inverse=True)
    return points[kept], numbers[pairs]


def _notes(points: Floats, pairs: NDArray[np.int64]) -> list[str]:
    """Loose parts, coincident and unused points, as for the mesh of a scene file."""
    notes = []
    used = np.zeros(len(points), dtype=bool)
    used[pairs] = True
    parts = len(np.unique(_sets(len(points), pairs)[used]))
    if parts > 1:
        notes.append(f"the mesh is {parts} loose parts, which no edge joins")
    coincident = len(points) - len(np.unique(points, axis=0))
    if coincident:
        lie = "1 vertex lies" if coincident == 1 else f"{coincident} vertices lie"
        notes.append(f"{lie} where another does; weld = 0 joins them")
    unused = np.flatnonzero(~used)
    if len(unused) == 1:
        notes.append(f"particle {unused[0]} is in no edge: it moves on its own")
    elif len(unused):
        notes.append(f"{len(unused)} particles are in no edge (the first is {unused[0]}): they move on their own")
    return notes


def _rows_for(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    rows = _arrays.rows(name, value, width=shape[1])
    if rows.shape != shape:
        raise ValueError(f"{name} = an array of shape {rows.shape}: must have the shape {shape}")
    return rows


class System:
    """An immutable mass-spring system, valid by construction.

    Parameters
    ----------
    positions : array_like, shape (particles, dimension)
        ``x(0)`` in m; rows of 2 or 1 make a planar or one-dimensional system.
    pairs : array_like of int, shape (springs, 2)
        End points of every spring.
    masses : float or array_like, shape (particles,)
        In kg.
    stiffness : float or array_like, shape (springs,)
        k in N, the force per unit strain: ``f = k (l/l0 - 1)``; in N/m, ``f = k l``, where the rest length is zero.
    rest_lengths : float or array_like, shape (springs,), optional
        l0 in m, not negative; default: the initial distances.
    damping : float or array_like, shape (springs,)
        In N s/m, along the spring.
    velocities : array_like, shape (particles, dimension), optional
        ``v(0)`` in m/s; default: at rest.
    tension_only : bool or array_like of bool, shape (springs,)
        Springs that exert no force while shorter than at rest.
    actuation : iterable of mapping
        Rest lengths that change in time, as in a scene file: ``{"springs": [0, 1], "path": {"times": [0, 1], "factors": [1, 1.2]}}``;
        times in s.
    gravity : array_like, shape (dimension,), or (times, values), optional
        The gravitational acceleration, in m/s**2; default: none. With times in s it is piecewise linear and clamped at both ends;
        a mapping has the keys ``times`` and ``values``.
    loads : array_like, shape (particles, dimension), optional
        Constant forces on the particles, in N.
    drag : float or array_like, shape (particles,)
        c of the force ``-c v`` on every particle, in N s/m.
    constraints : iterable of Constraint or mapping
        Kinematic constraints; mappings have the keys of a scene file.
    forces : iterable of ExternalForce or callable
        External forces, see :class:`ExternalForce`; a callable is a force without derivatives.
    spring_law : callable, optional
        The law of all springs in place of ``T = k (l/l0 - 1)``, see :meth:`with_spring_law`.
    name : str
        The name in reports.

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
        tension_only: ArrayLike = False,
        actuation: Iterable[Mapping[str, Any]] = (),
        velocities: ArrayLike | None = None,
        gravity: Any = None,
        loads: ArrayLike | None = None,
        drag: ArrayLike = 0.0,
        constraints: Iterable[Constraint | Mapping[str, Any]] = (),
        forces: Iterable[ExternalForce | Callable[..., Any]] = (),
        spring_law: Callable[..., Any] | None = None,
        name: str = "system",
    ) -> None:
        places = _arrays.rows("positions", positions)
        count, dimension = places.shape
        moving = _rows_for("velocities", np.zeros_like(places) if velocities is None else velocities, places.shape)
        ends = _arrays.pairs("pairs", pairs, count)
        springs = len(ends)
        if stiffness is None:
            if springs:
                raise ValueError(f"stiffness: must be given, one number for all or one for {_arrays.items(springs, 'springs')}")
            stiffness = 1.0
        entries = [constraint(at, entry) for at, entry in enumerate(constraints)]
        path = None
        if isinstance(gravity, Mapping) or (isinstance(gravity, tuple) and len(gravity) == 2 and np.ndim(gravity[1]) == 2):
            times, values = curve("gravity", gravity, "values")
            path = times, vectors("gravity.values", values, dimension)
        self._native = _native.System.from_arrays(
            str(name),
            places,
            moving,
            _arrays.each("masses", masses, count, "particles"),
            ends,
            _arrays.each("stiffness", stiffness, springs, "springs"),
            None if rest_lengths is None else _arrays.each("rest_lengths", rest_lengths, springs, "springs", zero=True),
            _arrays.each("damping", damping, springs, "springs", zero=True),
            [0.0] * 3 if gravity is None or path else vector("gravity", gravity, dimension),
            [entry._given(at, count, dimension) for at, entry in enumerate(entries)],
        ).with_loads(
            None if loads is None else _rows_for("loads", loads, places.shape),
            _arrays.each("drag", drag, count, "particles", zero=True),
            path,
            _arrays.flags("tension_only", tension_only, springs, "springs"),
            [actuated(at, entry) for at, entry in enumerate(actuation)],
        )
        given = _functions.forces(forces, 0, count, dimension)
        self._native, self._forces = self._native.with_functions(given, None), len(given)
        if spring_law is not None:
            self._native = self.with_spring_law(spring_law)._native

    @classmethod
    def _of(cls, native: _native.System, forces: int = 0) -> System:
        system = cls.__new__(cls)
        system._native = native
        system._forces = forces
        return system

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> System:
        """Read a scene file: TOML, JSON or NumPy arrays (``.npz``) by its extension.

        Raises
        ------
        ValueError
            For a file that does not follow the format or breaks a rule, with file, key, index and value.
        OSError
            For a file that cannot be read.

        Warns
        -----
        UserWarning
            Of loose parts, coincident and unused vertices of its mesh.
        """
        native, notes = _native.System.load(os.fspath(path))
        _warn(notes)
        return cls._of(native)

    @classmethod
    def from_meshio(
        cls, mesh: str | os.PathLike[str] | Any, *, masses: ArrayLike, weld: float | None = None, **parameters: Any
    ) -> System:
        """A system from a mesh of the package ``meshio``: points become particles, and each edge of a cell becomes one spring.

        Parameters
        ----------
        mesh : path-like or meshio.Mesh
            Lines, triangles, quadrilaterals, polygons, tetrahedra, pyramids, wedges and hexahedra are supported; vertices are ignored.
            ``meshio`` leaves out the lines of OBJ files; a scene file with ``[mesh]`` has them.
        masses, **parameters
            As for the class.
        weld : float, optional
            Joins points that are no farther apart, in m, directly or through others; the first of them stays. Zero joins coincident ones.

        Raises
        ------
        ImportError
            For a path, if ``meshio`` is not installed.
        ValueError
            For a file that ``meshio`` cannot read, no points, cells with curved edges, and invalid values.

        Warns
        -----
        UserWarning
            Of loose parts, coincident and unused points.
        """
        name = "the mesh"
        if isinstance(mesh, (str, os.PathLike)):
            import meshio

            name = os.fspath(mesh)
            try:
                mesh = meshio.read(mesh)
            # For some files meshio ends the program.
            except (SystemExit, meshio.ReadError) as error:
                reason = str(error).strip() if isinstance(error, meshio.ReadError) else ""
                raise ValueError(f"{name}: meshio cannot read it{': ' if reason else ''}{reason}") from None
        points = np.asarray(mesh.points, dtype=np.float64)
        if len(points) == 0:
            raise ValueError(f"{name}: has no points")
        found = [np.empty((0, 2), dtype=np.int64)]
        for block in mesh.cells:
            if block.type == "vertex":
                continue
            if block.type == "polygon":
                found += [np.column_stack([face, np.roll(face, -1)]) for face in block.data]
            elif block.type in _EDGES:
                found += [np.asarray(block.data)[:, list(edge)] for edge in _EDGES[block.type]]
            else:
                raise ValueError(f"{name}: cells of type {block.type!r}: only cells with straight edges are read")
        pairs = np.concatenate(found)
        if weld is not None:
            points, pairs = _welded(points, pairs, weld)
        pairs = np.sort(pairs, axis=1)
        pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
        system = cls(points, pairs, masses=masses, **parameters)
        _warn(_notes(points, pairs))
        return system

    @classmethod
    def parse(cls, text: str, format: str = "toml") -> System:
        """Read the text of a scene file, ``"toml"`` or ``"json"``."""
        native, notes = _native.System.parse(text, format)
        _warn(notes)
        return cls._of(native)

    @classmethod
    def ready(cls, kind: str, size: int | None = None, refine: bool = False) -> System:
        """A ready scene, as ``sprung new KIND --size N`` or ``--size N --refine`` prints it.

        Parameters
        ----------
        kind : {"chain", "cloth", "lattice", "column", "pendulum", "string", "network"}
        size : int, optional
            Particles along a side, links, joints or bobs, at a constant distance: a larger size makes a larger scene.
        refine : bool
            Keep extent, mass and elasticity of the default size, and refine the mesh.
        """
        size = None if size is None else _arrays.count("size", size)
        return cls._of(_native.System.ready(kind, size, bool(refine)))

    def with_forces(self, *forces: ExternalForce | Callable[..., Any]) -> System:
        """The system with more external forces, each an :class:`ExternalForce` or a function of positions, velocities and time.

        A system with functions cannot be written to a scene file, and :func:`verify` ignores them.
        """
        shape = (len(self.masses), self.dimension)
        given = _functions.forces(forces, self._forces, *shape)
        return self._of(self._native.with_functions(given, None), self._forces + len(given))

    def with_springs(
        self,
        *,
        stiffness: ArrayLike | None = None,
        rest_lengths: ArrayLike | None = None,
        damping: ArrayLike | None = None,
    ) -> System:
        """The system with other parameters for its springs, one number for all or one for each; those not given stay.

        Forces, loads, constraints and the initial state do not change.

        Examples
        --------
        >>> import sprung
        >>> chain = sprung.System.ready("chain", 3)
        >>> float(chain.with_springs(stiffness=2 * chain.stiffness).stiffness[0] / chain.stiffness[0])
        2.0
        """
        count = len(self.pairs)
        given = (("stiffness", stiffness), ("rest_lengths", rest_lengths), ("damping", damping))
        arrays = [
            own if value is None else _arrays.each(name, value, count, "springs", zero=name != "stiffness")
            for (name, value), own in zip(given, self._springs)
        ]
        return self._of(self._native.with_springs(*arrays), self._forces)

    def with_spring_law(self, law: Callable[..., Any]) -> System:
        """The system with another law for all its springs in place of ``T = k (l/l0 - 1)``; damping does not change.

        Parameters
        ----------
        law : callable
            ``law(lengths, rest_lengths, stiffness)``, called once for all springs with arrays in m, m and N, returns ``(tension, slope)`` or
            ``(tension, slope, energy)``: the tension T, in N, positive where the spring pulls its ends together; its slope dT/dl, in
            N/m; and the stored energy, the integral of T from the rest length, in J.

            Without an energy it is integrated by Gauss's rule with twelve nodes, one call each: to rounding for a smooth tension, to
            about 1 % if it has kinks between the rest length and the length.

        Notes
        -----
        Where a slope is not positive the matrix uses 1e-9 ``k/l0``; forces stay exact. Exceptions and wrong arrays are treated as for an
        :class:`ExternalForce`.

        Examples
        --------
        A bungee that exerts no force under compression and stiffens under tension:

        >>> import numpy as np
        >>> import sprung
        >>> def bungee(lengths, rest_lengths, stiffness):
        ...     strain = np.maximum(lengths / rest_lengths - 1, 0)
        ...     energy = stiffness * rest_lengths * (strain**2 / 2 + strain**4 / 4)
        ...     return stiffness * (strain + strain**3), stiffness * (1 + 3 * strain**2) / rest_lengths, energy
        >>> system = sprung.System([[0.0], [3.0]], [[0, 1]], masses=1.0, stiffness=10.0, rest_lengths=2.0, spring_law=bungee)
        >>> system.force().round(6).tolist()
        [[6.25], [-6.25]]
        """
        given = _functions.law(law, len(self.pairs))
        return self._of(self._native.with_functions([], given), self._forces)

    def to_toml(self, state: State | None = None) -> str:
        """The system as a TOML scene file that starts at a state, by default the initial one."""
        return self._native.write(self._given(state), "toml")

    def to_json(self, state: State | None = None) -> str:
        """As :meth:`to_toml`, as JSON."""
        return self._native.write(self._given(state), "json")

    def save(self, path: str | os.PathLike[str], state: State | None = None) -> None:
        """Write a scene file for the command ``sprung`` or :meth:`load`: TOML, JSON or NumPy arrays by its extension.

        The file is replaced only when the new one is complete.
        """
        self._native.save(self._given(state), os.fspath(path))

    @property
    def name(self) -> str:
        """The name of the scene."""
        return self._native.name

    @property
    def dimension(self) -> int:
        """Number of modelled axes: 1, 2 or 3."""
        return self._native.dimension

    @cached_property
    def masses(self) -> Floats:
        """The mass of every particle, in kg. All arrays of a system are copies."""
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
        """The acceleration of gravity at time zero, in m/s**2."""
        return np.array(self._native.gravity)

    @property
    def loads(self) -> Floats:
        """Constant forces on the particles in N, shape (particles, dimension)."""
        return self._native.loads

    @property
    def drag(self) -> Floats:
        """c of the force ``-c v`` on every particle, in N s/m."""
        return self._native.drag

    @property
    def tension_only(self) -> NDArray[np.bool_]:
        """True for springs that exert no force while shorter than at rest."""
        return self._native.tension_only

    @property
    def time_settings(self) -> tuple[float | None, float | None]:
        """``time.dt`` and ``time.duration`` of the scene file, in s, or ``None``."""
        return self._native.time

    @cached_property
    def dofs(self) -> NDArray[np.int64]:
        """Particle and axis (0, 1, 2) of every row of the matrices, shape (rows, 2): the coordinates that are free."""
        return _arrays.dofs(*self._native.dofs)

    def initial_state(self) -> State:
        """A copy of the initial state."""
        return State._of(self._native.start())

    def _given(self, state: State | None) -> Given:
        if state is None:
            return self._native.start()
        if not isinstance(state, State):
            raise TypeError(f"state = {state!r}: must be a sprung.State, or None for the initial one")
        return state._given()

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
        kind : {"all", "elastic", "damping", "weight", "external"}
            Elastic or damping forces of springs, weight, or external forces (loads, drag and :class:`ExternalForce`).

        Returns
        -------
        ndarray, shape (particles, dimension)
        """
        return self._native.force(self._given(state), kind)

    def energy(self, state: State | None = None) -> Energy:
        """Energies of a state, by default the initial one, in J."""
        return Energy(*self._native.energy(self._given(state)))

    def reactions(self, state: State | None = None) -> Floats:
        """The constraint forces on particles at a state, by default the initial one, in N.

        ``m a - (f_el + f_d + m g + f_ext)`` along prescribed coordinates, with a = 0 between the kinks of paths; zero along free ones.

        Returns
        -------
        ndarray, shape (particles, dimension)
        """
        return self._native.reactions(self._given(state))

    def matrices(self, state: State | None = None, dt: float | None = None, stiffness: str = "full") -> Matrices:
        """The linear system ``A dx = b`` of a step over the free coordinates.

        Parameters
        ----------
        state : State, optional
            By default the initial one.
        dt : float
            The step, in s; by default that of the scene file, or 0.01.
        stiffness : {"full", "tension", "axial", "absolute"}
            The stiffness in K and A: exact, without the transverse terms of compressed springs, without any transverse
            terms, or with those of compressed springs by their absolute value.

        Returns
        -------
        Matrices

        Notes
        -----
        ``A = M/dt**2 - G/dt - K``, ``b = M v/dt + M gravity + f_elastic - A_fc dx_c``, including the
        prescribed motion.
        """
        return Matrices(self._native, self._given(state), self._step(dt), stiffness)

    def operator(
        self, state: State | None = None, dt: float | None = None, stiffness: str = "full", matrix: str = "A"
    ) -> LinearOperator:
        """A matrix-free operator of A, M, G or K.

        Parameters
        ----------
        state, dt, stiffness
            As for :meth:`matrices`.
        matrix : {"A", "M", "G", "K"}
        """
        return linear_operator(self._native, self._given(state), self._step(dt), stiffness, matrix)

    def factor(
        self, state: State | None = None, dt: float | None = None, stiffness: str = "full", kind: str = "llt"
    ) -> Factor:
        """A factorization of A; see :meth:`Matrices.factor`."""
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
        page = _native.view(self._native, self.name, None, np.zeros(1), start.positions[np.newaxis], [], [], 4_000_000)
        return framed(page, 480)
