"""Damping from the persistence of a record's sublevel sets (paper, section 3.2).

A. D. Myers and F. A. Khasawneh, Damping parameter estimation using topological signal processing, Mechanical
Systems and Signal Processing 174 (2022) 109042.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import gudhi
import numpy as np
from pydantic import Field
from scipy.optimize import brentq
from scipy.special import erfcinv, erfinv, log_ndtr

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.shared import (
    ORDER,
    checked_features,
    free_names,
    known_restoring,
    noise_level,
    oscillator,
    start_parameters,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.records.oscillation.turning import midpoints
from bayesdamp.types import Estimate, Problem, Refusal, Signal

OPTIMAL_RATIO = 0.3299
"""L_n/L_0 that minimises the variance of the viscous estimate."""
NOISE_OF_MEDIAN = 0.680
"""Standard deviation of white noise over the median of its own lifetimes."""


class TopologicalOptions(Options):
    """variant: as first published, or equations (7) to (11) as the paper prints them.

    significance: probability that noise alone exceeds the cutoff.
    """

    variant: Literal["published", "as_printed"] = "published"
    significance: float = Field(default=0.001, gt=0.0, lt=1.0)


@dataclass(frozen=True)
class Pairs:
    """Births v and deaths p of the components that are no noise, in time order, (k,), and the noise floor.

    cycle (k,): how many periods after the first each is born; a component lost in a gap is counted.
    """

    v: np.ndarray
    p: np.ndarray
    cycle: np.ndarray
    floor: float

    @property
    def lifetimes(self) -> np.ndarray:
        """Persistence p − v of each pair of a peak and a valley, in the unit of the record, (n,)."""
        return self.p - self.v


class Topological(Estimator[TopologicalOptions]):
    """One damping coefficient from the lifetimes of a cycle's sublevel components."""

    options = TopologicalOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Sums of terms, and terms without a formula for the fall of the lifetimes."""
        if len(damping) != 1:
            return "persistence lifetimes give one damping coefficient, not a sum of terms"
        if damping[0] not in PUBLISHED:
            return f"there is no formula that gives {damping[0]} damping from persistence lifetimes"
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: TopologicalOptions, rng: np.random.Generator
    ) -> Estimate:
        """The coefficient from the fall of the persistence lifetimes."""
        seen = checked_features(signal)
        damping, y, omega = problem.damping[0], signal.y - seen.rest, natural_frequency(problem, seen)
        if options.variant == "as_printed":
            pairs = printed_pairs(y, signal, seen, options.significance)
            value = AS_PRINTED[damping](pairs, omega, seen)
        else:
            pairs = published_pairs(y, signal, problem, seen, options.significance)
            # Amplitudes of a velocity or an acceleration are those of the displacement times ω or ω².
            unit = omega ** ORDER[signal.quantity]
            value = PUBLISHED[damping](replace(pairs, v=pairs.v / unit, p=pairs.p / unit), omega)
        values = {oscillator(problem).coefficients[0]: value}
        free = free_names(problem)
        if free:
            start = start_parameters(signal, problem, seen)
            values |= {name: start[name] for name in free}
        return Estimate(self.name, "initial", values, evaluations=1)


def natural_frequency(problem: Problem, seen: Features) -> float:
    """ω_n in rad/s: of the restoring law where it is known, else the record's."""
    osc, known = oscillator(problem), known_restoring(problem)
    if len(known) == len(osc.law.parameters):
        return osc.natural_frequency(known, seen.rest)
    return seen.frequency


