"""The period of a decaying oscillation, coarsely: the local sinusoid that captures most of a record."""

from __future__ import annotations

import numpy as np

MOST = 16384
"""Samples that the search works on at most; longer records are averaged in blocks."""
LOST = 0.5
"""Share of the variance below which an average over blocks has lost something."""
UNSURE = 0.5
"""Share of the variance that an average over blocks must show in an oscillation to be believed."""
WITHIN = 4.5
"""Blocks of a period below which their averages do not show it."""
LINE = 4
"""Bins of a spectrum to either side of its highest that a decaying oscillation's line takes, about."""
WEAK = 0.1
"""Share of the strongest period's power below which another is none."""


def averaged(values: np.ndarray, block: int) -> np.ndarray:
    """Return the means of neighbouring values (n,), so many in each."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)


def on_grid(t: np.ndarray, y: np.ndarray, most: int = MOST) -> tuple[float, np.ndarray]:
    """(spacing in s, y on equally spaced times): shapes (n,) in, (m ≤ most,) out; linear interpolation."""
    block = -(-t.size // most)
    t, y = averaged(t, block), averaged(y, block)
    spacing = float((t[-1] - t[0]) / (t.size - 1))
    return spacing, np.interp(t[0] + spacing * np.arange(t.size), t, y)


def samples_a_cycle(t: np.ndarray, y: np.ndarray) -> float:
    """Samples in a cycle of the line that has most of a record's power, where it stands alone; nan elsewhere.

    t, y: shape (n,). Between 2 and 4 a record oscillates and is sampled too coarsely to be followed.
    """
    _, values = on_grid(t, y)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size + 2)[1:-1])) ** 2
    power[:2] = 0.0
    top = int(np.argmax(power))
    if top == 0 or power[max(top - LINE, 0) : top + LINE + 1].sum() < UNSURE * power.sum():
        return float("nan")
    return values.size / top


def captured(y: np.ndarray, samples: float) -> tuple[float, float]:
    """How much of y (n,) sinusoids of a period of so many samples capture, in windows of two periods.

    Returns the mean square captured beyond what white noise would give, and its share of all that is no
    trend.
    """
    length = int(min(max(round(2 * samples), 7), y.size))
    x = np.arange(length) - (length - 1) / 2
    trend = [np.ones(length), x] if length < 14 else [np.ones(length), x, x**2]
    angle = 2 * np.pi * x / samples
    basis = np.linalg.qr(np.stack([*trend, np.cos(angle), np.sin(angle)], axis=1))[0]
    windows = np.lib.stride_tricks.sliding_window_view(y, length)[:: max(1, length // 4)]
    windows = windows - windows.mean(axis=1, keepdims=True)
    power = (windows @ basis) ** 2
    wave = power[:, -2:].sum(axis=1)
    rest = np.maximum((windows**2).sum(axis=1) - power.sum(axis=1), 0.0)
    free = length - basis.shape[1]
    net = float(np.mean(wave - 2 * rest / free)) / length
    whole = float(np.mean(wave + rest)) / length
    return net, net / whole if whole > 0 else 0.0


def coarse_period(t: np.ndarray, y: np.ndarray, longest: float | None = None) -> tuple[float, float]:
    """(period in s to a few per cent, share 0..1 that the oscillation has in the record).

    t, y: shape (n,), t increasing; longest: longest period looked for, default the record's length. Only the
    average period is found where it changes with the amplitude. The share is near 0 for noise.
    """
    return coarse_periods(t, y, longest, 1)[0]


def coarse_periods(
    t: np.ndarray, y: np.ndarray, longest: float | None = None, most: int = 3
) -> list[tuple[float, float]]:
    """Up to `most` such periods with their shares, the most powerful first: where a hand moves a record to and fro,
    that may be the hand's.
    """
    spacing, coarse = on_grid(t, y)
    found = _periods(coarse, spacing, longest, most)
    if t.size <= MOST:
        return found
    left = float(np.var(coarse) / np.var(y))
    if left < LOST or found[0][1] < UNSURE or found[0][0] < WITHIN * spacing:
        # Averages over blocks miss what swings within one or a few: the liveliest piece of the samples themselves.
        ends = np.arange(MOST, t.size + 1, MOST)
        at = max(ends.tolist(), key=lambda end: float(np.var(y[end - MOST : end])))
        piece = slice(at - MOST, at)
        finer, values = on_grid(t[piece], y[piece])
        near = _periods(values, finer, None, most)
        # What they leave of it is an alias, as clean as itself: its share is then of all that the samples had.
        alias = left if near[0][0] < WITHIN * spacing else 1.0
        found = near if near[0][1] > found[0][1] * alias else found
    return found


def _periods(y: np.ndarray, spacing: float, longest: float | None, most: int) -> list[tuple[float, float]]:
    top = max((y.size - 1) if longest is None else longest / spacing, 4.4)
    grid = np.geomspace(4.0, top, int(28 * np.log10(top / 4.0)) + 3)
    scores, shares = np.array([captured(y, p) for p in grid]).T
    padded = np.pad(scores, 1, constant_values=-np.inf)
    peaks = np.flatnonzero((scores >= padded[:-2]) & (scores > padded[2:]) & (scores > WEAK * scores.max()))
    peaks = (
        peaks[np.argsort(-scores[peaks] * shares[peaks])] if peaks.size else np.argmax(scores, keepdims=True)
    )
    strongest = int(np.argmax(scores))
    peaks = [strongest, *(p for p in peaks.tolist() if p != strongest)][:most]
    found = []
    for best in peaks:
        fine = np.geomspace(grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)], 17)
        results = [captured(y, p) for p in fine]
        at = int(np.argmax([r[0] for r in results]))
        found.append((float(fine[at] * spacing), max(results[at][1], 0.0)))
    return found
