"""Equilibrium, normal modes and mechanisms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays, _native
from ._arrays import Floats
from ._gradient import Gradient
from ._inspect import Inertia
from ._state import State
from ._system import System


class Equilibrium:
    """Where a search for a static equilibrium ended.

    Attributes
    ----------
    status : {"stable", "indifferent", "unstable", "none", "not-converged"}
        By the eigenvalues of -K: all positive; some zero; some negative. ``"none"`` where a part falls.
    positions : ndarray, shape (particles, dimension)
    residual : float
        The largest force left over the largest force acting.
    energy : float
        Of springs, weight and loads, in J.
    iterations : int
        Steps of Newton's method.
    inertia : Inertia
        Signs of the eigenvalues of -K.
    counted : bool
        Whether these were counted, by a factorization; in scenes too large for one, the lowest that were found stand for all.
    falling : list of int
        Particles that nothing holds against their load.
    """

    def __init__(self, system: System, native: Any) -> None:
        self.system = system
        self._native = native
        self.status, self.residual, self.energy, self.iterations, signs, self.counted, self.falling = native.figures()
        self.inertia = Inertia(*signs)
        self.positions: Floats = native.positions()

    @property
    def state(self) -> State:
        """The configuration at rest."""
        return State(self.positions)

    def gradient(self, positions: ArrayLike) -> Gradient:
        """The derivatives of a cost J by the parameters, from ``positions``, its derivatives by the equilibrium's.

        Raises
        ------
        ValueError
            Where the equilibrium is not isolated, because the scene can move freely.
        """
        given = _arrays.rows("positions", positions, width=self.system.dimension)
        return Gradient(self._native.gradient(given))

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.status}, residual {self.residual:.1e}>"


def equilibrium(
    system: System,
    state: State | None = None,
    *,
    load: float = 1.0,
    leave_saddles: bool = True,
    tolerance: float = 1e-10,
    iterations: int = 2000,
    stiffness: str = "on-demand",
) -> Equilibrium:
    """The static equilibrium downhill from a state: a minimum of the energy.

    Parameters
    ----------
    system : System
    state : State, optional
        Where to start; by default the initial state.
    load : float
        A factor of gravity and loads.
    leave_saddles : bool
        Whether to go on from a saddle of the energy, along the direction down.
    tolerance : float
        The largest force left over the largest force acting, at most.
    iterations : int
        Steps of Newton's method at most.
    stiffness : {"on-demand", "progressive", "full", "tension", "axial", "absolute"}
        The matrix of steps that start far from an equilibrium.

    Examples
    --------
    >>> import sprung
    >>> found = sprung.equilibrium(sprung.System.ready("chain", 5))
    >>> found.status
    'stable'
    """
    load = _arrays.number("load", load)
    tolerance = _arrays.positive("tolerance", tolerance)
    iterations = _arrays.count("iterations", iterations)
    given = system._given(state)
    found = _native.equilibrium(system._native, given, load, bool(leave_saddles), tolerance, iterations, stiffness)
    return Equilibrium(system, found)


class Modes:
    """Normal modes: -K phi = omega**2 M phi.

    Attributes
    ----------
    eigenvalues : ndarray, shape (n,)
        omega**2, in 1/s**2, ascending, zero modes left out; negative where a motion grows.
    frequencies : ndarray, shape (n,)
        In Hz; NaN where omega**2 is negative.
    shapes : ndarray, shape (n, particles, dimension)
        phi, with ``sum(m * phi**2) = 1``.
    damping_ratios : ndarray, shape (n,)
        NaN where there is none.
    effective_masses : ndarray, shape (n, dimension)
        In kg.
    residuals : ndarray, shape (n,)
        An eigenvalue lies within this distance of the one reported, in 1/s**2, but for rounding of the residual.
    error_bounds : ndarray, shape (n,)
        Bounds with all rounding errors, in 1/s**2: where ``proven``, that of mode k holds for the k-th eigenvalue. Infinite where nothing is
        shown.
    zero_modes : int or None
        Rigid motions and mechanisms. None where all modes asked for grow and the zero modes above them could not be counted.
    zero_shapes : ndarray, shape (zero_modes, particles, dimension)
        None of them where all modes asked for grow.
    rigid_motions : int
    parts : list of list of int
        The particles of each part that moves as a whole, where there are several parts.
    hanging : list of list of int
        Where there are mechanisms, the particles of each part that hangs by one spring.
    complete : bool
        Whether no eigenvalue below ``counted_below`` is missing, by the count of a factorization.
    proven : bool
        Whether that count is a theorem about the stored matrix: the factorization's rounding errors are bounded.
    counted_below : float
    imbalance : float
        The largest unbalanced force over the largest force; zero at an equilibrium.
    """

    def __init__(self, system: System, native: Any) -> None:
        self.system = system
        self._native = native
        values = native.values()
        self.eigenvalues, self.residuals, self.error_bounds, self.damping_ratios, self.effective_masses = values
        with np.errstate(invalid="ignore"):
            self.frequencies: Floats = np.sqrt(self.eigenvalues) / (2 * np.pi)
        figures = native.figures()
        self.zero_modes, self.rigid_motions, self.gap, complete, self.counted_below, self.imbalance = figures
        self.complete: bool
        self.proven: bool
        self.complete, self.proven = complete
        self.parts: list[list[int]]
        self.hanging: list[list[int]]
        self.parts, self.hanging = native.parts()
        self.shapes: Floats = native.shapes(False)
        self.zero_shapes: Floats = native.shapes(True)

    def state_space(self, inputs: Sequence[int], outputs: Sequence[int]) -> tuple[Floats, Floats, Floats, Floats]:
        """A, B, C and D of the modes found, from forces at some rows of the matrices to displacements of others.

        ``scipy.signal.StateSpace(*modes.state_space([0], [0]))`` takes them.
        """
        a, b, c = self._native.state_space(
            [_arrays.count("inputs", row, least=0) for row in inputs], [_arrays.count("outputs", row, least=0) for row in outputs]
        )
        return a, b, c, np.zeros((c.shape[0], b.shape[1]))

    def harmonic_response(self, force: ArrayLike, frequencies: ArrayLike) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Complex amplitudes of the displacements that a harmonic force drives.

        Parameters
        ----------
        force : array_like, shape (rows,)
            Amplitudes on the free coordinates, in N; ``system.gather`` makes them from an array of all particles.
        frequencies : float or array_like
            In Hz.

        Returns
        -------
        ndarray of complex, shape (frequencies, rows)
            In m; of the modes found.
        """
        given = np.atleast_1d(_arrays.real("frequencies", frequencies))
        rows = len(self.system.dofs)
        loads = _arrays.real("force", force)
        if given.ndim != 1:
            raise ValueError(f"frequencies = an array of shape {given.shape}: must be one number or a list")
        if loads.shape != (rows,):
            raise ValueError(f"force = an array of shape {loads.shape}: must have the {rows} free coordinates")
        real, imaginary = self._native.harmonic_response(loads.tolist(), given.tolist())
        return real + 1j * imaginary

    def __len__(self) -> int:
        return len(self.eigenvalues)

    def __repr__(self) -> str:
        counted = "complete" if self.complete else "not counted"
        zeros = "uncounted" if self.zero_modes is None else self.zero_modes
        return f"<Modes: {len(self)} beside {zeros} zero modes, {counted}>"


