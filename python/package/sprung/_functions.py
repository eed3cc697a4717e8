"""Forces and spring laws defined by functions, and checks of the arrays that they return."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np

from . import _arrays
from ._arrays import Floats


@dataclass(frozen=True)
class ExternalForce:
    """An external force, such as wind or a floor, with its derivatives.

    Parameters
    ----------
    force : callable
        ``force(positions, velocities, time)`` returns the force on every particle, in N. Positions (m), velocities (m/s) and the
        result have the shape (particles, dimension), the time is in s. It may depend on all particles.
    derivatives : callable, optional
        ``derivatives(positions, velocities, time)`` returns ``(stiffness, damping)``: df/dx, in N/m, and df/dv, in N s/m, of each
        particle by its own position and velocity, both of shape (particles, dimension, dimension), or ``None`` for zero. Their
        symmetric parts enter K, G and A, so a stiff force does not restrict the step. Without them the force is explicit, and
        ``"rodas4"``, whose order requires exact derivatives, rejects it.
    rate : callable, optional
        ``rate(positions, velocities, time)`` returns df/dt at fixed positions and velocities, in N/s, shape (particles, dimension).
        Default: zero. Only ``"rodas4"`` uses it.

    Notes
    -----
    A function is called once for every evaluation, with new arrays, while the interpreter lock is held. An exception ends the run and
    propagates; the stepper then has its last good state. An array of wrong shape or type, or with a value that is not finite, raises
    ``ValueError``.

    Derivatives of a force that couples particles are incomplete; omit them. Methods then keep their order, except ``"rodas4"``.

    Examples
    --------
    A floor with a stiffness of 1 kN/m:

    >>> import numpy as np
    >>> import sprung
    >>> def floor(positions, velocities, time):
    ...     return np.stack([np.zeros(len(positions)), -1e3 * np.minimum(positions[:, 1], 0)], axis=1)
    >>> def derivatives(positions, velocities, time):
    ...     stiffness = np.zeros((len(positions), 2, 2))
    ...     stiffness[positions[:, 1] < 0, 1, 1] = -1e3
    ...     return stiffness, None
    >>> force = sprung.ExternalForce(floor, derivatives)
    >>> system = sprung.System([[0.0, -0.1]], masses=2.0, gravity=[0, -9.81], forces=[force])
    >>> system.force().round(2).tolist()
    [[0.0, 80.38]]
    >>> system.matrices(dt=0.01).K.toarray().tolist()
    [[0.0, 0.0], [0.0, -1000.0]]
    """

    force: Callable[[Floats, Floats, float], Any]
    derivatives: Optional[Callable[[Floats, Floats, float], Any]] = None
    rate: Optional[Callable[[Floats, Floats, float], Any]] = None


def forces(given: Iterable[Any], first: int, particles: int, dimension: int) -> list[tuple[Any, ...]]:
    """Forces for the native module, numbered from ``first`` on."""
    try:
        entries = list(given)
    except TypeError:
        raise ValueError(f"forces = {given!r}: must be a list of functions or of ExternalForce") from None
    rows, blocks = (particles, dimension), (particles, dimension, dimension)
    native = []
    for index, entry in enumerate(entries, first):
        key = f"forces[{index}]"
        force = entry if isinstance(entry, ExternalForce) else ExternalForce(entry)
        for name, function in (("", force.force), (".derivatives", force.derivatives), (".rate", force.rate)):
            if not callable(function) and (function is not None or not name):
                raise ValueError(f"{key}{name} = {function!r}: must be a function of positions, velocities and time")
        native.append(
            (
                _of_rows(key, force.force, rows),
                None if force.derivatives is None else _of_blocks(f"{key}.derivatives", force.derivatives, blocks),
                None if force.rate is None else _of_rows(f"{key}.rate", force.rate, rows),
            )
        )
    return native


def _of_rows(key: str, function: Callable[..., Any], shape: tuple[int, int]) -> Callable[..., Floats]:
    def evaluate(positions: Floats, velocities: Floats, time: float) -> Floats:
        return _checked(key, function(positions, velocities, time), shape, f" at t = {time:.6g} s")

    return evaluate


def _of_blocks(key: str, function: Callable[..., Any], shape: tuple[int, ...]) -> Callable[..., tuple[Any, Any]]:
    def evaluate(positions: Floats, velocities: Floats, time: float) -> tuple[Any, Any]:
        given, where = function(positions, velocities, time), f" at t = {time:.6g} s"
        if not isinstance(given, tuple) or len(given) != 2:
            raise ValueError(f"{key}{where} = {_described(given)}: must be (stiffness, damping), each an array or None")
        stiffness, damping = (
            None if part is None else _checked(f"{key}: {name}", part, shape, where)
            for name, part in zip(("stiffness", "damping"), given)
        )
        return stiffness, damping

    return evaluate


def law(function: Any, springs: int) -> Callable[..., tuple[Floats, ...]]:
    """A spring law for the native module, with an energy."""
    if not callable(function):
        raise ValueError(f"spring_law = {function!r}: must be a function of lengths, rest lengths and stiffnesses")

    def evaluate(lengths: Floats, rest_lengths: Floats, stiffness: Floats) -> tuple[Floats, ...]:
        given = function(lengths, rest_lengths, stiffness)
        if not isinstance(given, tuple) or len(given) not in (2, 3):
            raise ValueError(f"spring_law = {_described(given)}: must be (tension, slope) or (tension, slope, energy)")
        named = zip(("tension", "slope", "energy"), given)
        found = tuple(_checked(f"spring_law: {name}", part, (springs,)) for name, part in named)
        return found if len(found) == 3 else (*found, _energy(function, lengths, rest_lengths, stiffness))

    return evaluate


#: Nodes and weights of Gauss and Legendre on [0, 1].
_NODES, _WEIGHTS = (lambda nodes, weights: ((nodes + 1) / 2, weights / 2))(*np.polynomial.legendre.leggauss(12))


def _energy(function: Any, lengths: Floats, rest_lengths: Floats, stiffness: Floats) -> Floats:
    """The integral of the tension from the rest length to the length, in J."""
    change = lengths - rest_lengths
    energy = np.zeros_like(lengths)
    for node, weight in zip(_NODES, _WEIGHTS):
        tension = _checked("spring_law: tension", function(rest_lengths + node * change, rest_lengths, stiffness)[0], lengths.shape)
        energy += weight * change * tension
    return energy


def _checked(key: str, value: Any, shape: tuple[int, ...], where: str = "") -> Floats:
    """A finite array of doubles of this shape."""
    array = _arrays.real(f"{key}{where}", value)
    if array.shape != shape:
        raise ValueError(f"{key}{where} = an array of shape {array.shape}: must have the shape {shape}")
    if not np.isfinite(array).all():
        at = tuple(int(index) for index in np.argwhere(~np.isfinite(array))[0])
        raise ValueError(f"{key}{[*at]}{where} = {float(array[at])!r}: must be finite")
    return array


def _described(value: Any) -> str:
    return f"a tuple of {len(value)}" if isinstance(value, tuple) else f"a {type(value).__name__}"
