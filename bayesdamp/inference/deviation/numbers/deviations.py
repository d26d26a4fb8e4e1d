"""How far a record is from the laws: sizes of the deviation, what a plain fit leaves, what no sum of terms explains."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.numbers.curves import (
    at_share,
    between_knots,
    orbit_of,
    ratios_per_unit,
    share_of_time,
    turning_amplitudes,
)
from bayesdamp.inference.deviation.numbers.draws import CandidateDraws, Quantity, quantity
from bayesdamp.inference.deviation.weighing import CandidateResult
from bayesdamp.physics.kernel.averaged import NUMBERS

CLEAR = 5.0
"""Standard deviations from which a drift counts: a false alarm in 400 records with the fewest means, far fewer with
many."""
FEWEST = 8
"""Least number of means for a straight line through them."""
FEW = 400
"""Draws, of all candidates together, for the unexplained share."""


def size_of(result: CandidateResult, values: np.ndarray) -> np.ndarray:
    """Return the energy-weighted mean of |deviation| about its mean over the record, (n,), of draws (n, k)."""
    weight = _energies(result, values.shape[1])
    centred = values - (values @ weight)[:, None]
    return np.abs(centred) @ weight


def over_laws(
    drawn: Sequence[CandidateDraws], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[Quantity, ...]:
    """Return the damping over that of the law itself at amplitudes (rad or m).

    The law is that of each draw, times its mean deviation over the record's energy.
    """
    means = [d.g @ _energies(d.result, d.g.shape[1]) for d in drawn]
    factors = []
    for a in amplitudes:
        each = zip(_deviations_at(drawn, a, rng), means, strict=True)
        factors.append(quantity(np.concatenate([np.exp(g - mean) for (g, _), mean in each])))
    return tuple(factors)


def off_laws(
    drawn: Sequence[CandidateDraws], amplitudes: Sequence[float], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Return mean and sd of the log of the damping ratio over that of the coefficients alone, at amplitudes."""
    pairs = []
    for a in amplitudes:
        values = np.concatenate([g - np.log1p(h) for g, h in _deviations_at(drawn, a, rng)])
        pairs.append((float(values.mean()), float(values.std())))
    return tuple(pairs)


def _deviations_at(
    drawn: Sequence[CandidateDraws], amplitude: float, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield log g and h of each candidate's draws at an amplitude, (n,)."""
    for d in drawn:
        share = share_of_time(d.result, amplitude)
        yield at_share(d.g, share) + between_knots(d.g, rng), at_share(d.h, share)


def _energies(result: CandidateResult, knots: int) -> np.ndarray:
    """Return shares of the oscillation's energy at equidistant knots, (k,)."""
    at, sizes = turning_amplitudes(result.motion)
    times = np.linspace(0, 1, knots) * result.data.end
    weight = np.ones(knots) if at.size < 2 else np.interp(times, at, sizes) ** 2
    return weight / weight.sum()


def unnamed_share(drawn: Sequence[CandidateDraws], amplitudes: Sequence[float]) -> Quantity | None:
    """Return the share of the energy that no sum of the compared terms explains.

    For each draw's own curve, deviation included: its distance from the nearest sum with coefficients that are not
    negative, weighted by the energy lost. The amplitudes at which it is taken fall.
    """
    total = sum(len(d.coefficients) for d in drawn)
    counts = [max(1, round(FEW * len(d.coefficients) / total)) for d in drawn]
    each = zip(drawn, counts, strict=True)
    shares = [share for d, count in each for share in _unexplained(d, amplitudes, count)]
    return quantity(np.array(shares)) if shares else None


def _unexplained(d: CandidateDraws, amplitudes: Sequence[float], count: int) -> list[float]:
    """Return the share of the energy that no sum explains, of some draws of a candidate."""
    every = np.unique(np.linspace(0, len(d.coefficients) - 1, count).astype(int))
    few = CandidateDraws(d.result, *(a[every] for a in (d.coefficients, d.further, d.law, d.g, d.h)))
    unit, curve, energy = [], [], []
    for a in amplitudes:
        per_unit, orbit = ratios_per_unit(few, a, every_term=True), orbit_of(d.result, a)
        if per_unit is None or orbit is None:
            return []
        share = share_of_time(d.result, a)
        own = np.sum(few.coefficients * per_unit, axis=1)
        unit.append(np.broadcast_to(per_unit, few.coefficients.shape))
        curve.append(own * np.exp(at_share(few.g, share)) / (1 + at_share(few.h, share)))
        energy.append(orbit.energy)
    weight = np.abs(np.gradient(np.array(energy)))
    weight /= weight.sum()
    shares = []
    for i in range(len(every)):
        ratio = np.array([c[i] for c in curve])
        if not np.all(ratio > 0):  # without a loss there is no share of it
            continue
        columns = np.array([u[i] for u in unit]) / ratio[:, None]
        scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
        nearest = scipy.optimize.nnls(np.sqrt(weight)[:, None] * columns / scale, np.sqrt(weight))[0]
        shares.append(float(weight @ np.abs(1 - columns / scale @ nearest)))
    return shares


def midline_drift(result: CandidateResult) -> float:
    """Return how far the midline moves from a record's start to its end, as a share of its first amplitude.

    From the straight line through the means, cycle by cycle, of what a candidate's plain fit leaves; 0 where this is
    less than `CLEAR` of the sds that the scatter of these means gives it.
    """
    data, left, scale = result.data, result.fit.residual, result.data.recorded_amplitude
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
    return drift / scale if abs(drift) > CLEAR * np.sqrt(scatter / (place @ place)) else 0.0


def left_over(result: CandidateResult) -> tuple[float, float]:
    """Return the rms of what a plain fit leaves beyond noise, and of the noise, as shares of the amplitude."""
    about = result.about
    left = result.fit.residual if about is None else about.left
    # Amplitudes alone: a phase that slips over thousands of cycles is a tiny error of the frequency.
    residual = result.data.of_amplitude(result.fit.residual)
    clean = float(left @ left) / max(left.size - (0 if about is None else about.u.size), 1)
    rest = max(float(residual @ residual) / residual.size - clean, 0.0)
    amplitude, each = result.data.recorded_amplitude, result.data.thinned
    return float(np.sqrt(rest)) / amplitude, float(np.sqrt(clean * each)) / amplitude
