"""The outline of a sample of draws, for drawing only."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

_BINS = 160


def outline(draws: np.ndarray, reflected: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A smooth density of draws, any shape: grid and height (highest 1), each of shape (bins,).

    reflected: the quantity cannot be negative; the density is reflected at zero rather than smeared across it.
    """
    flat = np.ravel(draws)
    flat = flat[np.isfinite(flat)]
    low, high = np.quantile(flat, [0.0005, 0.9995])
    pad = 0.15 * (high - low) or max(abs(high), 1.0) * 1e-6
    low, high = low - pad, high + pad
    reflect = reflected and low < 0
    low = 0.0 if reflect else low
    counts, edges = np.histogram(flat, bins=_BINS, range=(low, high))
    width = 1.06 * flat.std() * flat.size**-0.2 / (edges[1] - edges[0])
    height = gaussian_filter1d(
        counts.astype(float), max(1.0, width), mode="reflect" if reflect else "constant"
    )
    return 0.5 * (edges[1:] + edges[:-1]), height / (height.max() or 1.0)


def contours(
    x: np.ndarray,
    y: np.ndarray,
    reflected: tuple[bool, bool] = (False, False),
    masses: tuple[float, float] = (0.9, 0.5),
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[float]]:
    """Grids of x and y, their smooth joint density (y, x), and its levels that enclose these masses.

    reflected: whether x and y cannot be negative, as in `outline`.
    """
    x, y = np.ravel(x), np.ravel(y)
    edges, modes = [], []
    for values, positive in zip((x, y), reflected):
        low, high = np.quantile(values, [0.001, 0.999])
        pad = 0.2 * (high - low) or 1e-12
        reflect = positive and low - pad < 0
        edges.append(np.linspace(0.0 if reflect else low - pad, high + pad, 81))
        modes.append("reflect" if reflect else "constant")
    counts, *_ = np.histogram2d(x, y, bins=edges)
    smooth = gaussian_filter(counts, 2.6, mode=modes)  # pyright: ignore[reportArgumentType]
    order = np.sort(smooth.ravel())[::-1]
    mass = np.cumsum(order) / order.sum()
    levels = [float(order[np.searchsorted(mass, m)]) for m in masses]
    centres = [0.5 * (e[1:] + e[:-1]) for e in edges]
    return centres[0], centres[1], smooth.T, levels
