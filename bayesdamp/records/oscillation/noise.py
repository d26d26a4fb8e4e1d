"""Estimate the noise and the period of a record, coarsely.

The noise is the standard deviation of the residuals of smooth oscillations that are fitted in windows of about a
period. The period is the one whose sinusoids explain most of the record."""

from collections.abc import Iterator

import numpy as np

ENOUGH_WINDOWS = 512
"""Largest number of windows of a record in which the noise is estimated. The median over this many windows has an error
of 1 % or less."""
OUTLIER_SCALES = 4.0
"""A sample is left out as an outlier if its studentised residual is larger than this many robust standard deviations of
the residuals in its window (conventional)."""
BLOCK_SAMPLES = 200_000
"""Approximate largest number of samples, in windows of one size, that are fitted at once; this limits the memory to
about 40 MB."""


def group_by_size(sizes: np.ndarray, least: int, values: int = 0) -> Iterator[tuple[int, np.ndarray]]:
    """Group windows that have the same number of samples, so that they can be fitted together.

    Parameters
    ----------
    sizes
        Number of samples in each window, (w,).
    least
        Windows with fewer samples are skipped.
    values
        Number of other values that are stored for each window, to limit the memory.

    Yields
    ------
    tuple
        The number of samples in each window of the group, and the indices of these windows. Together they have at most
        about `BLOCK_SAMPLES` samples or values.
    """
    for n in np.unique(sizes[sizes >= least]).tolist():
        same = np.flatnonzero(sizes == n)
        for part in np.array_split(same, -(-same.size * max(n, values) // BLOCK_SAMPLES)):
            yield n, part


def _columns(x: np.ndarray) -> np.ndarray:
    """Return the design matrices of linear fits in w windows of n samples, at phases x (w, n) in rad; shape (w, n, k).

    The columns are a constant, the time, sines and cosines of the phase and of its multiples, and products of these
    with powers of the time (slow changes). Their number k is 4, or more if n ≥ 12, up to n / 2.
    """
    most = x.shape[1] // 2
    u = x / np.maximum(np.abs(x).max(axis=-1, keepdims=True), 1e-300)
    c, s = np.cos(x), np.sin(x)
    columns = [np.ones_like(x), c, s, u]
    columns += [u * c, u * s] if most >= 6 else []
    columns += [np.cos(2 * x), np.sin(2 * x)] if most >= 8 else []
    columns += [np.cos(3 * x), np.sin(3 * x), u**2, u**2 * c, u**2 * s] if most >= 13 else []
    for k in (2, 3, 5, 4) if most >= 22 else ():
        scale = u if k < 4 else np.ones_like(u)
        columns += [scale * np.cos(k * x), scale * np.sin(k * x)]
    return np.stack(columns, axis=-1)


def _residuals(columns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit design matrices `columns` (w or 1, n, k) to values (w, n) by least squares, in each of w windows.

    Return the residuals (w, n), and the standard deviation of each residual divided by that of the noise (w or 1, n).
    This ratio is small for samples that determine the fit, such as those at the ends of a window.
    """
    q = np.linalg.qr(columns)[0]
    sds = np.sqrt(np.maximum(1 - np.sum(q**2, axis=2), 1e-9))
    return values - (q @ (np.swapaxes(q, 1, 2) @ values[:, :, None]))[:, :, 0], sds


def _window_noise(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the noise in each of w windows, (w,): that of the residuals of a smooth fit.

    Outliers are left out. x, values: phases in rad and values of the n samples in each window, (w, n).
    """
    # With equally spaced samples all windows have the same columns.
    columns = _columns(x[:1] if np.ptp(x, axis=0).max() < 1e-9 else x)
    k = columns.shape[2]
    rest, sds = _residuals(columns, values)
    good, columns = np.ones(values.shape, bool), np.broadcast_to(columns, (*values.shape, k))
    size = np.abs(rest) / sds
    for _ in range(3):  # an outlier in the fit hides smaller ones
        good &= size <= OUTLIER_SCALES * 1.4826 * np.median(size, axis=1, keepdims=True) + 1e-300
        some = np.flatnonzero(~good.all(axis=1))
        rest[some], sds = _residuals(columns[some] * good[some][:, :, None], values[some] * good[some])
        size[some] = np.where(good[some], np.abs(rest[some]) / sds, np.inf)
    return np.sqrt(np.sum(rest**2, axis=1) / np.maximum(good.sum(axis=1) - k, 1))


def roughness(t: np.ndarray, y: np.ndarray, period: float) -> float:
    """Return the standard deviation of the noise in each single value of y (n,), in the unit of y.

    Smooth oscillations are fitted, with outliers left out, in windows of a period (at least 14 mean sampling
    intervals). The result is the median over the windows of the standard deviation of the residuals; 0 if no window has
    seven samples. t, period: in s.
    """
    duration = t[-1] - t[0]
    count = max(int(duration / max(period, 14 * duration / (t.size - 1))), 1)
    edges = np.searchsorted(t, t[0] + duration * np.arange(1, count) / count)
    edges = np.concatenate([[0], edges, [t.size]])
    used = np.unique(np.linspace(0, count - 1, min(count, ENOUGH_WINDOWS)).astype(int))
    sds: list[np.ndarray] = []
    for n, same in group_by_size(np.diff(edges)[used], 7):
        at = edges[used[same], None] + np.arange(n)
        x = 2 * np.pi * (t[at] - (t[at[:, :1]] + t[at[:, -1:]]) / 2) / period
        sds.append(_window_noise(x, y[at]))
    return float(np.median(np.concatenate(sds))) if sds else 0.0


MOST_SAMPLES = 16384
"""Largest number of samples in which a period is searched for; longer records are averaged in blocks first
(conventional)."""
SHORTEST_PERIOD = 4.0
"""Number of samples in the shortest period that is searched for."""
LEAST_VARIANCE = 0.5
"""Averaging the samples of a long record in blocks may remove a fast oscillation. If the averages have less than this
fraction of the variance of the samples, the samples themselves are searched for a period too."""
SURE_FRACTION = 0.5
"""An oscillation in averages of samples is accepted without a search in the samples only if it has at least this
fraction of the variance. In `samples_a_cycle`, a spectral line must have at least this fraction of the power."""
ALIAS_BLOCKS = 4.5
"""A period that was found in averages over blocks of samples may be an alias of a faster oscillation if it is shorter
than this many blocks."""
NEAR_SAMPLE = 2.0
"""A value on a grid of equal steps is in a gap of the record if no sample is within this many steps (conventional)."""
LINE_BINS = 4
"""Approximate half width, in bins of a spectrum, of the line of a decaying oscillation."""
LEAST_SHARE = 0.3
"""Smallest fraction of the variance about the slow trend that the strongest oscillation must explain (computed by
`coarse_period`). With less, a record is refused, and a column of a file does not count as oscillating."""
WEAK_POWER = 0.1
"""A possible period is ignored if its sinusoids explain less than this fraction of the power that those of the
strongest period explain."""


def block_means(values: np.ndarray, block: int) -> np.ndarray:
    """Return the means of successive blocks of `block` values (n,); an incomplete last block is dropped."""
    return values[: values.size // block * block].reshape(-1, block).mean(axis=1)


def neighbourhoods(values: np.ndarray, width: int) -> np.ndarray:
    """Return for each value the `width` values around it, (n, width); the first and the last value repeat at the ends.

    If `width` is even, there is one value more before than after it. values: (n,).
    """
    padded = np.pad(values, (width // 2, (width - 1) // 2), mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, width)


def on_grid(t: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Return a record on equally spaced times: the spacing in s, at most MOST_SAMPLES values, (m,), and which are real.

    t, y: times in s and values, (n,). Longer records are averaged in blocks first; then the values are interpolated
    linearly. A value is real, and not only a line across a gap, if a time of the record is within `NEAR_SAMPLE`
    spacings.
    """
    block = -(-t.size // MOST_SAMPLES)
    t, y = block_means(t, block), block_means(y, block)
    spacing = float((t[-1] - t[0]) / (t.size - 1))
    grid = t[0] + spacing * np.arange(t.size)
    after = np.searchsorted(t[1:-1], grid)
    away = np.minimum(np.abs(grid - t[after]), np.abs(grid - t[after + 1]))
    return spacing, np.interp(grid, t, y), away <= NEAR_SAMPLE * spacing


def samples_a_cycle(t: np.ndarray, y: np.ndarray) -> float:
    """Return the number of samples in a cycle of the strongest spectral line (with at least two cycles in the record).

    The result is NaN if the line has less than half of the power. With fewer than 4 samples a cycle, a record is too
    coarse for its oscillation to be analysed.

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


def explained_power(y: np.ndarray, real: np.ndarray, samples: float) -> tuple[float, float]:
    """Return how much of a record is explained by sinusoids of a given period, fitted in windows of two periods.

    Parameters
    ----------
    y, real
        Equally spaced values, and whether each is real (False in a gap), (n,). Windows of which less than half is real
        are left out, unless all are.
    samples
        Number of samples in a period.

    Returns
    -------
    tuple of float
        The explained mean square (in the squared unit of y) minus that expected for white noise, and the same as a
        fraction of the mean square about the trend. Both may be slightly below 0.
    """
    length = int(min(max(round(2 * samples), 7), y.size))
    u = np.linspace(-1.0, 1.0, length)
    angle = np.pi * (length - 1) / samples * u
    trend = [np.ones(length), u] if length < 14 else [np.ones(length), u, u**2]
    basis = np.stack([*trend, np.cos(angle), np.sin(angle)])
    places = np.arange(0, y.size - length + 1, max(1, length // 4))
    count = np.append(0, np.cumsum(real))
    shares = (count[places + length] - count[places]) / length  # shares of real values
    used = shares >= min(0.5, shares.max())
    places = places[used]
    windows = np.lib.stride_tricks.sliding_window_view(y, length)[places]
    windows = windows - windows.mean(axis=1, keepdims=True)
    # The inverse Cholesky factor orthonormalises the basis in its order; the sinusoid comes after the trend.
    factor = np.linalg.cholesky(basis @ basis.T)
    power = (np.linalg.inv(factor) @ (basis @ windows.T)) ** 2
    wave = power[-2:].sum(axis=0)
    rest = np.maximum((windows**2).sum(axis=1) - power.sum(axis=0), 0.0)
    free = length - len(basis)
    net = float(np.mean(wave - 2 * rest / free)) / length
    whole = float(np.mean(wave + rest)) / length
    return net * float(np.mean(shares[used])), net / whole if whole > 0 else 0.0


def coarse_period(t: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the period of a record in s, to a few per cent, and the fraction of the variance that it explains.

    Periods of at least four samples, up to the duration of the record, are searched. If the period changes with the
    amplitude, the result is an average. The fraction is that of sinusoids with this period; for noise it is about 0.

    Parameters
    ----------
    t, y
        Increasing times in s and values, each (n,).
    """
    return coarse_periods(t, y, 1)[0]


def coarse_periods(t: np.ndarray, y: np.ndarray, most: int = 3) -> list[tuple[float, float]]:
    """Return up to `most` possible periods of a record in s, each with the fraction of the variance that it explains.

    There is at least one. The fraction is that of sinusoids with this period. The first period is the one that explains
    the most power; the others follow in falling order of power times fraction. If a hand moves the object to and fro in
    a part of the record, the first period may be that of the hand. t, y: increasing times in s and values, each (n,).
    """
    spacing, coarse, real = on_grid(t, y)
    periods = _search_periods(coarse, real, spacing, most)
    if t.size <= MOST_SAMPLES:
        return periods
    left = float(np.var(coarse) / np.var(y))
    if left < LEAST_VARIANCE or periods[0][1] < SURE_FRACTION or periods[0][0] < ALIAS_BLOCKS * spacing:
        # Block averages hide fast oscillations: search also in the samples of the piece with the largest variance.
        ends = np.arange(MOST_SAMPLES, t.size + 1, MOST_SAMPLES)
        at = max(ends.tolist(), key=lambda end: float(np.var(y[end - MOST_SAMPLES : end])))
        piece = slice(at - MOST_SAMPLES, at)
        finer, values, real = on_grid(t[piece], y[piece])
        near = _search_periods(values, real, finer, most)
        # If the period in the averages is only an alias, its fraction must be reduced by the lost variance.
        alias = left if near[0][0] < ALIAS_BLOCKS * spacing else 1.0
        periods = near if near[0][1] > periods[0][1] * alias else periods
    return periods


def _search_periods(y: np.ndarray, real: np.ndarray, spacing: float, most: int) -> list[tuple[float, float]]:
    """Return up to `most` possible periods (s), each with the fraction of variance it explains, as `coarse_periods`.

    y, real: equally spaced values, and whether each is real, (n,), as from `on_grid`. spacing: sampling interval in s.
    """
    top = max(y.size - 1, 4.4)
    grid = np.geomspace(SHORTEST_PERIOD, top, int(28 * np.log10(top / SHORTEST_PERIOD)) + 3)
    scores, shares = np.array([explained_power(y, real, p) for p in grid]).T
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
        results = [explained_power(y, real, p) for p in fine]
        at = int(np.argmax([r[0] for r in results]))
        periods.append((float(fine[at] * spacing), max(results[at][1], 0.0)))
    return periods
