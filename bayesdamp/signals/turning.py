"""Turning points of an oscillation, to a fraction of the sampling interval, in noise and at any offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

PER_CYCLE = 48
"""Samples a cycle that suffice to find a turning point before it is refined on all samples."""


@dataclass(frozen=True)
class Turning:
    """Alternating maxima and minima: times (s), values (unit of y) and their noise per unit of noise, shape
    (k,).
    """

    times: np.ndarray
    values: np.ndarray
    gain: np.ndarray

    def cut(self, first: int, last: int) -> Turning:
        """Those from index first up to, not including, last."""
        return Turning(self.times[first:last], self.values[first:last], self.gain[first:last])


def thinned(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, int]:
    """(times, smoothed values, samples a period) on an equally spaced grid of at most PER_CYCLE samples a
    period.
    """
    mean_gap = (t[-1] - t[0]) / (t.size - 1)
    gap = max(mean_gap, period / PER_CYCLE)
    if gap > 1.5 * mean_gap:
        bins = np.minimum(((t - t[0]) / gap).astype(int), int((t[-1] - t[0]) / gap))
        starts = np.flatnonzero(np.diff(bins, prepend=-1))
        counts = np.diff(np.append(starts, t.size))
        t, y = np.add.reduceat(t, starts) / counts, np.add.reduceat(y, starts) / counts
    grid = np.arange(t[0], t[-1] + gap / 2, gap)
    values = np.interp(grid, t, y)
    a_period = max(round(period / gap), 3)
    if a_period >= 24:  # spikes must not count as turning points
        values = median_filter(values, 5 if a_period >= 40 else 3, mode="nearest")
    half = a_period // 10
    if half:
        kernel = np.hanning(2 * half + 3)[1:-1]
        padded = np.pad(values, half, mode="reflect", reflect_type="odd")
        values = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    return grid, values, a_period


def zigzag(y: np.ndarray, swing: np.ndarray) -> tuple[list[int], int]:
    """Indices of alternating extrema of y (n,), each confirmed by a way back of swing (n,); and whether the
    first
    is a maximum (1) or a minimum (−1). The ends of the record count where the way to the next one is long
    enough.
    """
    found: list[int] = []
    low = high = 0
    kind = first = 0
    for i in range(1, y.size):
        if y[i] > y[high]:
            high = i
        if y[i] < y[low]:
            low = i
        if kind >= 0 and y[i] < y[high] - swing[i]:
            found.append(high)
            first = first or 1
            kind, low = -1, i
        elif kind <= 0 and y[i] > y[low] + swing[i]:
            found.append(low)
            first = first or -1
            kind, high = 1, i
    if kind and found:
        found.append(high if kind > 0 else low)
    return found, first


def refine(
    t: np.ndarray, y: np.ndarray, at: float, kind: int, period: float, half: float
) -> tuple[float, float, float] | None:
    """(time, value, noise gain) of the extremum near `at`: kind 1 a maximum, −1 a minimum.

    A sinusoid of the given period with slowly changing amplitude, phase and midline is fitted to the samples
    within ± half (s). None where there are too few samples or the fit has no such extremum.
    """
    for width in (half, 1.5 * half, 2.25 * half):
        a, b = np.searchsorted(t, (at - width, at + width), side="left")
        if b - a >= 7:
            break
    if b - a < 5:
        return None
    centre = at
    scale = 2 * np.pi / period

    def basis(x: np.ndarray, order: int) -> np.ndarray:
        """Columns at phases x (n,), differentiated `order` times."""
        c, s = np.cos(x), np.sin(x)
        if order == 0:
            columns = [np.ones_like(x), c, s, x, x * c, x * s]
        elif order == 1:
            columns = [np.zeros_like(x), -s, c, np.ones_like(x), c - x * s, s + x * c]
        else:
            columns = [np.zeros_like(x), -c, -s, np.zeros_like(x), -2 * s - x * c, 2 * c - x * s]
        return np.stack(columns[: 6 if b - a >= 9 else 4 if b - a >= 6 else 3], axis=-1)

    x = scale * (t[a:b] - centre)
    columns, values = basis(x, 0), y[a:b]
    coefficients = np.linalg.lstsq(columns, values, rcond=1e-12)[0]
    residual = np.abs(values - columns @ coefficients)
    good = residual <= 6 * 1.4826 * np.median(residual) + 1e-300
    if 2 * columns.shape[1] <= good.sum() < good.size:
        columns, values = columns[good], values[good]
        coefficients = np.linalg.lstsq(columns, values, rcond=1e-12)[0]
    grid = np.linspace(max(x[0], -scale * width) - 0.06, min(x[-1], scale * width) + 0.06, 81)
    slope = basis(grid, 1) @ coefficients
    turns = np.flatnonzero(slope[:-1] * kind >= 0)
    turns = turns[slope[turns + 1] * kind < 0]
    if turns.size == 0:
        return None
    best = turns[np.argmin(np.abs(grid[turns]))]
    z = grid[best]
    if slope[best] != slope[best + 1]:
        z += (grid[1] - grid[0]) * slope[best] / (slope[best] - slope[best + 1])
    for _ in range(3):
        second = float(basis(np.array([z]), 2)[0] @ coefficients)
        if second * kind < 0:
            z -= np.clip(float(basis(np.array([z]), 1)[0] @ coefficients) / second, -0.02, 0.02)
    row = basis(np.array([z]), 0)[0]
    gain = float(np.linalg.norm(row @ np.linalg.pinv(columns, rcond=1e-12)))
    return float(centre + z / scale), float(row @ coefficients), gain


def turning_points(t: np.ndarray, y: np.ndarray, period: float, roughness: float = 0.0) -> Turning:
    """All turning points of y (n,) at t (n,); period: the coarse period in s; roughness: sd of the noise of
    y.

    The end of a record counts as a turning point where the fitted curve turns there.
    """
    grid, smooth, a_period = thinned(t, y, period)
    width = int(1.2 * a_period) | 1
    swing = 0.5 * (maximum_filter1d(smooth, width) - minimum_filter1d(smooth, width))
    found, first = zigzag(smooth, swing)
    spacing = (t[-1] - t[0]) / (t.size - 1)
    out: list[tuple[float, float, float]] = []
    kind = first
    for j, i in enumerate(found):
        near = grid[[k for k in found[max(j - 1, 0) : j + 2] if k != i]]
        local = (
            min(max(2 * float(np.mean(np.abs(near - grid[i]))), 0.5 * period), 2 * period)
            if near.size
            else period
        )
        half = _half_width(local, spacing, float(swing[i]), roughness)
        point = refine(t, y, float(grid[i]), kind, local, half)
        inside = t[0] + 0.1 * local < grid[i] < t[-1] - 0.1 * local
        if point is None and inside:
            out.append((float(grid[i]), float(smooth[i]), 1.0))
        elif point is not None and (inside or t[0] - 0.02 * local <= point[0] <= t[-1] + 0.02 * local):
            out.append((min(max(point[0], t[0]), t[-1]), *point[1:]))
        kind = -kind
    times, values, gain = np.array(out, float).reshape(-1, 3).T
    return Turning(times, values, gain)


def _half_width(period: float, spacing: float, amplitude: float, roughness: float) -> float:
    """The narrowest window in which noise moves a turning value by less than 0.1 % of the amplitude."""
    for share in (1 / 12, 1 / 8, 1 / 6):
        samples = 2 * share * period / spacing
        if samples >= 12 and 2.5 * roughness <= 1e-3 * amplitude * np.sqrt(samples):
            return share * period
    return period / 4


def midpoints(values: np.ndarray) -> np.ndarray:
    """The midline (k,) at turning values (k ≥ 3,), exact where the decay is geometric (Aitken's formula)."""
    before, here, after = values[:-2], values[1:-1], values[2:]
    bend = before + after - 2 * here
    inner = np.divide(before * after - here**2, bend, out=(before + 2 * here + after) / 4, where=bend != 0)
    return np.concatenate([inner[:1], inner, inner[-1:]])
