"""Checks of a Jacobian against a force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from . import _arrays, _native
from ._arrays import Floats
from ._html import framed
from ._state import State
from ._system import System

#: The number of coordinates from which columns are measured in groups by default.
_LARGE = 200


class Entry(NamedTuple):
    """One entry of the Jacobian and its measured value."""

    row: int
    column: int
    #: Its spring, if the springs were given.
    spring: int | None
    #: The value under test.
    analytic: float
    #: The measured value.
    numeric: float
    #: A description of the difference, such as ``"sign flipped"``.
    verdict: str


@dataclass(frozen=True)
class JacobianCheck:
    """The result of :func:`check_jacobian`.

    Attributes
    ----------
    passed : bool
        True if every entry agrees.
    compared, wrong : int
        The numbers of compared and of wrong entries.
    value : float
        The largest difference relative to the tolerance of its entry.
    overall : str or None
        A single error of the whole matrix, if there is one: ``"sign flipped"``, ``"transposed"``, …
    worst : list of Entry
        The worst entries, worst first.
    numeric : scipy.sparse.csc_array
        The measured Jacobian.
    groups : int
        The number of groups of columns, each with 28 force evaluations.
    """

    passed: bool
    compared: int
    wrong: int
    value: float
    overall: str | None
    worst: list[Entry]
    numeric: sparse.csc_array
    groups: int
    _text: str = field(repr=False)
    _html: str = field(repr=False)

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        return self._text

    def _repr_html_(self) -> str:
        return framed(self._html, 560)


def check_jacobian(
    force: Callable[[Floats], ArrayLike],
    jacobian: Any,
    x: ArrayLike,
    *,
    coloured: bool | None = None,
    length: float | None = None,
    tolerance: float = 1e-7,
    springs: tuple[System, State] | None = None,
    name: str = "force",
) -> JacobianCheck:
    """Compare a matrix with the derivative of a force at a point, entry by entry.

    Parameters
    ----------
    force : callable
        ``force(x)`` returns as many numbers as ``x`` has, for ``x`` of the given shape, in any form that numpy accepts, such as a
        JAX array.
    jacobian : array_like, sparse matrix, or callable
        ``d force_row / d x_column``, n × n for n coordinates; a callable is evaluated at ``x``.
    x : array_like
        The point.
    coloured : bool, optional
        True to measure columns without common rows in ``jacobian`` together; default from 200 coordinates on. An entry missing
        in ``jacobian`` may then go undetected if another column of the group has an entry in its row.
    length : float, optional
        The length scale of the force; by default the spread of the coordinates.
    tolerance : float
        The relative tolerance, in addition to the uncertainty of the measurement.
    springs : (System, State), optional
        The springs of the force, if ``x`` are their free coordinates; verdicts then name springs.
    name : str
        The name in the report.

    Returns
    -------
    JacobianCheck

    Notes
    -----
    The force is evaluated 28 times for each group of columns: extrapolated central differences with 14 steps,
    whose spread is the uncertainty.

    Examples
    --------
    >>> import numpy as np
    >>> import sprung
    >>> check = sprung.check_jacobian(lambda x: np.array([x[0] * x[1], -x[0] ** 2]), [[3.0, 2.0], [4.0, 0.0]], [2.0, 3.0])
    >>> check.passed, check.worst[0].verdict
    (False, 'sign flipped')
    """
    point = _arrays.real("x", x)
    shape = point.shape
    order = point.size
    matrix = _square(jacobian(np.array(point)) if callable(jacobian) else jacobian, order)
    grouped = order >= _LARGE if coloured is None else bool(coloured)

    def evaluate(flat: Floats) -> Floats:
        return _arrays.real("force(x)", force(flat.reshape(shape))).ravel()

    handed = _native.check_jacobian(
        str(name),
        evaluate,
        (matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data),
        point.ravel(),
        None if length is None else _arrays.number("length", length),
        _arrays.number("tolerance", tolerance),
        grouped,
        None if springs is None else (springs[0]._native, springs[1]._given()),
    )
    starts, rows, values = handed.pop("numeric")
    numeric = sparse.csc_array((values, rows, starts), shape=(order, order))
    worst = [Entry(*entry) for entry in handed.pop("worst")]
    text, html = handed.pop("text"), handed.pop("html")
    return JacobianCheck(worst=worst, numeric=numeric, _text=text, _html=html, **handed)


def _square(jacobian: Any, order: int) -> sparse.csc_array:
    if not sparse.issparse(jacobian):
        jacobian = _arrays.real("jacobian", jacobian)
        if jacobian.size == order * order:
            jacobian = jacobian.reshape(order, order)
    elif jacobian.dtype.kind not in "fiu":
        raise ValueError(f"jacobian = a matrix of {jacobian.dtype}: must be real")
    if jacobian.shape != (order, order):
        raise ValueError(f"jacobian = a matrix of shape {jacobian.shape}: must be {order} × {order}, as x has {order} coordinates")
    matrix = sparse.csc_array(jacobian, dtype=np.float64, copy=sparse.issparse(jacobian))
    matrix.sum_duplicates()
    return matrix
