"""How far a record is from a law: the size of the deviation, and what a plain fit leaves beyond noise."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.deviation.numbers.curves import times_of
from bayesdamp.inference.deviation.weighing import Result, Weighing


def size_of(weighing: Weighing, result: Result, values: np.ndarray) -> np.ndarray:
    """Energy-weighted mean of |deviation| over the record, about its own mean there, of draws at the knots (n, k):
    (n,)."""
    at, sizes = times_of(result)
    share = np.linspace(0, 1, values.shape[1])
    few = at.size < 2
    weight = np.ones(share.size) if few else np.interp(share * weighing.data.t[-1], at, sizes) ** 2
    weight = weight / weight.sum()
    centred = values - (values @ weight)[:, None]
    return np.abs(centred) @ weight


def left_over(weighing: Weighing, result: Result) -> tuple[float, float]:
    """Root mean square of what a candidate's plain fit leaves beyond noise, and of the noise, as shares of the
    amplitude."""
    residual, about = result.fit.residual, result.about
    left = residual if about is None else about.left
    # A phase that slips over thousands of cycles is a frequency that is off by next to nothing.
    residual = weighing.data.of_amplitude(residual)
    clean = float(left @ left) / max(left.size - (0 if about is None else about.u.size), 1)
    rest = max(float(residual @ residual) / residual.size - clean, 0.0)
    amplitude, averaged = weighing.data.recorded_amplitude, weighing.data.averaged
    each = 1.0 if averaged is None else averaged.samples
    return float(np.sqrt(rest)) / amplitude, float(np.sqrt(clean * each)) / amplitude
