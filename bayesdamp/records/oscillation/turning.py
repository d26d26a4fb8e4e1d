"""Find the turning points of a noisy oscillation with any offset, to a fraction of the sampling interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.records.oscillation.noise import group_by_size

PER_CYCLE = 48
"""Largest number of samples a cycle to which a record is reduced for the first search of turning points, which are then
refined with all samples."""
FEW_TURNS = 7
"""If fewer turning points than this are found, the search is repeated, and an extremum counts if the values then return
from it by half the distance that was required before. Under heavy damping a half cycle may be less than half of the one
before."""
LEAST_SAMPLES = 9
"""The window of samples around a turning point is widened until it has this many samples, which are enough to determine
a sinusoid with changing amplitude, phase and midline."""
GRID_POINTS = 81
"""Number of points on a fitted curve among which its extremum is searched (conventional)."""


@dataclass(frozen=True)
class TurningPoints:
    """Turning points: alternating maxima and minima.

    Attributes
    ----------
    times
        Times in s, (k,).
    values
        Values in the unit of the record, (k,).
    gain
        Standard deviation of the noise of each value, relative to that of a sample, (k,).
    """

    times: np.ndarray
    values: np.ndarray
    gain: np.ndarray

    def cut(self, first: int, last: int) -> TurningPoints:
        """Return the turning points with indices `first` to `last` − 1."""
        return TurningPoints(self.times[first:last], self.values[first:last], self.gain[first:last])


def true_runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return start and end (exclusive) of each run of true values in flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def local_median(values: np.ndarray) -> np.ndarray:
    """Return for each of the values (k,) the median of it and up to four neighbours on either side, (k,)."""
    padded = np.pad(values.astype(float), 4, constant_values=np.nan)
    return np.nanmedian(np.lib.stride_tricks.sliding_window_view(padded, 9).copy(), axis=1)


def resample(
    t: np.ndarray, y: np.ndarray, period: float, smooth: bool = True
) -> tuple[np.ndarray, np.ndarray, int]:
    """Interpolate a record linearly on an equally spaced grid with at most PER_CYCLE samples a period.

    Samples that are much denser than the grid are averaged first.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the oscillation, in s.
    smooth
        Whether to reduce spikes (with a median filter, from 24 grid points a period on) and noise (with a moving
        average, from 10 on).

    Returns
    -------
    tuple
        Times in s and values on the grid, each (m,), and the number of grid points in a period, rounded, at least 3.
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
    if not smooth:
        return grid, values, a_period
    if a_period >= 24:  # so that spikes do not count as turning points
        values = scipy.ndimage.median_filter(values, 5 if a_period >= 40 else 3, mode="nearest")
    half = a_period // 10
    if half:
        kernel = np.hanning(2 * half + 3)[1:-1]
        padded = np.pad(values, half, mode="reflect", reflect_type="odd")
        values = np.convolve(padded, kernel / kernel.sum(), mode="valid")
    return grid, values, a_period


def zigzag(y: np.ndarray, swing: np.ndarray) -> tuple[list[int], int]:
    """Find alternating extrema; each but the last counts only if the values then return by more than a given distance.

    The first may be the first value. The last is the extremum after the last return, however small the return from it;
    it may be the last value.

    Parameters
    ----------
    y
        Values, (n,).
    swing
        Distance of the return, in the unit of y, (n,): an extremum e counts once a later value v_i differs from it by
        more than swing_i.

    Returns
    -------
    tuple
        Indices of the extrema, and 1 if the first is a maximum, −1 if it is a minimum, 0 if there are none.
    """
    extrema: list[int] = []
    kind = first = low = high = 0
    values, swings = y.tolist(), swing.tolist()
    for i in (np.flatnonzero(np.diff(y)) + 1).tolist():
        value = values[i]
        if value > values[i - 1]:
            high = i if value > values[high] else high
            if kind <= 0 and value - swings[i] > values[low]:
                extrema.append(low)
                first = first or -1
                kind, high = 1, i
        else:
            low = i if value < values[low] else low
            if kind >= 0 and value + swings[i] < values[high]:
                extrema.append(high)
                first = first or 1
                kind, low = -1, i
    if kind:
        extrema.append(high if kind > 0 else low)
    return extrema, first


