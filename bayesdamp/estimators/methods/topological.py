"""Estimate damping from the persistence lifetimes of a record's sublevel sets.

A lifetime is the difference between a maximum of the record and the minimum with which it is paired. The method is that
of section 3.2 of the paper that `bayesdamp.estimators` cites. It comes from:

A. D. Myers and F. A. Khasawneh, Damping parameter estimation using topological signal processing, Mechanical
Systems and Signal Processing 174 (2022) 109042.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.optimize import brentq
from scipy.special import erfcinv, erfinv, log_ndtr

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    before_gap,
    checked_features,
    free_names,
    known_restoring,
    noise_level,
    optional_package,
    oscillator,
    start_parameters,
)
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.records.oscillation.features import Features, midpoints
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

OPTIMAL_RATIO = 0.3299
"""Ratio L_n/L_0 of the lifetimes of two cycles, n periods apart, that minimises the variance of the viscous estimate
(Myers and Khasawneh)."""
NOISE_OF_MEDIAN = 0.680
"""Ratio of the standard deviation of white noise to the median of the persistence lifetimes that it causes (Myers and
Khasawneh)."""


class TopologicalOptions(Options):
    """Options of the persistence method.

    variant: "published" uses the formulas as first published by Myers and Khasawneh, "as_printed" equations (7) to (11)
    of the paper that `bayesdamp.estimators` cites. significance: the α of the noise cutoff, the probability that a
    lifetime of noise exceeds it.
    """

    variant: Literal["published", "as_printed"] = "published"
    significance: float = Field(default=0.001, gt=0.0, lt=1.0)


@dataclass(frozen=True)
class Pairs:
    """The components of sublevel sets that are not noise, in time order.

    v, p (k,): values at birth (a minimum) and death (a maximum), relative to the midline; the lifetime is p − v. cycle
    (k,): whole number of periods from the birth of the first component to the birth of this component.
    floor: mean amount by which noise lengthens a lifetime, in the unit of the record. For the variant "published" v and
    p are already corrected for it; for "as_printed" the formulas subtract it.
    """

    v: np.ndarray
    p: np.ndarray
    cycle: np.ndarray
    floor: float

    def choose_lifetimes(self) -> tuple[float, float, int]:
        """Return lifetimes L_0 (the first) and L_n, and the number n of periods between them.

        L_n is the lifetime after L_0 whose ratio L_n/L_0 is nearest to `OPTIMAL_RATIO`, or the last lifetime if all
        ratios are larger. n is at least 1.
        """
        lifetimes = self.p - self.v
        ratio = lifetimes / lifetimes[0]
        i = ratio.size - 1
        if np.any(ratio <= OPTIMAL_RATIO):
            i = max(int(np.argmin(np.abs(ratio - OPTIMAL_RATIO))), 1)
        return float(lifetimes[0]), float(lifetimes[i]), max(int(self.cycle[i]), 1)


class Topological(Estimator[TopologicalOptions]):
    """Compute a damping coefficient from the decrease of persistence lifetimes from cycle to cycle."""

    options = TopologicalOptions

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Return the reason why this method cannot estimate a sum of damping terms; None if it can.

        damping: names of the terms. The method estimates a single term: viscous, Coulomb or quadratic damping.
        """
        if len(damping) != 1:
            return "persistence lifetimes give one damping coefficient, not a sum of terms"
        if damping[0] not in PAPER_TERMS:
            return f"there is no formula that gives {damping[0]} damping from persistence lifetimes"
        return None

    def initial(
        self, signal: Signal, problem: Problem, options: TopologicalOptions, rng: np.random.Generator
    ) -> Estimate:
        """Compute the coefficient from the decrease of the persistence lifetimes, without a standard error.

        The formulas use the natural frequency if all restoring parameters are known, else that of the record. Unknown
        restoring parameters and an unknown start come from the record's features and the smoothed record. Raises
        Refusal if gudhi is not installed, if `checked_features` or `motion` does, if too few lifetimes exceed the
        noise, or if the formula for quadratic damping finds no two successive cycles.
        """
        features = checked_features(signal)
        osc, known = oscillator(problem), known_restoring(problem)
        omega = features.frequency
        if len(known) == len(osc.law.parameters):
            omega = osc.natural_frequency(known, features.rest)
        pairs = significant_pairs(signal, problem, features, options)
        # The amplitude of a velocity (acceleration) is that of the displacement times ω (ω²).
        unit = omega ** DERIVATIVES[signal.quantity]
        pairs = replace(pairs, v=pairs.v / unit, p=pairs.p / unit, floor=pairs.floor / unit)
        damping = problem.damping[0]
        if options.variant == "as_printed":
            # Equations (9) to (11), where T is the time of the n periods from L_0 to L_n. Equation (11) has no n; we
            # use n = 1. A_0 is the amplitude about equilibrium.
            longest, shorter, n = pairs.choose_lifetimes()
            if damping == "viscous":
                decrement = math.log((longest - pairs.floor) / (shorter - pairs.floor))
                value = decrement / (omega * n * features.period)
            elif damping == "coulomb":
                value = (longest - shorter) / (n * features.period)
            else:
                first, second = (pairs.p[:2] - pairs.v[:2] - pairs.floor).tolist()
                value = 2 * omega / features.amplitude * (1 / second - 1 / first)
        else:
            value = _published_coefficient(damping, pairs, omega)
        values = {osc.coefficients[0]: value}
        if free := free_names(problem):
            start = start_parameters(signal, problem, features)
            values |= {name: start[name] for name in free}
        return Estimate(self.name, "initial", values, evaluations=1)


