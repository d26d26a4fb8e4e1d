"""Stamps of an even sampling that are written to few digits: the sampling that they are rounded from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

UNITS = (1.0, 60.0, 3600.0, 86400.0)
"""Seconds in which a file may count its times."""
COARSEST, FINEST = -3, 12
"""Decimals that are looked for."""
HALF = 0.5 + 1e-6
"""Of the last digit, by which a rounded stamp may be off; two stamps that are cut off lie within as much of a line."""
FEWEST = 8
"""Steps between stamps that must differ from the usual one: a single row that is missing, or stands twice, looks like
stamps of another step. Eight faults by chance lie as evenly in a few of a thousand records (8!/8⁸ = 0.24 %)."""
BLOCKS = 500
"""Of stamps, of which the outermost bound a line."""
ROUNDS = 6


@dataclass(frozen=True)
class Even:
    """An even sampling: its step in s per row, the last digit of the coarsest stamps in s, the largest distance of a
    stamp from it in s."""

    step: float
    digit: float
    off: float


def even(rows: np.ndarray, t: np.ndarray) -> Even | None:
    """The even sampling of which times t (n,) in s at rows (n,) are the rounded, or the cut off, stamps; None where
    there is none, or where the stamps have as many digits as a double."""
    digits = _digits(t)
    if digits is None or not _unequal(rows, t, digits):
        return None
    x, scale = rows - float(rows.mean()), 1 / digits
    at, step = _line(x, t, scale)
    left = t - at - step * x
    if np.abs(left * scale).max() > HALF:
        more = _narrowest(x, left, scale)
        at, step = at + more[0], step + more[1]
        left = t - at - step * x
    if step <= 0 or np.abs(left * scale).max() > HALF:
        return None
    return Even(step, float(digits.max()), float(np.abs(left).max()))


def _unequal(rows: np.ndarray, t: np.ndarray, digits: np.ndarray) -> bool:
    """Whether steps of the stamps from one row to the next differ `FEWEST` times from the usual one."""
    steps = np.diff(t)[np.diff(rows) == 1]
    if steps.size < FEWEST:
        return False
    return bool(np.sum(np.abs(steps - np.median(steps)) > 0.5 * digits.min()) >= FEWEST)


def _digits(t: np.ndarray) -> np.ndarray | None:
    """The last digit, in s, of each of the times t (n,), alike within a power of ten; None where these have none."""
    size = np.abs(t)
    rounding = 4 * np.finfo(float).eps * float(size.max())
    decade = np.floor(np.log10(np.maximum(size, 1e-300)))
    decade = np.maximum(decade, np.unique(decade)[min(1, np.unique(decade).size - 1)])  # a zero has no size
    found = np.zeros(t.size)
    for one in np.unique(decade):
        inside = decade == one
        last = max(unit * _last_digit(t[inside] / unit, rounding / unit) for unit in UNITS)
        if last == 0.0:
            return None
        found[inside] = last
    return np.maximum(found, 2 * rounding)


def _last_digit(t: np.ndarray, rounding: float) -> float:
    """The largest power of ten of which all of t (n,) are multiples; 0 where rounding hides it."""
    for decimals in range(COARSEST, FINEST + 1):
        digit = 10.0**-decimals
        if digit < 4 * rounding:
            break
        if np.all(np.abs(t - digit * np.round(t / digit)) <= rounding):
            return digit
    return 0.0


def _line(x: np.ndarray, t: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """(value at x = 0, slope) of a line by weighted least squares."""
    w = weight**2 / float(np.sum(weight**2))
    mean_x, mean_t = float(np.sum(w * x)), float(np.sum(w * t))
    slope = float(np.sum(w * (x - mean_x) * (t - mean_t)) / np.sum(w * (x - mean_x) ** 2))
    return mean_t - slope * mean_x, slope


def _narrowest(x: np.ndarray, t: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """(value at x = 0, slope) of the line whose largest weighted distance from t (n,) is least: of the stamps that are
    outermost in each block of rows, with those that the line so found still leaves outside."""
    from scipy.optimize import linprog

    wide = float(np.abs(x).max())
    bounds = [(None, None), (None, None), (0.0, None)]
    edges = np.linspace(0, t.size, min(BLOCKS, t.size) + 1).astype(int)
    at, slope, some = 0.0, 0.0, np.array([], int)
    for _ in range(ROUNDS):
        left = weight * (t - at - slope * x)
        outermost = [a + f(left[a:b]) for a, b in pairwise(edges) for f in (np.argmin, np.argmax)]
        some = np.union1d(some, outermost)
        w, values = weight[some], weight[some] * t[some]
        columns, reach = np.column_stack([w, w * x[some] / wide]), -np.ones((some.size, 1))
        limits = np.block([[columns, reach], [-columns, reach]])
        found = linprog([0.0, 0.0, 1.0], limits, np.concatenate([values, -values]), bounds=bounds)
        if not found.success:
            break
        at, slope = float(found.x[0]), float(found.x[1]) / wide
        if np.abs(weight * (t - at - slope * x)).max() <= found.x[2] + 1e-7:
            break
    return at, slope