def sublevel_pairs(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Births, deaths and times of birth of the finite sublevel components of y (n,), in order of time.

    On the values as they are: a repeated value is one plateau. A component that is born within a tenth of a
    period of an end of the record, or of a gap in it, is cut off there and left out.
    """
    cells = gudhi.CubicalComplex(top_dimensional_cells=y)  # type: ignore[attr-defined]
    cells.persistence(homology_coeff_field=2, min_persistence=0)
    regular = cells.cofaces_of_persistence_pairs()[0]
    if len(regular) == 0 or np.asarray(regular[0]).size == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    first = np.asarray(regular[0])
    births, deaths = first[:, 0], first[:, 1]
    between = np.diff(t)
    gaps = np.flatnonzero(between > max(3 * float(np.median(between)), 0.1 * period))
    edges = t[np.unique(np.r_[0, gaps, gaps + 1, t.size - 1])]
    cut = np.min(np.abs(t[births, None] - edges), axis=1) < 0.1 * period
    if gaps.size:
        cut |= np.min(np.abs(t[deaths, None] - edges[1:-1]), axis=1) < 0.1 * period
    births, deaths = births[~cut], deaths[~cut]
    order = np.argsort(births, kind="stable")
    births, deaths = births[order], deaths[order]
    return y[births], y[deaths], t[births]


def published_pairs(
    y: np.ndarray, signal: Signal, problem: Problem, seen: Features, significance: float
) -> Pairs:
    """The pairs above the cutoff, each shortened by the noise floor.

    σ is the known noise, else the larger of the record's roughness and, where lifetimes are many more than
    cycles, 0.680 of their median.
    Cutoff: C_α = 2^(3/2) σ erf⁻¹[2(1 − √α)^(1/N) − 1], N the number of samples.
    Floor: twice the median by which white noise of that σ lifts the highest sample at a turning point.
    """
    v, p, born = sublevel_pairs(signal.t, y, seen.period)
    lifetimes = p - v
    known = problem.system.known.get("noise_sd")
    if known is not None:
        sigma = float(known)
    else:
        # The signal's slope suppresses lifetimes of weak noise, so their median is only a lower bound.
        sigma = noise_level(signal)
        if lifetimes.size > 4 * (seen.cycles + 1):
            sigma = max(sigma, NOISE_OF_MEDIAN * float(np.median(lifetimes)))
    share = (1.0 - math.sqrt(significance)) ** (1.0 / y.size)
    cutoff = 2**1.5 * sigma * float(erfinv(2.0 * share - 1.0))
    kept = lifetimes > max(cutoff, 1e-9 * float(np.ptp(y)))
    v, p, born = v[kept], p[kept], born[kept]
    if v.size < 2:
        raise Refusal(
            f"{v.size} persistence lifetimes exceed the noise cutoff of {cutoff:.2g}; at least 2 are needed"
        )
    floor = _floor(sigma, 0.5 * float(np.median(p - v)), seen)
    return Pairs(v + floor / 2, p - floor / 2, _cycles(born, seen), floor)


def _cycles(born: np.ndarray, seen: Features) -> np.ndarray:
    return np.round((born - born[0]) / seen.period).astype(int)


def _floor(sigma: float, amplitude: float, seen: Features) -> float:
    """What noise adds to a lifetime: twice the median of the highest sample's lift at a turning point."""
    if sigma < 1e-9 * amplitude:
        return 0.0
    phase = (
        2
        * math.pi
        / seen.samples_per_cycle
        * np.arange(-int(seen.samples_per_cycle / 4), int(seen.samples_per_cycle / 4) + 1)
    )
    drop = amplitude * (1.0 - np.cos(phase))

    def below(lift: float) -> float:
        return float(np.sum(log_ndtr((lift + drop) / sigma))) - math.log(0.5)

    return 2.0 * max(brentq(below, -6 * sigma, 10 * sigma), 0.0)  # type: ignore[arg-type]


def spaced(pairs: Pairs) -> tuple[float, float, int]:
    """L_0, L_n and n: L_n the lifetime whose ratio to the first is nearest the optimal one, else the last."""
    ratio = pairs.lifetimes / pairs.lifetimes[0]
    i = int(np.argmin(np.abs(ratio - OPTIMAL_RATIO))) if np.any(ratio <= OPTIMAL_RATIO) else ratio.size - 1
    i = max(i, 1)
    return float(pairs.lifetimes[0]), float(pairs.lifetimes[i]), max(int(pairs.cycle[i]), 1)


def _viscous(pairs: Pairs, omega: float) -> float:
    """The ratio [1 + (2πn/ln(L_0/L_n))²]^(−1/2), in the paper's unit: times ω_n."""
    longest, shorter, n = spaced(pairs)
    decrement = math.log(longest / shorter)
    return (
        math.copysign(omega / math.sqrt(1.0 + (2 * math.pi * n / decrement) ** 2), decrement)
        if decrement
        else 0.0
    )


def _coulomb(pairs: Pairs, omega: float) -> float:
    """A lifetime falls by 8μ_c/ω_n² a cycle."""
    longest, shorter, n = spaced(pairs)
    return omega**2 * (longest - shorter) / (8 * n)


def _quadratic(pairs: Pairs, omega: float) -> float:
    """Exact over the swing from a minimum v_i to the next maximum p_{i+1} of a zero-mean linear oscillator.

    p_{i+1} − v_i = ln[(2μ v_i − 1)/(2μ p_{i+1} − 1)]/(2μ), from u = θ̇², du/dθ = −2ω_n²θ − 2μu; μ is the
    median over the first four swings. In this form the unit is μ_q's own, 1/rad. Each swing is taken
    about its own midline, which makes the signal zero-mean where the restoring force is not odd. A
    swing whose maximum is not below its minimum in size says zero.
    """
    turns = np.column_stack([pairs.p, pairs.v]).ravel()
    turns = turns - midpoints(turns)
    found = []
    next_cycle = np.diff(pairs.cycle) == 1
    for v, p in np.column_stack([-turns[1:-1:2], turns[2::2]])[next_cycle][:4].tolist():
        if p >= v or p <= 0:
            found.append(0.0)
            continue

        def excess(mu: float, v: float = v, p: float = p) -> float:
            return (math.log1p(2 * mu * v) - math.log1p(-2 * mu * p)) / (2 * mu) - (p + v)

        low, high = 1e-9 / v, 0.5 / p * (1 - 1e-12)
        found.append(brentq(excess, low, high) if excess(low) < 0 < excess(high) else 0.0)
    if not found:
        raise Refusal("fewer than two persistence lifetimes give no swing from a minimum to a maximum")
    return float(np.median(found))


PUBLISHED: dict[str, Callable[[Pairs, float], float]] = {
    "viscous": _viscous,
    "coulomb": _coulomb,
    "quadratic": _quadratic,
}


def printed_pairs(y: np.ndarray, signal: Signal, seen: Features, significance: float) -> Pairs:
    """The pairs above equation (7)'s cutoff, and equation (8)'s floor; erfc⁻¹(2α/N) with N lifetimes."""
    v, p, born = sublevel_pairs(signal.t, y, seen.period)
    count = max(v.size, 2)
    sigma = noise_level(signal)
    cutoff = sigma * math.sqrt(2.0) * float(erfcinv(2 * significance / count))
    floor = sigma * math.sqrt(2.0) * float(erfcinv(2 * significance / (count - 1)))
    kept = p - v > max(cutoff, floor, 1e-9 * float(np.ptp(y)))
    if kept.sum() < 2:
        raise Refusal(
            f"{kept.sum()} persistence lifetimes exceed the noise cutoff, and at least 2 are needed"
        )
    return Pairs(v[kept], p[kept], _cycles(born[kept], seen), floor)


def _printed_viscous(pairs: Pairs, omega: float, seen: Features) -> float:
    """Equation (9), T being the n periods from L_0 to L_n."""
    longest, shorter, n = spaced(pairs)
    return math.log((longest - pairs.floor) / (shorter - pairs.floor)) / (omega * n * seen.period)


def _printed_coulomb(pairs: Pairs, omega: float, seen: Features) -> float:
    """Equation (10)."""
    longest, shorter, n = spaced(pairs)
    return (longest - shorter) / (n * seen.period)


def _printed_quadratic(pairs: Pairs, omega: float, seen: Features) -> float:
    """Equation (11) at n = 1: it has no n, and A_0 is the amplitude about rest."""
    longest, shorter = (pairs.lifetimes[:2] - pairs.floor).tolist()
    return 2 * omega / seen.amplitude * (1 / shorter - 1 / longest)


AS_PRINTED: dict[str, Callable[[Pairs, float, Features], float]] = {
    "viscous": _printed_viscous,
    "coulomb": _printed_coulomb,
    "quadratic": _printed_quadratic,
}

PLUGIN = Topological()