def modes(system: System, n: int, state: State | None = None) -> Modes:
    """The n lowest normal modes beside zero modes, at a state.

    Parameters
    ----------
    system : System
    n : int
    state : State, optional
        By default the initial one; at a state that is no equilibrium ``imbalance`` says how far it is from one.

    Examples
    --------
    >>> import sprung
    >>> found = sprung.modes(sprung.System.ready("string"), 3)
    >>> found.complete, found.zero_modes
    (True, 0)
    """
    return Modes(system, _native.modes(system._native, system._given(state), _arrays.count("n", n)))


class Mechanisms:
    """Motions that stretch no spring, and tensions that balance.

    Attributes
    ----------
    degrees_of_freedom, springs, rank : int
    mechanisms : int
        ``degrees_of_freedom - rank``, rigid motions among them.
    rigid_motions : int
    self_stresses : int
        ``springs - rank``, where a spring of zero length counts as one for every axis: it resists in every direction.
    gap : tuple
        The smallest singular value that counts as not zero, and the largest that does; NaN where there is none, or where it was only
        counted.
    decided : bool
        Whether rounding leaves no singular value open.
    proven : bool
        Whether the gap is a theorem about the springs' directions at the stored positions: ``rank`` singular values are at least
        ``proven_gap[0]``, and the others at most ``proven_gap[1]``.
    proven_gap : tuple
        NaN where nothing is proven, or where there are no such values.
    rank_is_exact : bool
        Whether the rank is proven in exact arithmetic: from below by a count, from above by the springs and rigid motions of each body.
    prestress_stable : bool or None
        Whether prestress stiffens all mechanisms beside rigid motions; ``None`` without such mechanisms, or where this was not decided.
    movers : list of list of int
        The particles that move in each of ``motions``.
    added_springs : list of (int, int)
        Pairs of particles between which springs remove the mechanisms.
    motions : ndarray, shape (found, particles, dimension)
        A basis of the mechanisms beside rigid motions; of large systems with more than a hundred they are only counted.
    self_stress : ndarray, shape (found, springs)
        A basis of the states of self-stress; empty for large systems, where they are only counted. Of the force of a spring of zero length
        the first component is in its column, and columns behind all springs have the others.
    """

    def __init__(self, handed: tuple[str, Floats, Floats]) -> None:
        text, self.motions, self.self_stress = handed
        data = json.loads(text)
        self.degrees_of_freedom: int = data["degrees_of_freedom"]
        self.springs: int = data["springs"]
        self.rank: int = data["rank"]
        self.mechanisms: int = data["mechanisms"]
        self.rigid_motions: int = data["rigid_motions"]
        self.self_stresses: int = data["self_stresses"]
        self.gap = tuple(np.nan if value is None else value for value in data["gap"])
        self.decided: bool = data["decided"]
        self.proven: bool = data["proven"]
        self.proven_gap = tuple(np.nan if value is None else value for value in data["proven_gap"])
        self.rank_is_exact: bool = data["rank_is_exact"]
        self.prestress_stable: bool | None = data["prestress_stable"]
        self.movers: list[list[int]] = data["movers"]
        self.added_springs = [tuple(pair) for pair in data["added_springs"]]

    def __repr__(self) -> str:
        return f"<Mechanisms: {self.mechanisms} with {self.rigid_motions} rigid motions, {self.self_stresses} self-stresses>"


def mechanisms(system: System, state: State | None = None) -> Mechanisms:
    """The mechanisms and states of self-stress of a system at a state: why its stiffness is singular.

    Examples
    --------
    >>> import sprung
    >>> sprung.mechanisms(sprung.System.ready("pendulum")).mechanisms
    1
    """
    return Mechanisms(_native.mechanisms(system._native, system._given(state)))
