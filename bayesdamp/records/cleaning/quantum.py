"""The recording step of a record: the lattice that its values lie on."""

from __future__ import annotations

import numpy as np


def recording_step(y: np.ndarray) -> float:
    """The step in the unit of y (n,), or 0 where the values lie on no lattice.

    The lattice may be rounded in its turn (a step of 0.088° written with two decimals).
    """
    values = np.unique(y)
    if values.size < 3:
        return float(values[-1] - values[0]) if values.size == 2 else 0.0
    gaps = np.diff(values)
    gaps = gaps[gaps > 1e-9 * float(np.ptp(values))]
    values = values[0] + np.concatenate([[0.0], np.cumsum(gaps)])
    small = gaps[gaps < 1.5 * gaps.min()]
    if small.size < max(2, 0.02 * gaps.size):
        return 0.0
    step, start, count = float(small.mean()), 0.0, gaps
    for _ in range(3):
        count = np.concatenate([[0], np.cumsum(np.round(gaps / step))])
        step, start = (float(c) for c in np.polyfit(count, values, 1))
    off = np.abs(values - start - step * count)
    return step if np.quantile(off, 0.95) < 0.2 * step else 0.0