def sublevel_pairs(t: np.ndarray, y: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the finite sublevel components of y (n,) at times t (n,), in time order: three arrays (k,).

    They are the values of y at birth (a minimum), at death (a maximum), and the times of birth; k = 0 if there are
    none. A component of the sublevel sets {y ≤ c} begins, as c rises, at a minimum, and ends when it joins one that
    began lower. period: in s, like t. Components that are born within a tenth of a period of an end of the record are
    incomplete and left out.
    """
    cells = optional_package("gudhi").CubicalComplex(top_dimensional_cells=y)
    cells.persistence(homology_coeff_field=2, min_persistence=0)
    regular = cells.cofaces_of_persistence_pairs()[0]
    if len(regular) == 0 or np.asarray(regular[0]).size == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    births, deaths = np.asarray(regular[0]).T
    whole = np.minimum(t[births] - t[0], t[-1] - t[births]) >= 0.1 * period
    births, deaths = births[whole], deaths[whole]
    order = np.argsort(births, kind="stable")
    births, deaths = births[order], deaths[order]
    return y[births], y[deaths], t[births]


def significant_pairs(
    signal: Signal, problem: Problem, features: Features, options: TopologicalOptions
) -> Pairs:
    """Return the sublevel components whose lifetime exceeds a noise cutoff, as pairs of birth and death.

    Raises Refusal if there are fewer than two.

    Variant "published": the cutoff is C_α = 2^(3/2) σ erf⁻¹[2(1 − √α)^(1/N) − 1] for N samples. σ is the known noise,
    else the noise of the record; if there are many more lifetimes than cycles, it is at least 0.680 times their median.
    Each lifetime is reduced by the noise floor: twice the median amount by which white noise raises the maximum of the
    samples at a turning point. Variant "as_printed": the cutoff of equation (7) and the floor of equation (8) of the
    paper that `bayesdamp.estimators` cites, with erfc⁻¹(2α/N) for N lifetimes; σ is then always the noise of the
    record.
    """
    sigma, signal = noise_level(signal), before_gap(signal, features.period)
    y = signal.y - features.rest
    v, p, born = sublevel_pairs(signal.t, y, features.period)
    lifetimes, floor = p - v, 0.0
    if options.variant == "as_printed":
        count = max(v.size, 2)
        scale = sigma * math.sqrt(2.0)
        cutoff, floor = (scale * float(erfcinv(2 * options.significance / n)) for n in (count, count - 1))
        cutoff = max(cutoff, floor)
    else:
        known = problem.system.known.get("noise_sd")
        if known is not None:
            sigma = float(known)
        elif lifetimes.size > 4 * (features.cycles + 1):
            # The slope of the signal hides short lifetimes of noise, so the median gives a lower bound only.
            sigma = max(sigma, NOISE_OF_MEDIAN * float(np.median(lifetimes)))
        share = (1.0 - math.sqrt(options.significance)) ** (1.0 / y.size)
        cutoff = 2**1.5 * sigma * float(erfinv(2.0 * share - 1.0))
    above = lifetimes > max(cutoff, 1e-9 * float(np.ptp(y)))
    v, p, born = v[above], p[above], born[above]
    if v.size < 2:
        raise Refusal(
            f"only {v.size} persistence lifetimes (rises from a minimum to a maximum) exceed the noise cutoff of "
            f"{cutoff:.2g}; at least 2 are needed"
        )
    if options.variant == "published":
        amplitude = 0.5 * float(np.median(p - v))
        if sigma >= 1e-9 * amplitude:
            quarter = int(features.samples_per_cycle / 4)
            phase = 2 * math.pi / features.samples_per_cycle * np.arange(-quarter, quarter + 1)
            drop = amplitude * (1.0 - np.cos(phase))

            def below(lift: float) -> float:
                return float(np.sum(log_ndtr((lift + drop) / sigma))) - math.log(0.5)

            floor = 2.0 * max(brentq(below, -6 * sigma, 10 * sigma), 0.0)  # type: ignore[arg-type]
        v, p = v + floor / 2, p - floor / 2
    return Pairs(v, p, np.round((born - born[0]) / features.period).astype(int), floor)


def _published_coefficient(damping: str, pairs: Pairs, omega: float) -> float:
    """Return the coefficient by the formulae that Myers and Khasawneh published.

    damping: viscous, coulomb or quadratic. pairs: in the unit of the displacement (rad or m). omega: ω_n in rad/s.

    Viscous: ω_n [1 + (2πn/ln(L_0/L_n))²]^(−1/2); the factor ω_n converts the damping ratio to a rate in 1/s.
    Coulomb: a lifetime decreases by 8μ_c/ω_n² in a cycle.
    Quadratic: for the half cycle from a minimum v_i to the next maximum p_{i+1} of a linear oscillator, p_{i+1} − v_i =
    ln[(2μ v_i − 1)/(2μ p_{i+1} − 1)]/(2μ), which follows from u = θ̇², du/dθ = −2ω_n²θ − 2μu. The result is the median
    of μ over the first four half cycles, in 1/rad. Each half cycle is taken about its own midline, because the formula
    assumes zero mean. A half cycle whose maximum is not smaller than its minimum in size counts as μ = 0. Raises
    Refusal if no two successive cycles have a component.
    """
    longest, shorter, n = pairs.choose_lifetimes()
    if damping == "viscous":
        decrement = math.log(longest / shorter)
        if decrement == 0:
            return 0.0
        return math.copysign(omega / math.sqrt(1.0 + (2 * math.pi * n / decrement) ** 2), decrement)
    if damping == "coulomb":
        return omega**2 * (longest - shorter) / (8 * n)
    turns = np.column_stack([pairs.p, pairs.v]).ravel()
    turns = turns - midpoints(turns)
    coefficients = []
    next_cycle = np.diff(pairs.cycle) == 1
    for v, p in np.column_stack([-turns[1:-1:2], turns[2::2]])[next_cycle][:4].tolist():
        if p >= v or p <= 0:
            coefficients.append(0.0)
            continue

        def excess(mu: float, v: float = v, p: float = p) -> float:
            return (math.log1p(2 * mu * v) - math.log1p(-2 * mu * p)) / (2 * mu) - (p + v)

        low, high = 1e-9 / v, 0.5 / p * (1 - 1e-12)
        coefficients.append(brentq(excess, low, high) if excess(low) < 0 < excess(high) else 0.0)
    if not coefficients:
        raise Refusal(
            "no two successive cycles of the record have persistence lifetimes above the noise cutoff"
        )
    return float(np.median(coefficients))


PLUGIN = Topological()
