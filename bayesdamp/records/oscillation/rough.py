"""What a smooth oscillation leaves over in windows of about a period: noise, quantisation, outliers."""

from __future__ import annotations

import numpy as np

ENOUGH = 512
"""Windows that suffice for the median of their noise: it is known to a per cent or better."""
TALL = 200
"""Samples in a window from which normal equations will do."""
BLOCK = 200_000
"""Samples that are fitted at a time: some 40 MB of columns."""


def _columns(x: np.ndarray, most: int) -> np.ndarray:
    """Sinusoids of phases x (..., n), overtones and slow changes, (..., n, k): as many columns as `most` allows."""
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


def _inverse(columns: np.ndarray) -> np.ndarray:
    """Pseudo-inverses (w, k, n) of columns (w, n, k); of tall ones by their k normal equations, a tenth of the work."""
    if columns.shape[1] < TALL:
        return np.linalg.pinv(columns, rcond=1e-10)
    turned = np.swapaxes(columns, 1, 2)
    return np.linalg.pinv(turned @ columns, rcond=1e-13, hermitian=True) @ turned


class _Fits:
    """Least squares in windows of n samples each: phases x and values, both (w, n)."""

    def __init__(self, x: np.ndarray, values: np.ndarray) -> None:
        self.values = values
        # Equally spaced samples have one design in all windows, which is inverted once.
        self.alike = len(x) > 1 and float(np.abs(x - x[0]).max()) < 1e-9
        self.columns = _columns(x[:1] if self.alike else x, x.shape[1] // 2)
        self.inverse = _inverse(self.columns)
        self.free = x.shape[1] - self.columns.shape[2]

    def rest(self) -> np.ndarray:
        """What the fits to all samples leave, (w, n)."""
        if self.alike:
            return self.values - (self.values @ self.inverse[0].T) @ self.columns[0].T
        return self.values - (self.columns @ (self.inverse @ self.values[:, :, None]))[:, :, 0]

    def weighted(self, which: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """What fits with weights (v, n) leave of the windows `which`, (v,)."""
        columns = self.columns if self.alike else self.columns[which]
        values = self.values[which]
        inverse = _inverse(columns * weights[:, :, None])
        return values - (columns @ (inverse @ (values * weights)[:, :, None]))[:, :, 0]


def _scale(rest: np.ndarray) -> np.ndarray:
    return 1.4826 * np.median(np.abs(rest), axis=1, keepdims=True) + 1e-300


def _robust(fits: _Fits) -> tuple[np.ndarray, np.ndarray]:
    """(residuals (w, n), noise sd (w,)) of windows, outliers apart."""
    count, n = fits.values.shape
    plain = rest = fits.rest()
    scale = _scale(rest)
    weights = np.ones_like(rest)
    for _ in range(5):  # towards least absolute distances, for a start that spikes do not pull along
        far = np.flatnonzero(np.abs(rest).max(axis=1) > 4 * scale[:, 0])
        if far.size == 0:
            break
        weights[far] = 1 / np.sqrt(np.maximum(np.abs(rest[far]) / scale[far], 1.0))
        rest = rest.copy()
        rest[far] = fits.weighted(far, weights[far])
        scale[far] = _scale(rest[far])
    least, inside = n - fits.free + 3, 5 * np.sqrt(n / fits.free)
    good = np.abs(rest) <= inside * scale
    good[good.sum(axis=1) < least] = True
    rest, open_ = plain.copy(), np.arange(count)
    for _ in range(3):
        some = open_[~good[open_].all(axis=1)]
        rest[open_] = plain[open_]
        if some.size:
            rest[some] = fits.weighted(some, good[some].astype(float))
        now = np.abs(rest[open_]) <= inside * _scale(rest[open_])
        changed = (now.sum(axis=1) >= least) & np.any(now != good[open_], axis=1)
        open_ = open_[changed]
        good[open_] = now[changed]
        if open_.size == 0:
            break
    kept = np.where(good, rest, 0.0)
    return rest, np.sqrt(np.sum(kept**2, axis=1) / np.maximum(good.sum(axis=1) - (n - fits.free), 1))


def residuals(
    t: np.ndarray, y: np.ndarray, period: float, most: int | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(residual of each sample (n,), noise sd of each window (m,), window of each sample (n,)).

    Windows of a period, or more where a period has few samples, do not overlap. In each, samples further than
    five robust standard deviations from a first fit take no part in a second. NaN where a window has too few
    samples. most: of more windows than so many only so many are fitted, evenly spread; NaN in the others.
    """
    spacing = (t[-1] - t[0]) / (t.size - 1)
    length = max(period, 14 * spacing)
    count = max(int((t[-1] - t[0]) / length), 1)
    window = np.minimum(((t - t[0]) / (t[-1] - t[0]) * count).astype(int), count - 1)
    left = np.full(t.size, np.nan)
    sd = np.full(count, np.nan)
    starts = np.searchsorted(window, np.arange(count + 1))
    sizes = np.diff(starts)
    every = np.arange(count) if most is None or count <= most else np.linspace(0, count - 1, most).astype(int)
    for n in np.unique(sizes[every]):
        alike = every[sizes[every] == n]
        for part in np.array_split(alike, -(-alike.size * int(n) // BLOCK)) if n >= 7 else ():
            at = starts[part][:, None] + np.arange(n)
            x = 2 * np.pi * (t[at] - (t[at[:, :1]] + t[at[:, -1:]]) / 2) / period
            left[at], sd[part] = _robust(_Fits(x, y[at]))
    return left, sd, window


def roughness(t: np.ndarray, y: np.ndarray, period: float) -> float:
    """Standard deviation of the noise of y (n,), in its unit: the median over windows of about a period."""
    sd = residuals(t, y, period, ENOUGH)[1]
    return float(np.nanmedian(sd)) if np.any(np.isfinite(sd)) else 0.0
