"""Kinematic constraints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _arrays


@dataclass(frozen=True)
class Constraint:
    """Particles whose coordinates along some axes are prescribed; later constraints override earlier ones.

    Parameters
    ----------
    particles : int or array_like of int
        The kinematic particles.
    axes : str or sequence of str, optional
        The prescribed axes, as ``"xy"`` or ``["x", "y"]``; default: all.
    velocity : array_like, optional
        In m/s: ``x(t) = x(0) + t velocity``.
    path : (times, offsets) or mapping with these keys, optional
        ``x(t) = x(0) + offset(t)``, piecewise linear and clamped at both ends; times in s, offsets in m.
        Without velocity and path the coordinates are held.
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
            raise ValueError(f"{key} = velocity and path: give only one of the two")
        velocity = path = None
        if self.velocity is not None:
            velocity = vector(f"{key}.velocity", self.velocity, dimension)
        if self.path is not None:
            path = _path(f"{key}.path", self.path, dimension)
        return numbers.ravel().tolist(), axes, velocity, path


def _axis(key: str, at: int, axis: str, dimension: int) -> int:
    number = "xyz".find(axis) if isinstance(axis, str) and len(axis) == 1 else -1
    if not 0 <= number < dimension:
        known = ", ".join("xyz"[:dimension])
        raise ValueError(f"{key}.axes[{at}] = {axis!r}: must be one of {known}")
    return number


def vector(key: str, value: ArrayLike, dimension: int) -> list[float]:
    vector = _arrays.real(key, value)
    if vector.shape != (dimension,):
        raise ValueError(f"{key} = an array of shape {vector.shape}: must have length {dimension}, as the positions")
    return [*vector.tolist(), *[0.0] * (3 - dimension)]


def _path(key: str, path: Any, dimension: int) -> tuple[list[float], list[list[float]]]:
    times, offsets = curve(key, path, "offsets")
    return times, vectors(f"{key}.offsets", offsets, dimension)


def curve(key: str, path: Any, values: str) -> tuple[list[float], Any]:
    """Times and values of a piecewise linear function, from a pair or from a mapping with these keys."""
    if isinstance(path, Mapping):
        if set(path) != {"times", values}:
            raise ValueError(f"{key} = {sorted(path)}: must have the keys times and {values}")
        path = path["times"], path[values]
    try:
        times, found = path
    except (TypeError, ValueError):
        raise ValueError(f"{key} = {path!r}: must be (times, {values})") from None
    return np.atleast_1d(_arrays.real(f"{key}.times", times)).ravel().tolist(), found


def vectors(key: str, rows: ArrayLike, dimension: int, of: str = "time") -> list[list[float]]:
    """Rows of three numbers, zero along axes that are not modelled."""
    rows = _arrays.rows(key, rows, of=of, width=dimension)
    return np.hstack([rows, np.zeros((len(rows), 3 - dimension))]).tolist()


def actuation(index: int, entry: Any) -> tuple[list[int], list[float], list[float]]:
    """Springs, times and factors, from a mapping with the keys of a scene file."""
    key = f"actuation[{index}]"
    if not isinstance(entry, Mapping) or set(entry) != {"springs", "path"}:
        raise ValueError(f"{key} = {entry!r}: must be a mapping with the keys springs and path")
    numbers = np.atleast_1d(_arrays.integers(f"{key}.springs", entry["springs"])).ravel()
    wrong = np.flatnonzero(numbers < 0)
    if wrong.size:
        at = int(wrong[0])
        raise ValueError(f"{key}.springs[{at}] = {int(numbers[at])}: names a spring that does not exist")
    times, factors = curve(f"{key}.path", entry["path"], "factors")
    return numbers.tolist(), times, np.atleast_1d(_arrays.real(f"{key}.path.factors", factors)).ravel().tolist()


def constraint(index: int, entry: Any) -> Constraint:
    """A constraint from itself or from a mapping with the keys of a scene file."""
    if isinstance(entry, Constraint):
        return entry
    if not isinstance(entry, Mapping):
        raise ValueError(f"constraints[{index}] = {entry!r}: must be a Constraint or a mapping")
    unknown = sorted(set(entry) - {"particles", "axes", "velocity", "path"})
    if unknown:
        raise ValueError(f"constraints[{index}] = {unknown[0]!r}: unknown key")
    if "particles" not in entry:
        raise ValueError(f"constraints[{index}].particles: must be given")
    return Constraint(**entry)
