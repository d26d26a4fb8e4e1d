"""How far a record is from a law: the size of the deviation, and what a plain fit leaves beyond noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bayesdamp.inference.deviation.numbers.curves import (
    at_share,
    between_knots,
    share_of_time,
    turning_amplitudes,
)
from bayesdamp.inference.deviation.numbers.draws import Drawn, Quantity, quantity
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.kernel.averaged import NUMBERS

SEEN = 5.0
"""Standard deviations from which a drift is one: of the fewest means a false alarm in 400 records, of many far less."""
FEWEST = 8
"""Means through which a line is laid at least."""


def size_of(weighing: Weighing, result: Result, values: np.ndarray) -> np.ndarray:
    """Energy-weighted mean of |deviation| over the record, about its own mean there, of draws at the knots (n, k):
    (n,)."""
    weight = _energies(weighing, result, values.shape[1])
    centred = values - (values @ weight)[:, None]
    return np.abs(centred) @ weight


def over_laws(
    weighing: Weighing, drawn: Sequence[Drawn], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[Quantity, ...]:
    """How many times the law's own the damping is at amplitudes (rad or m), of which the mean over the record's energy
    is the law's: the laws that were drawn from, each with its deviation."""
    means = [d.g @ _energies(weighing, d.result, d.g.shape[1]) for d in drawn]
    found = []
    for a in amplitudes:
        each = zip(_along(weighing, drawn, a, rng), means, strict=True)
        found.append(quantity(np.concatenate([np.exp(g - mean) for (g, _), mean in each])))
    return tuple(found)


def _along(
    weighing: Weighing, drawn: Sequence[Drawn], amplitude: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Log g and h of each candidate's draws at an amplitude, (n,)."""
    for d in drawn:
        share = share_of_time(weighing, d.result, amplitude)
        yield at_share(d.g, share) + between_knots(d.g, rng), at_share(d.h, share)


def off_laws(
    weighing: Weighing, drawn: Sequence[Drawn], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Mean and sd of the log of the damping ratio over that of the coefficients alone, at amplitudes (rad or m)."""
    found = []
    for a in amplitudes:
        values = np.concatenate([g - np.log1p(h) for g, h in _along(weighing, drawn, a, rng)])
        found.append((float(values.mean()), float(values.std())))
    return tuple(found)


def _energies(weighing: Weighing, result: Result, knots: int) -> np.ndarray:
    """Shares of the oscillation's energy at equidistant knots, (k,)."""
    at, sizes = turning_amplitudes(result.motion)
    share = np.linspace(0, 1, knots)
    few = at.size < 2
    weight = np.ones(knots) if few else np.interp(share * weighing.data.end, at, sizes) ** 2
    return weight / weight.sum()


def midline_drift(weighing: Weighing, result: Result) -> float:
    """By how much the midline moves from a record's start to its end, as a share of its first amplitude: the straight
    line through the means, cycle by cycle, of what a candidate's plain fit leaves. 0 where less than `SEEN` of the sds
    that these means' own scatter gives it."""
    data, left, scale = weighing.data, result.fit.residual, weighing.data.recorded_amplitude
    if data.averaged is None:
        count = int(data.cycles)
        parts = np.minimum((data.t / data.end * count).astype(int), max(count - 1, 0))
        size = np.bincount(parts, minlength=count)
        means = np.bincount(parts, left, minlength=count) / np.maximum(size, 1)
    else:
        means, scale = left[NUMBERS - 1 :: NUMBERS], scale * float(np.sqrt(2.0))
    if means.size < FEWEST:
        return 0.0
    place = (np.arange(means.size) + 0.5) / means.size - 0.5
    drift = float(place @ means / (place @ place))
    scatter = float(np.sum((means - means.mean() - drift * place) ** 2)) / (means.size - 2)
    return drift / scale if abs(drift) > SEEN * np.sqrt(scatter / (place @ place)) else 0.0


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
