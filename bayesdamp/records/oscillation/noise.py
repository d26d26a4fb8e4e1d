"""Estimate the noise of a record from residuals of smooth oscillations, fitted in windows of about a period."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

ENOUGH_WINDOWS = 512
"""Largest number of windows of a record from which the median noise is computed; with this number the noise is known to
1 % or better."""
OUTLIER_SCALES = 4.0
"""A sample is left out as an outlier if its studentised residual is larger than this many robust standard deviations of
those in its window (conventional)."""
BLOCK_SAMPLES = 200_000
"""Approximate largest number of samples, in windows of one size, that are fitted at once; this limits the memory to
about 40 MB."""


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


def _columns(x: np.ndarray) -> np.ndarray:
    """Return the columns of the linear fits in w windows of n samples, at phases x (w, n) in rad, (w, n, k).

    They are a constant, the time, sines and cosines of the phase and of its multiples, and products of these with
    powers of the time (slow changes): k = 4, or more if n ≥ 12, up to n / 2.
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
    """Fit columns (w or 1, n, k) to values (w, n) by least squares in each of w windows.

    Return the residuals (w, n), and their sds as fractions of that of the noise (w or 1, n). These are small for
    samples that determine the fit, such as those at the ends of a window.
    """
    q = np.linalg.qr(columns)[0]
    sds = np.sqrt(np.maximum(1 - np.sum(q**2, axis=2), 1e-9))
    return values - (q @ (np.swapaxes(q, 1, 2) @ values[:, :, None]))[:, :, 0], sds


def _window_noise(x: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the residuals of smooth fits without outliers, (w,).

    x, values: phases in rad and values of the n samples in each of w windows, (w, n).
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
    """Return the standard deviation of the noise of a sample of y (n,), in its unit.

    t, period: in s. Smooth oscillations are fitted in windows of a period (at least 14 mean sampling intervals),
    without outliers, and the result is the median of the residuals' standard deviations in the windows; 0 if no window
    has seven samples.
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
