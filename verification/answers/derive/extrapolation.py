"""Ordinary differential equations to many digits by extrapolation (Gragg, Bulirsch and Stoer).

The modified midpoint rule over a step H, with n = 2, 4, 6, ... substeps, has an error in even powers of H/n; Aitken and Neville's
scheme over the first `columns` of them leaves an error of order 2 columns. Steps are of fixed length; the error is judged by doing
it all again with other columns and another H and comparing.
"""

from mpmath import mp, mpf


def midpoint(rate, t, y, step, n):
    """Gragg's modified midpoint rule: n substeps, smoothed at the end."""
    h = step / n
    before, now = y, [a + h * b for a, b in zip(y, rate(t, y))]
    for m in range(1, n):
        before, now = now, [a + 2 * h * b for a, b in zip(before, rate(t + m * h, now))]
    return [(a + b + h * c) / 2 for a, b, c in zip(before, now, rate(t + step, now))]


def extrapolated_step(rate, t, y, step, columns):
    table = []
    for j in range(1, columns + 1):
        row = [midpoint(rate, t, y, step, 2 * j)]
        for i, previous in enumerate(table[-1] if table else []):
            ratio = (mpf(j) / (j - 1 - i)) ** 2 - 1
            row.append([a + (a - b) / ratio for a, b in zip(row[i], previous)])
        table.append(row)
    return table[-1][-1]


def solve(rate, y, times, step, columns):
    """States at the given times, which ascend from 0."""
    t, states = mpf(0), []
    for end in times:
        count = int(mp.ceil((end - t) / step))
        start = t
        for m in range(count):
            y = extrapolated_step(rate, start + m * (end - start) / count, y, (end - start) / count, columns)
        t = end
        states.append(y)
    return states
