"""What a smooth oscillation leaves over in windows of about a period: noise, quantisation, outliers."""

from __future__ import annotations

import numpy as np


def _columns(x: np.ndarray, most: int) -> np.ndarray:
    """A sinusoid of phase x (n,), its overtones and slow changes, as many columns as `most` allows."""
    u = x / max(float(np.abs(x).max()), 1e-300)
    c, s = np.cos(x), np.sin(x)
    columns = [np.ones_like(x), c, s, u]
    columns += [u * c, u * s] if most >= 6 else []
    columns += [np.cos(2 * x), np.sin(2 * x)] if most >= 8 else []
    columns += [np.cos(3 * x), np.sin(3 * x), u**2, u**2 * c, u**2 * s] if most >= 13 else []
    for k in (2, 3, 5, 4) if most >= 22 else ():
        scale = u if k < 4 else np.ones_like(u)
        columns += [scale * np.cos(k * x), scale * np.sin(k * x)]
    return np.stack(columns, axis=1)


def residuals(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(residual of each sample (n,), noise sd of each window (m,), window of each sample (n,)).

    Windows of a period, or more where a period has few samples, do not overlap. In each, samples further than
    five robust standard deviations from a first fit take no part in a second. NaN where a window has too few
    samples.
    """
    spacing = (t[-1] - t[0]) / (t.size - 1)
    length = max(period, 14 * spacing)
    count = max(int((t[-1] - t[0]) / length), 1)
    window = np.minimum(((t - t[0]) / (t[-1] - t[0]) * count).astype(int), count - 1)
    left = np.full(t.size, np.nan)
    sd = np.full(count, np.nan)
    for j in range(count):
        a, b = np.searchsorted(window, (j, j + 1))
        if b - a < 7:
            continue
        x = 2 * np.pi * (t[a:b] - (t[a] + t[b - 1]) / 2) / period
        columns, values = _columns(x, (b - a) // 2), y[a:b]
        rest, scale = values, 0.0
        weights = np.ones(b - a)
        for _ in range(6):  # towards least absolute distances, for a start that spikes do not pull along
            coefficients = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=1e-10)[0]
            rest = values - columns @ coefficients
            scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-300
            if np.abs(rest).max() <= 4 * scale:
                break
            weights = 1 / np.sqrt(np.maximum(np.abs(rest) / scale, 1.0))
        good = np.abs(rest) <= 5 * scale * np.sqrt((b - a) / (b - a - columns.shape[1]))
        if good.sum() < columns.shape[1] + 3:
            good = np.ones(b - a, bool)
        for _ in range(3):
            rest = values - columns @ np.linalg.lstsq(columns[good], values[good], rcond=1e-10)[0]
            scale = 1.4826 * float(np.median(np.abs(rest)))
            now = np.abs(rest) <= 5 * scale * np.sqrt((b - a) / (b - a - columns.shape[1])) + 1e-300
            if now.sum() < columns.shape[1] + 3 or np.array_equal(now, good):
                break
            good = now
        left[a:b] = rest
        sd[j] = np.sqrt(np.sum(rest[good] ** 2) / max(good.sum() - columns.shape[1], 1))
    return left, sd, window


def roughness(t: np.ndarray, y: np.ndarray, period: float) -> float:
    """Standard deviation of the noise of y (n,), in its unit: the median over windows of about a period."""
    sd = residuals(t, y, period)[1]
    return float(np.nanmedian(sd)) if np.any(np.isfinite(sd)) else 0.0
