"""Estimate the period of a decaying oscillation coarsely: by the local sinusoid that explains most of a record."""

from __future__ import annotations

import numpy as np

MOST = 16384
"""Samples that the search uses at most; longer records are averaged in blocks."""
SHORTEST = 4.0
"""Samples in the shortest period that is searched."""
LOST = 0.5
"""Share of the variance below which an average over blocks has lost the oscillation."""
UNSURE = 0.5
"""Share of the variance that an oscillation must have in an average over blocks to be accepted."""
WITHIN = 4.5
"""Blocks of a period below which their averages do not show it."""
LINE = 4
"""Bins of a spectrum to either side of its highest that the line of a decaying oscillation covers, about."""
WEAK = 0.1
"""Share of the strongest period's power below which another is ignored."""


def averaged(values: np.ndarray, block: int) -> np.ndarray:
    """Return the means of blocks of so many neighbouring values (n,)."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)


def on_grid(t: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Interpolate y (n,) linearly on equally spaced times: return their spacing in s and the values, (m ≤ MOST,)."""
    block = -(-t.size // MOST)
    t, y = averaged(t, block), averaged(y, block)
    spacing = float((t[-1] - t[0]) / (t.size - 1))
    return spacing, np.interp(t[0] + spacing * np.arange(t.size), t, y)


def samples_a_cycle(t: np.ndarray, y: np.ndarray) -> float:
    """Return the samples in a cycle of the line that has most of a record's power, nan where it is not isolated.

    Between 2 and 4, a record oscillates but is sampled too coarsely to be followed.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    """
    _, values = on_grid(t, y)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size + 2)[1:-1])) ** 2
    power[:2] = 0.0
    top = int(np.argmax(power))
    if top == 0 or power[max(top - LINE, 0) : top + LINE + 1].sum() < UNSURE * power.sum():
        return float("nan")
    return values.size / top


def captured(y: np.ndarray, samples: float) -> tuple[float, float]:
    """Return how much of a record sinusoids of one period explain, in windows of two periods.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    samples
        In a period.

    Returns
    -------
    tuple of float
        The explained mean square beyond that of white noise, and its share of all but the trend.
    """
    length = int(min(max(round(2 * samples), 7), y.size))
    u = np.linspace(-1.0, 1.0, length)
    angle = np.pi * (length - 1) / samples * u
    trend = [np.ones(length), u] if length < 14 else [np.ones(length), u, u**2]
    basis = np.stack([*trend, np.cos(angle), np.sin(angle)])
    windows = np.lib.stride_tricks.sliding_window_view(y, length)[:: max(1, length // 4)]
    windows = windows - windows.mean(axis=1, keepdims=True)
    # The Cholesky factor makes the basis orthonormal in its order: the sinusoid beyond the trend comes last.
    factor = np.linalg.cholesky(basis @ basis.T)
    power = (np.linalg.inv(factor) @ (basis @ windows.T)) ** 2
    wave = power[-2:].sum(axis=0)
    rest = np.maximum((windows**2).sum(axis=1) - power.sum(axis=0), 0.0)
    free = length - len(basis)
    net = float(np.mean(wave - 2 * rest / free)) / length
    whole = float(np.mean(wave + rest)) / length
    return net, net / whole if whole > 0 else 0.0


def coarse_period(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the period in s, to a few per cent, and the share 0..1 that the oscillation has in the record.

    The period is an average where it changes with the amplitude. The share is near 0 for noise.

    Parameters
    ----------
    t, y
        Increasing times in s and values, each (n,).
    """
    return coarse_periods(t, y, 1)[0]


def coarse_periods(t: np.ndarray, y: np.ndarray, most: int = 3) -> list[tuple[float, float]]:
    """Return up to `most` periods with their shares, the most powerful first, as `coarse_period`.

    Where a hand moves the object to and fro, the first may be the hand's.
    """
    spacing, coarse = on_grid(t, y)
    periods = _search_periods(coarse, spacing, most)
    if t.size <= MOST:
        return periods
    left = float(np.var(coarse) / np.var(y))
    if left < LOST or periods[0][1] < UNSURE or periods[0][0] < WITHIN * spacing:
        # Averages over blocks miss what swings within one or a few: use the samples of the piece that varies most.
        ends = np.arange(MOST, t.size + 1, MOST)
        at = max(ends.tolist(), key=lambda end: float(np.var(y[end - MOST : end])))
        piece = slice(at - MOST, at)
        finer, values = on_grid(t[piece], y[piece])
        near = _search_periods(values, finer, most)
        # What the averages leave of it is an alias, as clean as itself: its share is then that of all samples.
        alias = left if near[0][0] < WITHIN * spacing else 1.0
        periods = near if near[0][1] > periods[0][1] * alias else periods
    return periods


def _search_periods(y: np.ndarray, spacing: float, most: int) -> list[tuple[float, float]]:
    """Return up to `most` periods in s with their shares, of equally spaced values y (n,), the most powerful first."""
    top = max(y.size - 1, 4.4)
    grid = np.geomspace(SHORTEST, top, int(28 * np.log10(top / SHORTEST)) + 3)
    scores, shares = np.array([captured(y, p) for p in grid]).T
    padded = np.pad(scores, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((scores >= padded[:-2]) & (scores > padded[2:]) & (scores > WEAK * scores.max()))
    peaks = peaks[np.argsort(-scores[peaks] * shares[peaks])]
    strongest = int(np.argmax(scores))
    peaks = [strongest, *(p for p in peaks.tolist() if p != strongest)][:most]
    periods = []
    for best in peaks:
        fine = np.geomspace(grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)], 17)
        results = [captured(y, p) for p in fine]
        at = int(np.argmax([r[0] for r in results]))
        periods.append((float(fine[at] * spacing), max(results[at][1], 0.0)))
    return periods
