"""Estimate the period of a decaying oscillation coarsely: that of the sinusoids which explain most of the record."""

from __future__ import annotations

import numpy as np

MOST_SAMPLES = 16384
"""Largest number of samples in which a period is searched for; longer records are averaged in blocks first
(conventional)."""
SHORTEST_PERIOD = 4.0
"""Number of samples in the shortest period that is searched for."""
LEAST_VARIANCE = 0.5
"""If averages of the samples in blocks have less than this fraction of the variance of the samples, averaging may have
removed the oscillation, and the samples themselves are searched too."""
SURE_FRACTION = 0.5
"""An oscillation in block averages is accepted if it has at least this fraction of their variance, and a spectral line
if it has at least this fraction of the power."""
ALIAS_BLOCKS = 4.5
"""A period that was found in block averages may be an alias of a faster oscillation if it is shorter than this many
blocks."""
LINE_BINS = 4
"""Approximate half width, in bins of a spectrum, of the line of a decaying oscillation."""
LEAST_SHARE = 0.3
"""Smallest fraction of the variance of a record about its slow trend that the strongest oscillation must explain
(computed by `coarse_period`); with less, a record is refused, and a column does not oscillate."""
WEAK_POWER = 0.1
"""A period whose sinusoids explain less than this fraction of the power that those of the strongest period explain is
ignored."""


def block_means(values: np.ndarray, block: int) -> np.ndarray:
    """Return the means of successive blocks of `block` values (n,); an incomplete last block is dropped."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)


def on_grid(t: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the spacing in s and the values, (m ≤ MOST_SAMPLES,), of a record on equally spaced times.

    t, y: times in s and values, (n,). Long records are averaged in blocks first; then values are interpolated linearly.
    """
    block = -(-t.size // MOST_SAMPLES)
    t, y = block_means(t, block), block_means(y, block)
    spacing = float((t[-1] - t[0]) / (t.size - 1))
    return spacing, np.interp(t[0] + spacing * np.arange(t.size), t, y)


def samples_a_cycle(t: np.ndarray, y: np.ndarray) -> float:
    """Return the number of samples in a cycle of the strongest spectral line with at least two cycles in the record.

    The result is NaN if the line has less than half of the power. With fewer than 4 samples a cycle, the oscillation in
    a record cannot be followed.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    """
    values = np.interp(np.linspace(t[0], t[-1], t.size), t, y)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size + 2)[1:-1])) ** 2
    power[:2] = 0.0
    top = int(np.argmax(power))
    if top == 0 or power[max(top - LINE_BINS, 0) : top + LINE_BINS + 1].sum() < SURE_FRACTION * power.sum():
        return float("nan")
    return values.size / top


def explained_power(y: np.ndarray, samples: float) -> tuple[float, float]:
    """Return how much of a record sinusoids of a given period explain, fitted in windows of two periods.

    Parameters
    ----------
    y
        Equally spaced values, (n,).
    samples
        Number of samples in a period.

    Returns
    -------
    tuple of float
        The explained mean square (in the squared unit of y) minus that expected for white noise, and its fraction of
        the mean square about the trend. Both may be slightly below 0.
    """
    length = int(min(max(round(2 * samples), 7), y.size))
    u = np.linspace(-1.0, 1.0, length)
    angle = np.pi * (length - 1) / samples * u
    trend = [np.ones(length), u] if length < 14 else [np.ones(length), u, u**2]
    basis = np.stack([*trend, np.cos(angle), np.sin(angle)])
    windows = np.lib.stride_tricks.sliding_window_view(y, length)[:: max(1, length // 4)]
    windows = windows - windows.mean(axis=1, keepdims=True)
    # The inverse Cholesky factor orthonormalises the basis in its order; the sinusoid comes after the trend.
    factor = np.linalg.cholesky(basis @ basis.T)
    power = (np.linalg.inv(factor) @ (basis @ windows.T)) ** 2
    wave = power[-2:].sum(axis=0)
    rest = np.maximum((windows**2).sum(axis=1) - power.sum(axis=0), 0.0)
    free = length - len(basis)
    net = float(np.mean(wave - 2 * rest / free)) / length
    whole = float(np.mean(wave + rest)) / length
    return net, net / whole if whole > 0 else 0.0


def coarse_period(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the period in s, to a few per cent, and the fraction of the variance that the oscillation explains.

    Periods of at least four samples, up to the duration of the record, are searched. If the period changes with the
    amplitude, it is an average. For noise the fraction is about 0.

    Parameters
    ----------
    t, y
        Increasing times in s and values, each (n,).
    """
    return coarse_periods(t, y, 1)[0]


def coarse_periods(t: np.ndarray, y: np.ndarray, most: int = 3) -> list[tuple[float, float]]:
    """Return up to `most` (at least one) possible periods (s), each with the fraction of the variance it explains.

    The fraction is that which sinusoids of this period explain. The first period has the largest `explained_power`; the
    others follow in falling order of this power times the fraction. If a hand moves the object to and fro in a part of
    the record, the first period may be that of the hand. t, y: increasing times in s and values, each (n,).
    """
    spacing, coarse = on_grid(t, y)
    periods = _search_periods(coarse, spacing, most)
    if t.size <= MOST_SAMPLES:
        return periods
    left = float(np.var(coarse) / np.var(y))
    if left < LEAST_VARIANCE or periods[0][1] < SURE_FRACTION or periods[0][0] < ALIAS_BLOCKS * spacing:
        # Block averages hide fast oscillations: search also in the samples of the piece with the largest variance.
        ends = np.arange(MOST_SAMPLES, t.size + 1, MOST_SAMPLES)
        at = max(ends.tolist(), key=lambda end: float(np.var(y[end - MOST_SAMPLES : end])))
        piece = slice(at - MOST_SAMPLES, at)
        finer, values = on_grid(t[piece], y[piece])
        near = _search_periods(values, finer, most)
        # If the period in the averages is only an alias, its fraction must be reduced by the lost variance.
        alias = left if near[0][0] < ALIAS_BLOCKS * spacing else 1.0
        periods = near if near[0][1] > periods[0][1] * alias else periods
    return periods


def _search_periods(y: np.ndarray, spacing: float, most: int) -> list[tuple[float, float]]:
    """Return up to `most` pairs of period (s) and fraction, as `coarse_periods`, for equally spaced values y (n,).

    spacing: sampling interval in s.
    """
    top = max(y.size - 1, 4.4)
    grid = np.geomspace(SHORTEST_PERIOD, top, int(28 * np.log10(top / SHORTEST_PERIOD)) + 3)
    scores, shares = np.array([explained_power(y, p) for p in grid]).T
    padded = np.pad(scores, 1, constant_values=-np.inf)
    peaks = np.flatnonzero(
        (scores >= padded[:-2]) & (scores > padded[2:]) & (scores > WEAK_POWER * scores.max())
    )
    peaks = peaks[np.argsort(-scores[peaks] * shares[peaks])]
    strongest = int(np.argmax(scores))
    peaks = [strongest, *(p for p in peaks.tolist() if p != strongest)][:most]
    periods = []
    for best in peaks:
        fine = np.geomspace(grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)], 17)
        results = [explained_power(y, p) for p in fine]
        at = int(np.argmax([r[0] for r in results]))
        periods.append((float(fine[at] * spacing), max(results[at][1], 0.0)))
    return periods
