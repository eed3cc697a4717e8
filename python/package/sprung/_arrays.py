"""Conversion of arguments to arrays, with errors that name the argument and the index."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def real(name: str, value: ArrayLike) -> Floats:
    """Real numbers as doubles, without a copy where possible."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{name}: {error}") from None
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} = an array of {array.dtype}: must be an array of real numbers")
    with np.errstate(over="ignore"):
        return array.astype(np.float64, copy=False)


def number(name: str, value: ArrayLike) -> float:
    """One real number."""
    array = real(name, value)
    if array.ndim != 0:
        raise ValueError(f"{name} = an array of shape {array.shape}: must be one number")
    return float(array)


def positive(name: str, value: ArrayLike) -> float:
    """One finite and positive number."""
    found = number(name, value)
    if not (np.isfinite(found) and found > 0):
        raise ValueError(f"{name} = {found!r}: must be finite and positive")
    return found


def count(name: str, value: object, least: int = 1) -> int:
    """A whole number of things, at least so many."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise ValueError(f"{name} = {value!r}: must be {'a positive integer' if least == 1 else f'an integer, at least {least}'}")
    if value > sys.maxsize:
        raise ValueError(f"{name} = {value!r}: must be at most {sys.maxsize}")
    return int(value)


def rows(name: str, value: ArrayLike, of: str = "particle", width: int | None = None) -> Floats:
    """Rows of one to three numbers, contiguous."""
    array = real(name, value)
    if array.size == 0 and array.ndim < 2:
        array = np.zeros((0, 3 if width is None else width))
    if array.ndim != 2 or not 1 <= array.shape[1] <= 3 or (width is not None and array.shape[1] != width):
        length = "1, 2 or 3 numbers" if width is None else f"length {width}"
        raise ValueError(f"{name} = an array of shape {array.shape}: must have one row of {length} for each {of}")
    return np.ascontiguousarray(array)


def items(count: int, of: str) -> str:
    """Each of the things of this plural name, or the only one."""
    return f"the only {of.removesuffix('s')}" if count == 1 else f"each of the {count} {of}"


def each(name: str, value: ArrayLike, count: int, of: str, zero: bool = False) -> Floats:
    """One number for each of ``count`` items; a scalar is repeated."""
    array = real(name, value)
    if array.ndim == 0:
        if not (np.isfinite(array) and (array >= 0 if zero else array > 0)):
            rule = "not negative" if zero else "positive"
            raise ValueError(f"{name} = {float(array)!r}: must be finite and {rule}")
        return np.full(count, float(array))
    if array.shape != (count,):
        raise ValueError(f"{name} = an array of shape {array.shape}: must be one number, or one for {items(count, of)}")
    return array


def flags(name: str, value: ArrayLike, count: int, of: str) -> list[bool]:
    """One truth value for each of ``count`` items; a single one is repeated."""
    array = np.asarray(value)
    if array.dtype != bool or array.shape not in ((), (count,)):
        raise ValueError(f"{name} = {value!r}: must be True or False, or an array with one of them for {items(count, of)}")
    return np.broadcast_to(array, (count,)).tolist()


def integers(name: str, value: ArrayLike) -> NDArray[np.integer]:
    """Whole numbers."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{name}: {error}") from None
    if array.size == 0:
        return array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise ValueError(f"{name} = an array of {array.dtype}: must be an array of integers")
    return array


def pairs(name: str, value: ArrayLike, particles: int) -> NDArray[np.uint32]:
    """End points of springs, as indices of particles."""
    array = integers(name, value)
    if array.size == 0:
        array = array.reshape(0, 2)
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"{name} = an array of shape {array.shape}: must have one row of two for each spring")
    wrong = np.flatnonzero(((array < 0) | (array >= particles)).any(axis=1))
    if wrong.size:
        at = int(wrong[0])
        raise ValueError(
            f"{name}[{at}] = {array[at].tolist()}: names a particle that does not exist (there are {particles})"
        )
    return np.ascontiguousarray(array, dtype=np.uint32)


def dofs(particles: NDArray[np.int64], axes: NDArray[np.int8]) -> NDArray[np.int64]:
    """Particle and axis of every row of the matrices."""
    return np.column_stack([particles, axes.astype(np.int64)])
