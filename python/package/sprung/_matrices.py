"""The matrices of a step as scipy types."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator

from . import _arrays, _native
from ._arrays import Floats


class NotPositiveDefinite(np.linalg.LinAlgError):
    """A matrix to be factored is not positive definite, or has a zero pivot.

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


class Matrices:
    """The linear system ``A dx = b`` of a step, over the free coordinates ordered by particle, then axis.

    The matrices are ``scipy.sparse.csc_array`` with both triangles, sorted. Each is copied on first
    access and may then be modified.

    Attributes
    ----------
    dt : float
        The step, in s.
    stiffness : str
        The stiffness option of K and A.
    """

    def __init__(self, system: _native.System, given: Any, dt: float, stiffness: str) -> None:
        self._system = system
        self._native = _native.assemble(system, given, dt, stiffness)
        positions, velocities, time = given
        self._given = positions.copy(), velocities.copy(), time
        self.dt = dt
        self.stiffness = stiffness

    def _whole(self, matrix: str) -> sparse.csc_array:
        order, entries = self._native.order, self._native.entries(matrix)
        # numpy allocates large pages, which is faster.
        starts, rows, values = np.empty(order + 1, np.int32), np.empty(entries, np.int32), np.empty(entries)
        self._native.fill(matrix, starts, rows, values)
        whole = sparse.csc_array((values, rows, starts), shape=(order, order), copy=False)
        whole.has_sorted_indices = True
        whole.has_canonical_format = True
        return whole

    @cached_property
    def A(self) -> sparse.csc_array:
        """``M/dt**2 - G/dt - K``, in N/m."""
        return self._whole("A")

    @cached_property
    def M(self) -> sparse.csc_array:
        """The masses, in kg."""
        return self._whole("M")

    @cached_property
    def G(self) -> sparse.csc_array:
        """``df_damping/dv``, in N s/m; negative semidefinite."""
        return self._whole("G")

    @cached_property
    def K(self) -> sparse.csc_array:
        """``df_elastic/dx`` under the stiffness option, in N/m; negative where the system is stable."""
        return self._whole("K")

    @cached_property
    def b(self) -> Floats:
        """The right-hand side, in N, including the prescribed motion."""
        return self._native.b()

    @cached_property
    def dofs(self) -> NDArray[np.int64]:
        """Particle and axis of every row, shape (rows, 2)."""
        return _arrays.dofs(*self._system.dofs)

    def operator(self, matrix: str = "A") -> LinearOperator:
        """A matrix-free operator: ``"A"``, ``"M"``, ``"G"`` or ``"K"``."""
        return linear_operator(self._system, self._given, self.dt, self.stiffness, matrix)

    def factor(self, kind: str = "llt") -> Factor:
        """Factor the assembled A; modifications of the array are ignored.

        Parameters
        ----------
        kind : {"llt", "ldlt"}
            Sparse Cholesky, which exists if and only if A is positive definite, or LDL^T without pivoting, which
            accepts an indefinite A; check the residual then.

        Raises
        ------
        NotPositiveDefinite
            With the row whose pivot is not positive (``"llt"``) or zero (``"ldlt"``).
        """
        factor, stopped = _native.factor(self._native, kind)
        if factor is None:
            row, particle, axis = stopped or (0, 0, 0)
            what = "not positive" if kind == "llt" else "zero"
            place = f"row {row} (particle {particle}, {'xyz'[axis]})"
            raise NotPositiveDefinite(f"A has a pivot that is {what}, in {place}", row, particle, axis)
        return Factor(factor, kind)

    def __repr__(self) -> str:
        return f"<Matrices of {self._native.order} rows: dt = {self.dt:.6g} s, stiffness {self.stiffness}>"


class Factor:
    """A factorization of A."""

    def __init__(self, native: _native.Factor, kind: str) -> None:
        self._native = native
        self.kind = kind

    @property
    def entries(self) -> int:
        """The number of stored values of L, including zeros in supernodes."""
        return self._native.entries

    @property
    def shape(self) -> tuple[int, int]:
        """The shape of A."""
        return self._native.order, self._native.order

    def solve(self, b: ArrayLike) -> Floats:
        """``x`` with ``A x = b``.

        Parameters
        ----------
        b : array_like, shape (rows,) or (rows, columns)
        """
        array = _arrays.real("b", b)
        if array.ndim not in (1, 2):
            raise ValueError(f"b = an array of shape {array.shape}: must have one or two dimensions")
        columns = np.ascontiguousarray(array.reshape(len(array), -1).T if array.size else array.reshape(0, len(array)))
        return self._native.solve(columns).T.reshape(array.shape)

    def operator(self) -> LinearOperator:
        """``A**-1`` as an operator: a preconditioner, or ``OPinv`` of an eigenvalue solver."""
        return LinearOperator(self.shape, matvec=self.solve, rmatvec=self.solve, matmat=self.solve, dtype=np.float64)

    def __repr__(self) -> str:
        return f"<Factor {self.kind} of {self.shape[0]} rows, {self.entries} entries>"


def linear_operator(system: _native.System, given: Any, dt: float, stiffness: str, matrix: str) -> LinearOperator:
    """A scipy operator of a system."""
    native = _native.operator(system, given, dt, stiffness, matrix)
    order = system.order

    def product(w: Floats) -> Floats:
        return native.apply(_arrays.real("w", w).reshape(order))

    return LinearOperator((order, order), matvec=product, rmatvec=product, dtype=np.float64)
