"""Estimate the noise of a record from residuals of smooth oscillations, fitted in windows of about a period."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

ENOUGH_WINDOWS = 512
"""Largest number of windows of a record from which the median noise is computed; with this number the noise is known to
1 % or better."""
TALL_WINDOW = 200
"""In windows of at least this many samples, least-squares problems are solved by their normal equations, which is
faster."""
BLOCK_SAMPLES = 200_000
"""Approximate largest number of samples, in windows of one size, that are fitted at once; this limits the memory to
about 40 MB."""


class _Fits:
    """Least-squares fits in w windows of n samples each; phases x and values are (w, n).

    The columns of the linear fits are a constant, the time, sines and cosines of the phase and of its multiples, and
    products of these with powers of the time (slow changes). There are four columns, or more if n ≥ 12, up to n / 2.
    """

    def __init__(self, x: np.ndarray, values: np.ndarray) -> None:
        self.values = values
        most = x.shape[1] // 2
        # With equally spaced samples all windows have the same columns, which are inverted once.
        self.is_uniform = len(x) > 1 and float(np.abs(x - x[0]).max()) < 1e-9
        x = x[:1] if self.is_uniform else x
        u = x / np.maximum(np.abs(x).max(axis=-1, keepdims=True), 1e-300)
        c, s = np.cos(x), np.sin(x)
        columns = [np.ones_like(x), c, s, u]
        columns += [u * c, u * s] if most >= 6 else []
        columns += [np.cos(2 * x), np.sin(2 * x)] if most >= 8 else []
        columns += [np.cos(3 * x), np.sin(3 * x), u**2, u**2 * c, u**2 * s] if most >= 13 else []
        for k in (2, 3, 5, 4) if most >= 22 else ():
            scale = u if k < 4 else np.ones_like(u)
            columns += [scale * np.cos(k * x), scale * np.sin(k * x)]
        self.columns = np.stack(columns, axis=-1)
        self.inverse = _inverse(self.columns)
        self.free = x.shape[1] - self.columns.shape[2]

    def residuals(self) -> np.ndarray:
        """Return the residuals of unweighted fits, (w, n)."""
        if self.is_uniform:
            return self.values - (self.values @ self.inverse[0].T) @ self.columns[0].T
        return self.values - (self.columns @ (self.inverse @ self.values[:, :, None]))[:, :, 0]

    def weighted_residuals(self, which: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Fit the columns to some windows by weighted least squares; return the residuals r (v, n), without weights.

        The fits minimise Σ (w r)². which: indices of the v windows that are fitted, (v,). weights: w, (v, n), for the n
        samples of each window.
        """
        columns = self.columns if self.is_uniform else self.columns[which]
        values = self.values[which]
        inverse = _inverse(columns * weights[:, :, None])
        return values - (columns @ (inverse @ (values * weights)[:, :, None]))[:, :, 0]

    def robust_residuals(self) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (w, n) and noise standard deviations (w,) of fits that leave out outliers."""
        count, n = self.values.shape
        plain = rest = self.residuals()
        scale = _scale(rest)
        weights = np.ones_like(rest)
        for _ in range(5):  # reweighting towards least absolute residuals, which spikes do not affect
            far = np.flatnonzero(np.abs(rest).max(axis=1) > 4 * scale[:, 0])
            if far.size == 0:
                break
            weights[far] = 1 / np.sqrt(np.maximum(np.abs(rest[far]) / scale[far], 1.0))
            rest = rest.copy()
            rest[far] = self.weighted_residuals(far, weights[far])
            scale[far] = _scale(rest[far])
        # Then leave out outliers, and repeat until the set of outliers does not change.
        least, inside = n - self.free + 3, 5 * np.sqrt(n / self.free)
        good = np.abs(rest) <= inside * scale
        good[good.sum(axis=1) < least] = True
        rest, open_ = plain.copy(), np.arange(count)
        for _ in range(3):
            some = open_[~good[open_].all(axis=1)]
            rest[open_] = plain[open_]
            if some.size:
                rest[some] = self.weighted_residuals(some, good[some].astype(float))
            now = np.abs(rest[open_]) <= inside * _scale(rest[open_])
            changed = (now.sum(axis=1) >= least) & np.any(now != good[open_], axis=1)
            open_ = open_[changed]
            good[open_] = now[changed]
            if open_.size == 0:
                break
        squares = np.sum(np.where(good, rest, 0.0) ** 2, axis=1)
        return rest, np.sqrt(squares / np.maximum(good.sum(axis=1) - (n - self.free), 1))


def group_by_size(sizes: np.ndarray, least: int, values: int = 0) -> Iterator[tuple[int, np.ndarray]]:
    """Group windows with the same number of samples, so that they can be fitted together.

    Parameters
    ----------
    sizes
        Number of samples in each window, (w,).
    least
        Windows with fewer samples are skipped.
    values
        Number of other values that are stored for each window.

    Yields
    ------
    tuple
        The number of samples, and indices of windows that together have at most about `BLOCK_SAMPLES` samples or
        values.
    """
    for n in np.unique(sizes[sizes >= least]).tolist():
        same = np.flatnonzero(sizes == n)
        for part in np.array_split(same, -(-same.size * max(n, values) // BLOCK_SAMPLES)):
            yield n, part


def _inverse(columns: np.ndarray) -> np.ndarray:
    """Return the pseudo-inverses (w, k, n) of columns (w, n, k).

    If n is large, the normal equations are used, which takes a tenth of the time.
    """
    if columns.shape[1] < TALL_WINDOW:
        return np.linalg.pinv(columns, rcond=1e-10)
    transposed = np.swapaxes(columns, 1, 2)
    return np.linalg.pinv(transposed @ columns, rcond=1e-13, hermitian=True) @ transposed


def _scale(rest: np.ndarray) -> np.ndarray:
    """Return a robust standard deviation (from the median absolute value) of each row, (w, 1)."""
    return 1.4826 * np.median(np.abs(rest), axis=1, keepdims=True) + 1e-300


def residuals(
    t: np.ndarray, y: np.ndarray, period: float, most: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the residuals of smooth oscillations that are fitted in windows of a period.

    A window lasts at least 14 mean sampling intervals; windows do not overlap. Outliers (beyond about five robust
    standard deviations) are left out of the fits; they also have a residual.

    Parameters
    ----------
    t, y
        Times in s and values, each (n,).
    period
        Period of the oscillation, in s.
    most
        If there are more windows, only this many, evenly spread, are fitted; the results of the others are NaN.

    Returns
    -------
    tuple of np.ndarray
        Residual of each sample, (n,), and noise standard deviation of each window, (m,), both in the unit of y; index
        of the window of each sample, (n,). Residuals and sds are NaN for windows with fewer than seven samples.
    """
    spacing = (t[-1] - t[0]) / (t.size - 1)
    length = max(period, 14 * spacing)
    count = max(int((t[-1] - t[0]) / length), 1)
    window = np.minimum(((t - t[0]) / (t[-1] - t[0]) * count).astype(int), count - 1)
    rest = np.full(t.size, np.nan)
    sd = np.full(count, np.nan)
    starts = np.searchsorted(window, np.arange(count + 1))
    sizes = np.diff(starts)
    every = np.arange(count) if most is None or count <= most else np.linspace(0, count - 1, most).astype(int)
    for n, same in group_by_size(sizes[every], 7):
        at = starts[every[same]][:, None] + np.arange(n)
        x = 2 * np.pi * (t[at] - (t[at[:, :1]] + t[at[:, -1:]]) / 2) / period
        rest[at], sd[every[same]] = _Fits(x, y[at]).robust_residuals()
    return rest, sd, window


def roughness(t: np.ndarray, y: np.ndarray, period: float) -> float:
    """Return the standard deviation of the noise of a sample of y (n,), in its unit.

    t, period: in s. Smooth oscillations are fitted in windows of about a period, without outliers, and the result is
    the median of the residuals' standard deviations in the windows; 0 if no window has enough samples.
    """
    sd = residuals(t, y, period, ENOUGH_WINDOWS)[1]
    return float(np.nanmedian(sd)) if np.any(np.isfinite(sd)) else 0.0