def _basis(x: np.ndarray, order: int) -> np.ndarray:
    """Return the basis 1, cos x, sin x, x, x cos x, x sin x at phases x (...) in rad, (..., 6).

    order: 0 for the basis itself, 1 or 2 for its first or second derivative by x.
    """
    c, s, zero, unity = np.cos(x), np.sin(x), np.zeros_like(x), np.ones_like(x)
    if order == 0:
        columns = [unity, c, s, x, x * c, x * s]
    elif order == 1:
        columns = [zero, -s, c, unity, c - x * s, s + x * c]
    else:
        columns = [zero, -c, -s, zero, -2 * s - x * c, 2 * c - x * s]
    return np.stack(columns, axis=-1)


def _solve(columns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return least-squares coefficients (w, 6) and the pseudo-inverse (w, 6, n); both are 0 beyond the k ≤ 6 columns.

    columns: (w, n, k); values: (w, n).
    """
    inverse = np.linalg.pinv(columns, rcond=1e-12)
    inverse = np.pad(inverse, ((0, 0), (0, 6 - columns.shape[2]), (0, 0)))
    return (inverse @ values[:, :, None])[:, :, 0], inverse


def refine(
    t: np.ndarray, y: np.ndarray, at: np.ndarray, kind: np.ndarray, period: np.ndarray, half: np.ndarray
) -> np.ndarray:
    """Return time (s), value and noise gain of the extremum nearest to each of the times `at` (k,), (k, 3).

    A sinusoid with slowly changing amplitude, phase and midline (with fewer than 9 samples a simpler one) is fitted to
    the samples near each time, without outliers. The noise gain is the sd of the value for noise of sd 1 in each
    sample. A row is NaN if there are fewer than five samples or the fit has no such extremum in the window.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    at
        Approximate times of the extrema, s, (k,).
    kind
        1 for a maximum, −1 for a minimum, (k,).
    period
        Period of the oscillation near each, s, (k,).
    half
        Half width of each window, s, (k,); it is widened up to threefold to contain `LEAST_SAMPLES` samples.
    """
    out = np.full((at.size, 3), np.nan)
    width = half.copy()
    for wider in (1.5, 2.25, 3.0):
        few = np.searchsorted(t, at + width) - np.searchsorted(t, at - width) < LEAST_SAMPLES
        if wider > 2.5:  # at the ends of a record the window would become one-sided
            few &= (at - wider * half >= t[0]) & (at + wider * half <= t[-1])
        width[few] = wider * half[few]
    begins = np.searchsorted(t, at - width)
    sizes = np.searchsorted(t, at + width) - begins
    for n, same in group_by_size(sizes, 5, GRID_POINTS):
        rows = begins[same][:, None] + np.arange(n)
        scale = 2 * np.pi / period[same]
        x = scale[:, None] * (t[rows] - at[same][:, None])
        out[same] = _fit_extrema(x, y[rows], kind[same].astype(float), scale * width[same])
        out[same, 0] = at[same] + out[same, 0] / scale
    return out


def _fit_extrema(x: np.ndarray, values: np.ndarray, kind: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return phase, value and noise gain of the extremum nearest to phase 0 in each window, (w, 3); NaN if it has none.

    The extremum is that of a sinusoid fitted to the samples (`refine`). The noise gain is the sd of the value for noise
    of sd 1 in each sample. x: phases of the samples in rad, (w, n); values: their values, (w, n); kind: 1 for a
    maximum, −1 for a minimum, (w,); width: half width of the window as a phase in rad, (w,).
    """
    n = x.shape[1]
    columns = _basis(x, 0)[:, :, : 6 if n >= 9 else 4 if n >= 6 else 3]
    c, inverse = _solve(columns, values)
    # Fit again without outliers.
    off = np.abs(values - (columns @ c[:, : columns.shape[2], None])[:, :, 0])
    good = off <= 6 * 1.4826 * np.median(off, axis=1, keepdims=True) + 1e-300
    count = good.sum(axis=1)
    again = np.flatnonzero((count >= 2 * columns.shape[2]) & (count < n))
    if again.size:
        good_columns, good_values = columns[again] * good[again][:, :, None], values[again] * good[again]
        c[again], inverse[again] = _solve(good_columns, good_values)
    # Find the sign change of the slope nearest to phase 0, then refine it by Newton's method.
    far = np.minimum(width, 2.0)
    edges = np.stack([np.maximum(x[:, 0], -far) - 0.06, np.minimum(x[:, -1], far) + 0.06])
    grid = np.linspace(edges[0], edges[1], GRID_POINTS, axis=1)
    slope = (_basis(grid, 1) @ c[:, :, None])[:, :, 0]
    here = (slope[:, :-1] * kind[:, None] >= 0) & (slope[:, 1:] * kind[:, None] < 0)
    best = np.argmin(np.where(here, np.abs(grid[:, :-1]), np.inf), axis=1)
    row = np.arange(kind.size)
    step, before, after = grid[:, 1] - grid[:, 0], slope[row, best], slope[row, best + 1]
    fall = before - after
    z = grid[row, best] + np.where(fall != 0, step * before / np.where(fall != 0, fall, 1.0), 0.0)
    for _ in range(3):
        second = np.sum(_basis(z, 2) * c, axis=1)
        turns = second * kind < 0
        move = np.sum(_basis(z, 1) * c, axis=1) / np.where(turns, second, 1.0)
        z = z - np.where(turns, np.clip(move, -0.02, 0.02), 0.0)
    basis = _basis(z, 0)
    gain = np.linalg.norm((basis[:, None, :] @ inverse)[:, 0, :], axis=1)
    extrema = np.stack([z, np.sum(basis * c, axis=1), gain], axis=1)
    extrema[~here.any(axis=1)] = np.nan
    return extrema


def turning_points(t: np.ndarray, y: np.ndarray, period: float, roughness: float = 0.0) -> TurningPoints:
    """Return the turning points of a record, in time order; none (k = 0) if nothing turns.

    An extremum counts if the values then return by half their range within about a period (by a quarter if this gives
    fewer than `FEW_TURNS`). It is refined by a local fit (`refine`); where this fails, the smoothed value with gain 1
    is used. An end of the record counts as a turning point if the fitted curve has its extremum there.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Approximate period in s.
    roughness
        Standard deviation of the noise of a sample, in the unit of y; if it is small, the fits use narrower windows.
    """
    grid, smooth, a_period = resample(t, y, period)
    width = int(1.2 * a_period) | 1
    swing = 0.5 * (
        scipy.ndimage.maximum_filter1d(smooth, width) - scipy.ndimage.minimum_filter1d(smooth, width)
    )
    extrema, first = zigzag(smooth, swing)
    if len(extrema) < FEW_TURNS:  # heavy damping: each half cycle is less than half of the one before
        extrema, first = zigzag(smooth, 0.5 * swing)
    if not extrema:
        return TurningPoints(*np.empty((3, 0)))
    spacing = (t[-1] - t[0]) / (t.size - 1)
    index = np.array(extrema)
    at, kind = grid[index], first * (-1.0) ** np.arange(index.size)
    gaps = np.diff(at)
    local = np.full(at.size, period)
    if gaps.size:  # local period: twice the mean distance to the neighbours
        near = np.concatenate([gaps[:1], 0.5 * (gaps[1:] + gaps[:-1]), gaps[-1:]])
        local = np.clip(2 * near, 0.5 * period, 2 * period)
    # Use the narrowest windows with which noise changes a turning value by less than 0.1 % of the amplitude.
    half = local / 4
    for share in (1 / 6, 1 / 8, 1 / 12):
        samples = 2 * share * local / spacing
        fine = (samples >= 12) & (2.5 * roughness <= 1e-3 * swing[index] * np.sqrt(samples))
        half = np.where(fine, share * local, half)
    points = refine(t, y, at, kind, local, half)
    inside = (at > t[0] + 0.1 * local) & (at < t[-1] - 0.1 * local)
    none = np.isnan(points[:, 0])
    points[none] = np.stack([at, smooth[index], np.ones(at.size)], axis=1)[none]
    times = points[:, 0]
    good = inside | (~none & (times >= t[0] - 0.02 * local) & (times <= t[-1] + 0.02 * local))
    points[:, 0] = np.where(none, times, np.clip(times, t[0], t[-1]))
    return TurningPoints(*points[good].T)


def midpoints(values: np.ndarray) -> np.ndarray:
    """Return the midline (k,) at each of k ≥ 3 turning values; exact for a geometric decay (Aitken's formula).

    At the first and the last one it is that of the neighbour.
    """
    before, here, after = values[:-2], values[1:-1], values[2:]
    second_difference = before + after - 2 * here
    inner = np.divide(
        before * after - here**2,
        second_difference,
        out=(before + 2 * here + after) / 4,
        where=second_difference != 0,
    )
    return np.concatenate([inner[:1], inner, inner[-1:]])
