"""Checks of gradients, Hessians and adjoints by Taylor remainders and dot products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays
from ._arrays import Floats
from ._jacobian import Entry, JacobianCheck, _square, check_jacobian

#: Multiples of rounding from which on a remainder counts as resolved.
_RESOLVED = 64.0
#: The distance of a measured order from 2 at which a remainder counts as linear: the next order over four halvings.
_SHORTFALL = 0.2
#: The number of coordinates up to which the entries of a wrong gradient or adjoint are measured one by one.
_MEASURED = 1000
_ROWS = 10


@dataclass(frozen=True)
class GradientCheck:
    """The result of :func:`check_gradient`.

    Attributes
    ----------
    passed : bool
        True if the remainders fall with the square of h, or are rounding, along every direction.
    verdict : str
        The result in words.
    orders : list of (float, float)
        For every direction the orders of the remainders without and with the gradient, over four halvings; NaN where a remainder is
        rounding. A right gradient has 1 and 2.
    remainders : list of ndarray, shape (5, 3)
        For every direction h, and the remainders without and with the gradient.
    worst : list of Entry
        The wrong entries, worst first, where there are few enough to be measured; ``row`` is that of the flattened gradient.
    """

    passed: bool
    verdict: str
    orders: list[tuple[float, float]]
    remainders: list[Floats]
    worst: list[Entry]
    _name: str = field(repr=False, default="f")

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        lines = [f"gradient of {self._name}: {self.verdict}"]
        for (first, second), table in zip(self.orders, self.remainders):
            lines.append(f"  orders {first:.2f} without and {second:.2f} with the gradient, h from {table[0, 0]:.1e} to {table[-1, 0]:.1e}")
        return "\n".join(lines + _table(self.worst, "entry {0.row}"))


@dataclass(frozen=True)
class HessianCheck:
    """The result of :func:`check_hessian`.

    Attributes
    ----------
    passed : bool
    verdict : str
        The result in words.
    gradient : GradientCheck
        The force as minus the gradient of the energy.
    jacobian : JacobianCheck
        K as the Jacobian of the force.
    asymmetry : float
        The largest ``|K - K.T|`` relative to the largest entry in its row and column.
    worst : list of Entry
        Entries of K that differ from their mirror images, worst first; ``numeric`` is the mirror image.
    """

    passed: bool
    verdict: str
    gradient: GradientCheck
    jacobian: JacobianCheck
    asymmetry: float
    worst: list[Entry]

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        return "\n".join([self.verdict, str(self.gradient), str(self.jacobian), *_table(self.worst)])


@dataclass(frozen=True)
class AdjointCheck:
    """The result of :func:`check_adjoint`.

    Attributes
    ----------
    passed : bool
    verdict : str
        The result in words.
    value, bound : float
        The largest ``|<y, T x> - <A y, x>|`` relative to the sums of magnitudes, and the bound from the measured rounding.
    worst : list of Entry
        Entries in which the matrix of the adjoint (``analytic``) differs from the transposed one of the tangent (``numeric``), worst
        first, where there are few enough to be measured.
    """

    passed: bool
    verdict: str
    value: float
    bound: float
    worst: list[Entry]

    def __bool__(self) -> bool:
        return self.passed

    def __str__(self) -> str:
        return "\n".join([f"adjoint: {self.verdict}", *_table(self.worst)])


def check_gradient(
    f: Callable[[Floats], ArrayLike],
    grad: Any,
    x: ArrayLike,
    *,
    length: ArrayLike | None = None,
    directions: int = 3,
    seed: int = 0,
    name: str = "f",
) -> GradientCheck:
    """Compare a gradient with a function by the remainders of Taylor's theorem.

    Parameters
    ----------
    f : callable
        ``f(x)`` returns one number, for ``x`` of the given shape.
    grad : array_like or callable
        The gradient, in the shape of ``x``; a callable is evaluated at ``x``.
    x : array_like
        The point.
    length : float or array_like, optional
        The scale of the coordinates, or one for each; by default their spread.
    directions : int
        The number of random directions, each of which moves every coordinate.
    seed : int
        That of the directions.
    name : str
        The name in the report.

    Returns
    -------
    GradientCheck

    Raises
    ------
    ValueError
        For arguments of a wrong shape or that are not finite, or a function that is not finite at ``x``.
    TypeError
        If ``f`` is not callable.

    Notes
    -----
    Along a direction d, ``|f(x + h d) - f(x)|`` falls with h, and ``|f(x + h d) - f(x) - h grad.d|`` with its square. The orders are those of
    the four smallest halvings whose remainders are 64 times rounding, which is measured where h is too small for anything else:
    there is no step to be chosen. About 30 evaluations a direction.

    An entry that contributes less than about 1e-6 of the slope along a random direction can be wrong unnoticed.

    Examples
    --------
    >>> import numpy as np
    >>> import sprung
    >>> x = np.array([1.0, 2.0, 3.0])
    >>> sprung.check_gradient(lambda x: np.sum(x**3), 3 * x**2, x).passed
    True
    >>> check = sprung.check_gradient(lambda x: np.sum(x**3), [3.0, -12.0, 27.0], x)
    >>> check.passed, check.worst[0].row, check.worst[0].verdict
    (False, 1, 'sign flipped')
    """
    _callable("f", f)
    point = _finite("x", x)
    if point.size == 0:
        raise ValueError("x = []: must have at least one coordinate")
    gradient = _finite("grad", grad(point.copy()) if callable(grad) else grad)
    if gradient.size != point.size:
        raise ValueError(f"grad = an array of shape {gradient.shape}: must have shape {point.shape}, as x has")
    gradient = gradient.reshape(point.shape)
    directions = _arrays.count("directions", directions)
    scale = _scale(point, length)
    function = _Function(f, point, gradient, scale)
    rng = np.random.default_rng(seed)
    found = [function.remainders(rng.uniform(0.5, 1.0, point.shape) * rng.choice([-1.0, 1.0], point.shape) * scale) for _ in range(directions)]
    orders, tables = [order for order, _ in found], [table for _, table in found]
    wrong = [second for _, second in orders if second < 2 - _SHORTFALL]
    passed = not wrong and not function.is_lost
    worst: list[Entry] = []
    if function.is_lost:
        verdict = "cannot be measured: along a direction the function changes by less than 64 times its rounding"
    elif passed:
        rounding = all(np.isnan(second) for _, second in orders)
        verdict = "agrees: its remainders are rounding" if rounding else "agrees: its remainders are of second order"
    else:
        overall, worst = function.entries()
        verdict = overall or f"wrong: its remainders are of order {min(wrong):.2f}, not 2"
    return GradientCheck(passed, verdict, orders, tables, worst, str(name))


class _Function:
    """A function at a point, with its gradient and its rounding."""

    def __init__(self, f: Callable[[Floats], ArrayLike], x: Floats, gradient: Floats, scale: Floats) -> None:
        self.f, self.x, self.gradient, self.scale = f, x, gradient, scale
        value = np.asarray(f(x.copy()))
        if value.dtype.kind not in "fiu" or value.size != 1:
            raise ValueError(f"f(x) = an array of {value.dtype} and shape {value.shape}: must be one real number")
        self.start = float(value.reshape(()))
        if not np.isfinite(self.start):
            raise ValueError(f"f(x) = {self.start}: must be finite")
        # The unit of rounding of the function, and its rounding at a point that is itself rounded.
        self.unit = 2.0 ** (-24 if value.dtype == np.float32 else -53)
        self.size = abs(self.start) + float(np.sum(abs(gradient * x)))
        # Whether rounding hides all that the gradient says.
        self.is_lost = False

    def rise(self, step: Floats) -> float:
        value = float(np.asarray(self.f(self.x + step)).reshape(()))
        return value - self.start

    def remainders(self, direction: Floats) -> tuple[tuple[float, float], Floats]:
        """The orders along a direction, and the table behind them."""
        slope = float(np.sum(self.gradient * direction))

        def at(h: float) -> list[float]:
            rise = self.rise(h * direction)
            return [h, abs(rise), abs(rise - h * slope)]

        # Twice: a function that does not move where its gradient says that it must is one of single precision inside.
        while True:
            finest = np.sqrt(self.unit) / 16
            probes = [at(sign * part * finest) for part in (1, 0.9, 0.8, 0.7) for sign in (1, -1)]
            still = all(rise == 0 for _, rise, _ in probes) and abs(slope) * finest > _RESOLVED * self.unit * self.size
            if not still or self.unit > 1e-10:
                break
            self.unit = 2.0**-24
        rounding = max(self.unit * self.size, *(remainder for _, _, remainder in probes))
        table: list[list[float]] = []
        h = 2.0 * finest
        while len(table) < 5 and h <= 0.25:
            row = at(h)
            # Beyond the domain of f, nothing can be measured.
            if not np.isfinite(row[2]):
                break
            table = [*table, row] if row[2] >= _RESOLVED * rounding else []
            h *= 2
        rows = np.array(table[::-1]).reshape(-1, 3)
        if len(rows) < 2:
            self.is_lost |= 0 < abs(slope) * 0.25 < _RESOLVED * rounding
            return (np.nan, np.nan), np.array([at(0.25 / 2**k) for k in range(5)])
        octaves = np.log2(rows[0, 0] / rows[-1, 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = np.log2(rows[0, 1:] / rows[-1, 1:]) / octaves
        return (float(first), float(second)), rows

    def entries(self) -> tuple[str | None, list[Entry]]:
        """An error of the whole gradient in words, and its wrong entries by extrapolated central differences, where they are not too many."""
        if self.x.size > _MEASURED:
            return None, []
        measured, error = np.zeros(self.x.size), np.zeros(self.x.size)
        h = self.unit**0.2 / 4
        for index, scale in enumerate(self.scale.ravel()):
            step = np.zeros(self.x.size)

            def slope(part: float, step: Floats = step, index: int = index, scale: float = float(scale)) -> float:
                step[index] = part * h * scale
                ahead = step.reshape(self.x.shape)
                return (self.rise(ahead) - self.rise(-ahead)) / (2 * part * h * scale)

            coarse, fine, finest = slope(1.0), slope(0.5), slope(0.25)
            rough, measured[index] = (4 * fine - coarse) / 3, (4 * finest - fine) / 3
            error[index] = abs(measured[index] - rough) + 16 * self.unit * self.size / (h * scale)
        analytic = self.gradient.ravel()
        tolerance = 2 * error + 1e-7 * abs(measured)
        return _overall(analytic, measured, tolerance), _entries(analytic, measured, tolerance, self.x.shape)


def check_hessian(
    energy: Callable[[Floats], ArrayLike],
    force: Callable[[Floats], ArrayLike],
    K: Any,
    x: ArrayLike,
    *,
    length: float | None = None,
    seed: int = 0,
    name: str = "energy",
) -> HessianCheck:
    """Compare a force with minus the gradient of its energy, and a matrix with the derivative of the force.

    Parameters
    ----------
    energy : callable
        ``energy(x)`` returns one number.
    force : callable
        ``force(x) = -grad energy``, in the shape of ``x``.
    K : array_like, sparse matrix, or callable
        ``d force / d x``, minus the Hessian; a callable is evaluated at ``x``.
    x : array_like
        The point.
    length : float, optional
        The scale of the coordinates; by default their spread.
    seed : int
        That of the directions of the gradient's check.
    name : str
        The name in the report.

    Returns
    -------
    HessianCheck

    Raises
    ------
    ValueError
        As :func:`check_gradient` and :func:`check_jacobian` do.
    TypeError
        If ``energy`` or ``force`` is not callable.

    Examples
    --------
    >>> import numpy as np
    >>> import sprung
    >>> x = np.array([1.0, 2.0])
    >>> check = sprung.check_hessian(
    ...     lambda x: x[0] ** 2 * x[1], lambda x: np.array([-2 * x[0] * x[1], -x[0] ** 2]), [[-4.0, -2.0], [2.0, 0.0]], x)
    >>> check.passed, check.verdict
    (False, 'the force is minus the gradient of energy; 1 of 4 entries of K is wrong; K is not symmetric')
    """
    _callable("energy", energy)
    _callable("force", force)
    point = _finite("x", x)
    gradient = check_gradient(energy, -_finite("force(x)", force(point.copy())), point, length=length, seed=seed, name=name)
    matrix = _square(K(point.copy()) if callable(K) else K, point.size)
    jacobian = check_jacobian(force, matrix, point, length=length, name="force")
    difference = abs(matrix - matrix.T).tocoo()
    largest = np.maximum(abs(matrix).max(axis=0).toarray().ravel(), abs(matrix).max(axis=1).toarray().ravel())
    sizes = np.maximum(largest[difference.coords[0]], largest[difference.coords[1]]) if difference.nnz else np.zeros(0)
    unit = 2.0**-53 if np.asarray(force(point.copy())).dtype != np.float32 else 2.0**-24
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(sizes > 0, difference.data / sizes, 0.0)
    asymmetry = float(relative.max(initial=0.0))
    dense = matrix.tocsr()
    ranked = sorted(zip(relative, *difference.coords), key=lambda entry: -entry[0])[: 2 * _ROWS]
    worst = []
    for part, row, column in ranked:
        if row < column and part > 2 * _RESOLVED * unit:
            here, mirrored = float(dense[row, column]), float(dense[column, row])
            worst.append(Entry(int(row), int(column), None, here, mirrored, f"not the mirror image: {_verdict(here, mirrored, 0.0)}"))
    is_symmetric = asymmetry <= 2 * _RESOLVED * unit
    wrong = "1 of {0} entries of K is wrong" if jacobian.wrong == 1 else "{1} of {0} entries of K are wrong"
    verdict = "; ".join(
        [
            f"the force is {'' if gradient else 'not '}minus the gradient of {name}",
            "K is the Jacobian of the force" if jacobian else wrong.format(jacobian.compared, jacobian.wrong),
            f"K is {'' if is_symmetric else 'not '}symmetric",
        ]
    )
    return HessianCheck(bool(gradient and jacobian and is_symmetric), verdict, gradient, jacobian, asymmetry, worst)


def check_adjoint(
    tangent: Callable[[Floats], ArrayLike],
    adjoint: Callable[[Floats], ArrayLike],
    x_shape: Any,
    y_shape: Any,
    *,
    samples: int = 4,
    seed: int = 0,
) -> AdjointCheck:
    """Compare an adjoint with its tangent by dot products: ``<y, T x> = <A y, x>``.

    Parameters
    ----------
    tangent : callable
        ``tangent(x)`` applies a linear map T to an array of shape ``x_shape`` and returns one of shape ``y_shape``.
    adjoint : callable
        ``adjoint(y)`` applies its adjoint, from ``y_shape`` to ``x_shape``.
    x_shape, y_shape : int or tuple of int
    samples : int
        The number of random pairs.
    seed : int
        That of the pairs.

    Returns
    -------
    AdjointCheck

    Raises
    ------
    ValueError
        For shapes that a function does not keep to, or values that are not finite.
    TypeError
        If ``tangent`` or ``adjoint`` is not callable.

    Notes
    -----
    The bound is 64 times the rounding of both maps: by how much the image of a sum misses the sum of images, at least that of
    the dot products. A map that is not linear is reported as such.

    Examples
    --------
    >>> import numpy as np
    >>> import sprung
    >>> T = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0]])
    >>> sprung.check_adjoint(lambda x: T @ x, lambda y: T.T @ y, 3, 2).passed
    True
    >>> print(sprung.check_adjoint(lambda x: T @ x, lambda y: abs(T).T @ y, 3, 2))
    adjoint: is not that of the tangent: dot products differ by 1.0e+00 of their terms
      row 2, column 1: 1, measured -1: sign flipped
    """
    shapes = [_shape("x_shape", x_shape), _shape("y_shape", y_shape)]
    samples = _arrays.count("samples", samples)
    maps = [_map("tangent", tangent, shapes[1]), _map("adjoint", adjoint, shapes[0])]
    rng = np.random.default_rng(seed)
    value, rounding, bent = 0.0, 0.0, [0.0, 0.0]
    for _ in range(samples):
        x, other, y, second = (rng.uniform(-1, 1, shape) for shape in (shapes[0], shapes[0], shapes[1], shapes[1]))
        image, back = maps[0](x), maps[1](y)
        size = np.sum(abs(y * image)) + np.sum(abs(back * x))
        missed = [
            np.sum(abs(y * (maps[0](x + other) - image - maps[0](other)))),
            np.sum(abs(x * (maps[1](y + second) - back - maps[1](second)))),
        ]
        if size > 0:
            value = max(value, abs(np.sum(y * image) - np.sum(back * x)) / size)
            bent = [max(bent[k], missed[k] / size) for k in (0, 1)]
    rounding = max(sum(bent), 2.0**-53 * np.sqrt(max(np.prod(shapes[0]), np.prod(shapes[1]))))
    bound = float(_RESOLVED * rounding)
    for k, name in enumerate(["tangent", "adjoint"]):
        if bent[k] > 1e-4:
            return AdjointCheck(False, f"the {name} is not linear: sums of images differ by {bent[k]:.1e}", float(value), bound, [])
    if value <= bound:
        return AdjointCheck(True, f"agrees: dot products differ by {value:.1e}, rounding allows {bound:.1e}", float(value), bound, [])
    worst: list[Entry] = []
    rows, columns = int(np.prod(shapes[0])), int(np.prod(shapes[1]))
    if rows * columns <= _MEASURED**2 and rows + columns <= _MEASURED:
        expected = np.array([maps[0](unit.reshape(shapes[0])).ravel() for unit in np.eye(rows)])
        found = np.array([maps[1](unit.reshape(shapes[1])).ravel() for unit in np.eye(columns)]).T
        tolerance = np.full(expected.shape, bound * max(abs(expected).max(), abs(found).max()))
        worst = _entries(found.ravel(), expected.ravel(), tolerance.ravel(), expected.shape, matrix=True)
    verdict = f"is not that of the tangent: dot products differ by {value:.1e} of their terms"
    return AdjointCheck(False, verdict, float(value), bound, worst)


def _callable(name: str, value: Any) -> None:
    if not callable(value):
        raise TypeError(f"{name} = {type(value).__name__}: must be callable")


def _finite(name: str, value: ArrayLike) -> Floats:
    array = _arrays.real(name, value)
    if not np.isfinite(array).all():
        at = int(np.flatnonzero(~np.isfinite(array.ravel()))[0])
        raise ValueError(f"{name}[{at}] = {array.ravel()[at]}: must be finite")
    return np.array(array, dtype=np.float64)


def _scale(x: Floats, length: ArrayLike | None) -> Floats:
    """A length for each coordinate."""
    if length is None:
        return np.full(x.shape, float(np.ptp(x)) or float(abs(x).max()) or 1.0)
    given = _finite("length", length)
    if not (given > 0).all() or given.shape not in ((), x.shape):
        raise ValueError(f"length = {length!r}: must be positive, one number or one for each coordinate")
    return np.broadcast_to(given, x.shape)


def _shape(name: str, value: Any) -> tuple[int, ...]:
    shape = (value,) if isinstance(value, (int, np.integer)) else tuple(value) if isinstance(value, (tuple, list)) else None
    if shape is None or not all(isinstance(n, (int, np.integer)) and not isinstance(n, bool) and n > 0 for n in shape):
        raise ValueError(f"{name} = {value!r}: must be a positive integer or a tuple of them")
    return tuple(int(n) for n in shape)


def _map(name: str, function: Any, shape: tuple[int, ...]) -> Callable[[Floats], Floats]:
    _callable(name, function)

    def checked(vector: Floats) -> Floats:
        image = _finite(f"{name}(…)", function(vector))
        if image.size != np.prod(shape):
            raise ValueError(f"{name}(…) = an array of shape {image.shape}: must have shape {shape}")
        return image.reshape(shape)

    return checked


def _verdict(analytic: float, numeric: float, tolerance: float) -> str:
    if abs(analytic - numeric) <= tolerance:
        return "agrees"
    if analytic == 0:
        return "missing"
    if abs(numeric) <= tolerance:
        return "should be zero"
    if abs(analytic + numeric) <= max(tolerance, 1e-9 * abs(numeric)):
        return "sign flipped"
    if analytic * numeric < 0:
        return "wrong sign and size"
    excess = 100 * (analytic / numeric - 1)
    if abs(excess) >= 100:
        return f"{analytic / numeric:.3f} times too large"
    return f"{abs(excess):.3g} % too {'large' if excess > 0 else 'small'}"


def _overall(analytic: Floats, numeric: Floats, tolerance: Floats) -> str | None:
    """A single error of a whole vector."""
    size = float(numeric @ numeric)
    factor = float(analytic @ numeric) / size if size > 0 else 1.0
    if analytic.size < 2 or factor == 0 or abs(factor - 1) < 1e-6 or (abs(analytic - factor * numeric) > tolerance * max(1, abs(factor))).any():
        return None
    return "sign flipped" if abs(factor + 1) < 1e-6 else f"off by the factor {factor:.6g}"


def _entries(analytic: Floats, numeric: Floats, tolerance: Floats, shape: tuple[int, ...], matrix: bool = False) -> list[Entry]:
    """The wrong entries, worst first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(abs(analytic - numeric) / tolerance, nan=0.0, posinf=np.inf)
    worst = []
    for index in np.argsort(-ratio, kind="stable")[:_ROWS]:
        if ratio[index] > 1:
            row, column = (int(k) for k in np.unravel_index(index, shape)) if matrix else (int(index), 0)
            found = float(analytic[index]), float(numeric[index])
            worst.append(Entry(row, column, None, *found, _verdict(*found, float(tolerance[index]))))
    return worst


def _table(entries: list[Entry], place: str = "row {0.row}, column {0.column}") -> list[str]:
    return [f"  {place.format(e)}: {e.analytic:.6g}, measured {e.numeric:.6g}: {e.verdict}" for e in entries]
