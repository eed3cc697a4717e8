"""Writing answers: correctly rounded doubles, and JSON that a person can read."""

import json
import math
from fractions import Fraction
from pathlib import Path

from mpmath import mp, mpf

FOLDER = Path(__file__).resolve().parent.parent


def double(value):
    """The double nearest to a multiprecision number (ties to even)."""
    value = mpf(value)
    if not mp.isfinite(value):
        raise ValueError(f"not a number to store: {value}")
    sign, mantissa, exponent, _ = value._mpf_
    exact = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    return float(-exact if sign else exact)


def doubles(value):
    """Doubles for numbers, vectors, matrices and anything nested of them; None, text, bool and int stay."""
    if isinstance(value, mp.matrix):
        if value.cols == 1:
            return [double(c) for c in value]
        return [[double(value[i, j]) for j in range(value.cols)] for i in range(value.rows)]
    if isinstance(value, dict):
        return {key: doubles(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [doubles(v) for v in value]
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    return double(value)


def settle(value, scale=1):
    """Numbers below 10^-40 of the scale, which only the rounding of a solve keeps from being zero, as zero."""
    if isinstance(value, mp.matrix):
        return value.apply(lambda c: settle(c, scale))
    if isinstance(value, (list, tuple)):
        return [settle(v, scale) for v in value]
    return mpf(0) if abs(value) < mpf(10) ** -40 * scale else value


def close(a, b, tolerance=mpf(10) ** -35):
    """Refuse to go on unless two ways to a number agree (relative to the larger, or to 1)."""
    a, b = mpf(a), mpf(b)
    if not abs(a - b) <= tolerance * max(1, abs(a), abs(b)):
        raise AssertionError(f"{mp.nstr(a, 20)} and {mp.nstr(b, 20)} differ by more than {mp.nstr(tolerance, 3)}")


def close_rows(a, b, tolerance=mpf(10) ** -35):
    """close() for rows of vectors."""
    for p, q in zip(a, b, strict=True):
        for c, d in zip(p, q, strict=True):
            close(c, d, tolerance)


def _text(value, indent):
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("JSON has no such number")
    flat = json.dumps(value, ensure_ascii=False)
    one_row = isinstance(value, list) and not any(isinstance(v, (dict, list)) for v in value)
    if one_row or not isinstance(value, (dict, list)) or len(flat) + indent <= 132:
        return flat
    pad = " " * (indent + 1)
    if isinstance(value, dict):
        inner = [f"{pad}{json.dumps(k)}: {_text(v, indent + 1)}" for k, v in value.items()]
        return "{\n" + ",\n".join(inner) + "\n" + " " * indent + "}"
    return "[\n" + ",\n".join(pad + _text(v, indent + 1) for v in value) + "\n" + " " * indent + "]"


def write(name, claim, derivation, cases):
    """Write answers/<name>.json."""
    content = {"name": name, "claim": claim, "derivation": derivation, "cases": doubles(cases)}
    path = FOLDER / f"{name}.json"
    path.write_text(_text(content, 0) + "\n", encoding="utf-8")
    print(f"{path.name}: {len(cases)} cases, {path.stat().st_size} bytes")
