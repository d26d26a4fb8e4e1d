"""A record as a sum of exponentially damped sinusoids about a midline: several modes, a drive, growth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.records.oscillation.spectrum import averaged

MOST = 1500
"""Samples that are fitted at most; of more, neighbours are averaged as long as a period keeps `PER_CYCLE`."""
PER_CYCLE = 12
APART = 0.6
"""Distance of two frequencies, in 1 over the record's length, from which they are sought as two lines."""
PADDED = 4
"""Times its length to which a record is padded before its spectrum is taken."""
SEARCHED = 6_000
"""Samples that a search takes of a record with more, drawn from all of it by chance, so that no frequency is taken for
another; what it finds is judged on all."""


@dataclass(frozen=True)
class Modes:
    """Damped sinusoids, the largest first: frequencies (k,) in Hz, decay rates (k,) in 1/s (below 0 where they grow)
    with standard errors (k,), amplitudes at the first and the last time (k,).

    left: share of the variance about the midline that they leave.
    """

    frequencies: np.ndarray
    rates: np.ndarray
    errors: np.ndarray
    first: np.ndarray
    last: np.ndarray
    left: float

    @property
    def ratios(self) -> np.ndarray:
        """Damping ratios of the modes, (k,), each decay rate over its undamped angular frequency."""
        return self.rates / np.hypot(self.rates, 2 * np.pi * self.frequencies)


def damped_modes(t: np.ndarray, y: np.ndarray, count: int) -> Modes | None:
    """The best fit of so many damped sinusoids and a constant to values y (n,) at times t (n,) in s.

    Amplitudes and phases are linear and solved for, frequencies and rates searched from the spectrum's lines (variable
    projection, Golub and Pereyra 1973). None where no search ends.
    """
    t, y = np.asarray(t, float) - t[0], np.asarray(y, float)
    found: _Fit | None = None
    for number in range(1, count + 1):
        found = _with_one_more(t, y, found)
        if found is None or found.points.shape[0] < number:
            return None
    assert found is not None
    return found.modes(t, y)


@dataclass(frozen=True)
class _Fit:
    points: np.ndarray
    """Angular frequencies and rates, (k, 2)."""
    left: np.ndarray

    def modes(self, t: np.ndarray, y: np.ndarray) -> Modes:
        omega, rate = self.points.T
        columns = _columns(t, self.points)
        c = np.linalg.lstsq(columns, y, rcond=None)[0]
        size = np.hypot(c[1::2], c[2::2])
        ends = size * np.exp(-rate * t[-1])
        order = np.argsort(-np.maximum(size, ends))
        variance = float(self.left @ self.left) / max(t.size - columns.shape[1] - self.points.size, 1)
        slopes = np.zeros((t.size, self.points.size))
        for i in range(len(self.points)):
            pair = columns[:, 1 + 2 * i : 3 + 2 * i] @ c[1 + 2 * i : 3 + 2 * i]
            turned = columns[:, 1 + 2 * i : 3 + 2 * i] @ np.array([c[2 + 2 * i], -c[1 + 2 * i]])
            slopes[:, 2 * i], slopes[:, 2 * i + 1] = t * turned, -t * pair
        both = np.column_stack([columns, slopes])
        spread = np.sqrt(variance * np.maximum(np.diag(np.linalg.pinv(both.T @ both)), 0.0))
        errors = spread[columns.shape[1] + 1 :: 2]
        whole = float(np.sum((y - c[0]) ** 2))
        return Modes(
            omega[order] / (2 * np.pi), rate[order], errors[order], size[order], ends[order],
            float(self.left @ self.left) / max(whole, 1e-300),
        )  # fmt: skip


def _columns(t: np.ndarray, points: np.ndarray) -> np.ndarray:
    """1, and cosine and sine of each mode, (n, 1 + 2k)."""
    parts = [np.ones_like(t)]
    for omega, rate in points:
        fall = np.exp(-np.clip(rate * t, -50, 50))
        parts += [fall * np.cos(omega * t), fall * np.sin(omega * t)]
    return np.column_stack(parts)


def _left(t: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
    columns = _columns(t, points)
    return y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]


def _with_one_more(t: np.ndarray, y: np.ndarray, before: _Fit | None) -> _Fit | None:
    """The best fit with one mode more, from lines of what is left and from frequencies near the modes there are."""
    rest = y - y.mean() if before is None else before.left
    points = np.empty((0, 2)) if before is None else before.points
    bin_width = 2 * np.pi / t[-1]
    starts = [_line(t, rest)]
    starts += [omega + side * bin_width for omega, _ in points for side in (-1.5, 1.5)]
    fall = 1.0 / t[-1]
    best: _Fit | None = None
    for omega in starts:
        if omega <= 0:
            continue
        begun = np.vstack([points, [omega, fall]])
        if best is not None and len(starts) > 1 and np.any(np.abs(points[:, 0] - omega) < APART * bin_width):
            continue
        found = _searched(t, y, begun)
        if found is not None and (
            best is None or float(found.left @ found.left) < float(best.left @ best.left)
        ):
            best = found
    return best


def _line(t: np.ndarray, y: np.ndarray) -> float:
    """Angular frequency of the strongest line."""
    spacing = float(np.median(np.diff(t)))
    grid = np.arange(0.0, t[-1], spacing)
    values = np.interp(grid, t, y)
    size = PADDED * grid.size
    power = np.abs(np.fft.rfft(values * np.hanning(grid.size + 2)[1:-1], size)) ** 2
    power[: PADDED * 2] = 0.0  # less than two cycles in a record are a drift
    return 2 * np.pi * float(np.argmax(power)) / (size * spacing)


def _searched(t: np.ndarray, y: np.ndarray, begun: np.ndarray) -> _Fit | None:
    from scipy.optimize import least_squares

    scale = np.tile([2 * np.pi / t[-1], 1.0 / t[-1]], len(begun))
    highest = np.pi / float(np.median(np.diff(t)))
    few, values = t, y
    if t.size > SEARCHED:
        some = np.sort(np.random.default_rng(0).choice(t.size, SEARCHED, replace=False))
        few, values = t[some], y[some]

    def residual(z: np.ndarray) -> np.ndarray:
        return _left(few, values, (z * scale).reshape(-1, 2))

    low = np.tile([0.5, -12.0], len(begun))
    high = np.tile([highest / scale[0], 60.0], len(begun))
    at = np.clip(begun.ravel() / scale, low + 1e-6, high - 1e-6)
    try:
        found = least_squares(
            residual, at, bounds=(low, high), max_nfev=60, x_scale=np.tile([0.1, 0.3], len(begun))
        )
    except (ValueError, np.linalg.LinAlgError):
        return None
    points = (found.x * scale).reshape(-1, 2)
    return _Fit(points, _left(t, y, points))


def few_samples(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The record with at most `MOST` samples, or `PER_CYCLE` a period where that is more: averages of neighbours."""
    cycles = float(t[-1] - t[0]) / period
    block = int(max(t.size // max(MOST, round(PER_CYCLE * cycles)), 1))
    block = min(block, max(int(period * t.size / float(t[-1] - t[0]) / PER_CYCLE), 1))
    return averaged(t, block), averaged(y, block)
