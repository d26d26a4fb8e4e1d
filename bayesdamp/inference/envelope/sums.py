"""Damping sums on an envelope: those that it can distinguish, their decay laws, their evidence and their probabilities.

The posterior of further parameters of terms is represented by points from adaptive multiple importance sampling: each
round of points is from a normal distribution fitted to all earlier points, and all points are weighted against the
mixture of these distributions (J.-M. Cornuet, J.-M. Marin, A. Mira and C. P. Robert, Scand. J. Stat. 39, 798 (2012)).
The points come from a low-discrepancy sequence instead of random numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtri

from bayesdamp.inference.deviation.draws import Quantity
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import MEAN_G, PROBABILITY_EXACT
from bayesdamp.inference.envelope.candidates import (
    POWER_MOST,
    Blocks,
    EnvelopeCandidate,
    fit_rates,
    weigh,
    weigh_power,
)
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR
from bayesdamp.numerics.weights import effective_size, normalise
from bayesdamp.physics.amplitude import (
    POWERS,
    SUMS,
    ClosedForm,
    DecayLaw,
    Scale,
    Shape,
    TabulatedLaw,
    are_proportional,
    log_loss,
)
from bayesdamp.physics.damping import TERMS, DampingTerm
from bayesdamp.priors import FURTHER_TERM, SHARED_SCALES, odds
from bayesdamp.records.envelope.window import ABOVE_FLOOR
from bayesdamp.types import InputError

HOPELESS = 25.0
"""Distance to the best log evidence with the first noise (nats) from which a sum is not evaluated with the other
noises,
which change it by a few nats."""
POINTS = 24
"""Number of points that represent the posterior of the further parameters of a sum."""
FIRST_ROUNDS = 6
"""Number of rounds of points in the search for the best fit of a sum with further parameters."""
SMALL = 0.01
"""Smallest relative rate of a term at the reference amplitude, as a fraction of its largest along the decay. (A
coefficient is
measured by the rate at the reference amplitude.)"""
STEEP = 3.0
"""Largest power of the amplitude in dA/dt among the terms of the package."""
BEYOND = 1.0
"""Range of ln A beyond the readings in which a law is tabulated."""
ROUND = 16
"""Number of points in a round."""
ROUNDS = 12
"""Greatest number of rounds; a posterior that is a thousand times narrower than the prior needs eight."""
ENOUGH_EFFECTIVE = 32.0
"""Effective number of points at which sampling ends."""
WIDER = 1.5
"""Factor of the variance of the next normal distribution, relative to that of the points."""
FLATTER = 0.8
"""Factor of the exponent of weights, which is reduced until enough points have weight."""
REACH = 5.0
"""Largest standard normal score of a point."""
MOST_TERMS = 3
"""Greatest number of terms in a sum; a decay cannot distinguish more."""
ASSUMED = (
    "Each term's equivalent damping ratio at the amplitude in the middle of the fall in dB has a half-normal prior. "
    "Its scale is unknown and the same for all terms of a sum: all orders of magnitude between "
    f"{SHARED_SCALES[0]:g} and {SHARED_SCALES[-1]:g} are equally probable. Where the frequency is not known, the "
    "rates have the same prior, with the middle of its scales at one over the duration of the decay.",
    f"Prior odds of a sum: 1 for a single term, times {FURTHER_TERM:g} for each further term.",
    f"The law holds exactly with probability {PROBABILITY_EXACT:g}. Otherwise its rate is multiplied by 1 + g, where g "
    f"has the sd τ, which has an exponential prior with mean {MEAN_G:g}.",
    f"Every rate is known to {100 * SENSOR:g} % (sd) at best (detector, clock). Readings in dB may also contain "
    f"{DRIFT:g} dB of drift or nonlinearity of the detector over half of the decay.",
    f"Readings down to {ABOVE_FLOOR:g} dB above the noise floor are used. The quoted Q and rate are those of the law, "
    "averaged over the first half of the fall in dB; the values at three amplitudes include the deviation.",
)
COMPARED_AMPLITUDES = 65
"""Number of amplitudes, evenly spaced in their logarithm, at which two laws are compared."""
SAME = 1e-4
"""Largest root mean square difference of relative rates at which two laws count as equal."""
EXCLUDED = 7.0
"""Distance to the most probable sum (nats) from which the parameters of another sum are excluded by their priors."""
EXPONENTS = 3001
"""Number of grid values of the exponent of a power law."""
NEGLIGIBLE = 1e-5
"""Relative weight up to which a component of a mixture is left out."""
Sums = tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Sum:
    """A damping sum on one envelope.

    Attributes
    ----------
    terms
        Names of the damping terms.
    start, low
        ln(A/A_ref) at the start, and of the lowest reading.
    each
        The damping terms; () if the sum has only viscous, Coulomb and quadratic damping.
    scale
        Amplitude and frequency with which the parameters of the terms scale.
    """

    terms: tuple[str, ...]
    start: float = 0.0
    low: float = 0.0
    each: tuple[DampingTerm, ...] = ()
    scale: Scale = field(default_factory=Scale)

    @property
    def name(self) -> str:
        """Names of the terms, joined by +."""
        return "+".join(self.terms)

    @property
    def log_prior(self) -> float:
        """Log prior odds."""
        return float(np.log(odds(self.terms)))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of further parameters of each term."""
        return tuple(len(term.inferred) for term in self.each)

    @property
    def count(self) -> int:
        """Number of further parameters of all terms."""
        return sum(self.counts)

    def scores_of(self, scores: Sequence[float], term: int) -> tuple[float, ...]:
        """Return the scores of one term's parameters from the scores of all terms."""
        first = sum(self.counts[:term])
        return tuple(float(z) for z in scores[first : first + self.counts[term]])

    def law(self, scores: Sequence[float] = ()) -> DecayLaw:
        """Return the decay law for scores of the further parameters."""
        if not self.each:
            return ClosedForm(self.terms)

        def shape(term: int) -> Shape:
            own = self.scores_of(scores, term)
            loss, unit = log_loss(self.each[term], own, self.scale), self.unit_rate(term, own)
            return lambda x: np.exp(loss(x - self.start) - unit)

        shapes = tuple(map(shape, range(len(self.each))))
        return TabulatedLaw(self.terms, shapes, self.low - BEYOND, self.start + BEYOND)

    def unit_rate(self, term: int, scores: tuple[float, ...], scale: Scale | None = None) -> float:
        """Return ln of the rate (1/s) at the reference amplitude for a coefficient of 1.

        scale: used instead of that of the sum.
        """
        loss = log_loss(self.each[term], scores, scale or self.scale)
        along = loss(np.append(np.linspace(self.low, self.start, 33), 0.0) - self.start)
        return float(max(along[-1], along.max() + np.log(SMALL)))


def sums_on(asked: Sequence[tuple[str, ...]], scale: Scale, start: float, low: float) -> tuple[Sum, ...]:
    """Return damping sums on an envelope, from the names of their terms.

    Parameters
    ----------
    asked : sequence of tuple of str
        Names of the terms of each sum.
    scale, start, low
        Attributes of the sums.
    """
    return tuple(
        Sum(terms, start, low, () if set(terms) <= set(POWERS) else tuple(map(TERMS.get, terms)), scale)
        for terms in asked
    )


def further_terms(sums: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Return the names of all terms other than viscous, Coulomb and quadratic damping."""
    return tuple(dict.fromkeys(t for terms in sums for t in terms if t not in POWERS))


def assumed(sums: Sequence[tuple[str, ...]], left_out: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the assumptions of an answer with these sums, one sentence each.

    Parameters
    ----------
    sums : sequence of tuple of str
        Terms of each sum.
    left_out : sequence of str
        Sentences on the sums that are left out.
    """
    compared = () if tuple(sums) == SUMS else (f"Damping sums compared: {', '.join(map('+'.join, sums))}.",)
    inferred = [p for name in further_terms(sums) for p in TERMS.get(name).inferred]
    each = ", ".join(f"{p.name} {p.prior(1.0, 1.0).describe()}" for p in inferred)
    further = (
        "Further parameters of terms have the terms' own priors, here in units of the amplitude at the start and the "
        f"angular frequency: {each}.",
    )
    return (*compared, *left_out, *(further if inferred else ()), *ASSUMED)


def weighable(sums: Sequence[tuple[str, ...]]) -> tuple[Sums, tuple[str, ...]]:
    """Return the sums that an envelope can distinguish, and a sentence on each other sum.

    Two terms cannot be distinguished if they dissipate the same energy at every amplitude, up to a factor.

    Raises
    ------
    InputError
        If a sum has too many terms, or no sum is left.
    """
    if set(sums) == set(SUMS):
        return SUMS, ()

    for asked in sums:
        if len(asked) > MOST_TERMS:
            raise InputError(
                f"damping {'+'.join(asked)}: a sum for an envelope has at most {MOST_TERMS} terms; leave one out"
            )
    terms = list(dict.fromkeys([*POWERS, *(t for asked in sums for t in asked)]))
    for name in terms:
        if not TERMS.get(name).inferred:
            log_loss(TERMS.get(name))
    first = {
        t: next(u for u in terms if u == t or are_proportional(TERMS.get(u), TERMS.get(t))) for t in terms
    }
    distinguished: dict[frozenset[str], tuple[str, ...]] = {}
    left_out = []
    for asked in dict.fromkeys(sums):
        distinct, name = frozenset(first[t] for t in asked), "+".join(asked)
        if len(distinct) < len(asked):
            twins = " and ".join(t for t in asked if sum(first[u] == first[t] for u in asked) > 1)
            left_out.append(f"{name} is left out: {twins} dissipate the same energy at every amplitude.")
        elif distinct in distinguished:
            same = "+".join(distinguished[distinct])
            left_out.append(
                f"{name} is left out: it dissipates the same energy as {same} at every amplitude."
            )
        else:
            distinguished[distinct] = asked
    if not distinguished:
        raise InputError(f"damping {left_out[0]} Name other sums")
    return tuple(distinguished.values()), tuple(left_out)


def loosest_fit(b: Blocks, sums: Sequence[Sum], inverse: np.ndarray) -> tuple[DecayLaw, float, np.ndarray]:
    """Return a decay law that fits at least as well as any of these sums, ln A at its start, and its rates.

    It includes viscous, Coulomb and quadratic damping, and the terms of the best of the other sums; or the third power
    of the amplitude if that fits best.
    """
    steep = TabulatedLaw(("steep",), (_power(STEEP),), float(b.x.min()) - BEYOND, b.ends[0] + BEYOND)
    fits = [(law, fit_rates(b, law, inverse)) for law in (ClosedForm(SUMS[-1]), steep)]
    fits += [_fit_sum(b, s, inverse) for s in sums if s.each]
    law, fit = min(fits, key=lambda pair: pair[1].squares)
    x0, rates = float(fit.values[-1]), fit.values[:-1]
    if law.terms == SUMS[-1]:
        return law, x0, rates
    assert isinstance(law, TabulatedLaw)
    more = tuple(term for term in SUMS[-1] if term not in law.terms)
    shapes = tuple(_power(POWERS[term]) for term in more)
    law = replace(law, terms=law.terms + more, each=law.each + shapes)
    return law, x0, np.append(rates, np.zeros(len(more)))


def _fit_sum(b: Blocks, s: Sum, inverse: np.ndarray) -> tuple[DecayLaw, LeastSquaresFit]:
    """Return the law of a sum for the best scores of its further parameters, and its fit."""

    @cache
    def at(scores: tuple[float, ...]) -> tuple[DecayLaw, LeastSquaresFit]:
        law = s.law(scores)
        return law, fit_rates(b, law, inverse)

    if not s.count:
        return at(())
    explored = explore(lambda z: -0.5 * at(z)[1].squares, s.count, FIRST_ROUNDS)
    return min((at(tuple(z)) for z in explored.points.tolist()), key=lambda pair: pair[1].squares)


def _power(power: float) -> Shape:
    """Return the relative rate for dA/dt proportional to a power of A."""
    return lambda x: np.exp((power - 1.0) * x)


def compare_sums(b: Blocks, sums: Sequence[Sum]) -> list[EnvelopeCandidate]:
    """Compute the evidence of every sum with the first noise, and of those near the best with all noises.

    A sum with further parameters gives a candidate for each point that represents their posterior.

    Parameters
    ----------
    b : Blocks
        The readings with their noises.
    sums : sequence of Sum
        The sums.

    Returns
    -------
    list of EnvelopeCandidate
        The candidates of all sums.
    """
    roughly = b.with_first_noise
    first = [explore(_evidence(roughly, s), s.count) if s.count else weigh(roughly, s.law()) for s in sums]
    totals = [known.log_integral if isinstance(known, WeightedPoints) else known.total for known in first]
    most = max(totals)
    candidates = []
    for s, known, total in zip(sums, first, totals, strict=True):
        tried = b if total > most - HOPELESS else roughly
        if isinstance(known, EnvelopeCandidate):
            candidates.append(weigh(tried, known.law, known, log_share=s.log_prior))
            continue
        points, times = np.unique(known.resample(POINTS), axis=0, return_counts=True)
        for scores, count in zip(map(tuple, points.tolist()), times, strict=True):
            law = s.law(scores)
            alone = weigh(roughly, law)
            # Each point represents a fraction of the evidence of its sum, which changes with the other noises like its
            # own.
            log_fraction = total - alone.total + np.log(count / POINTS) + s.log_prior
            candidates.append(weigh(tried, law, alone, scores, float(log_fraction)))
    return candidates


def _evidence(b: Blocks, s: Sum) -> Callable[[tuple[float, ...]], float]:
    """Return the log evidence of a sum as a function of the scores of its further parameters."""
    rates: np.ndarray | None = None

    def at(scores: tuple[float, ...]) -> float:
        nonlocal rates
        candidate = weigh(b, s.law(scores), begin=rates)
        rates = np.maximum(candidate.rates, 1e-3 * b.mean_rate)  # a start for the next fit
        return candidate.total

    return at


@dataclass(frozen=True)
class WeightedPoints:
    """Weighted points of a density: scores (n, e), and log weights (n,), whose exponentials sum to its integral."""

    points: np.ndarray
    log_weight: np.ndarray

    @property
    def log_integral(self) -> float:
        """Log integral of the density."""
        return float(np.logaddexp.reduce(self.log_weight))

    @property
    def best(self) -> np.ndarray:
        """The point with the largest weight, (e,)."""
        return self.points[int(np.argmax(self.log_weight))]

    def resample(self, count: int) -> np.ndarray:
        """Return points of equal weight, (count, e), at even quantiles along the widest direction."""
        weight = normalise(self.log_weight)
        off = self.points - weight @ self.points
        widest = np.linalg.eigh((off.T * weight) @ off)[1][:, -1]
        order = np.argsort(self.points @ widest)
        cumulative = np.cumsum(normalise(self.log_weight[order]))
        at = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count)
        return self.points[order][np.minimum(at, len(order) - 1)]


def explore(
    log_likelihood: Callable[[tuple[float, ...]], float], count: int, rounds: int = ROUNDS
) -> WeightedPoints:
    """Represent the density of some scores, standard normal prior times likelihood, by weighted points.

    Parameters
    ----------
    log_likelihood : callable
        Function from scores to the log likelihood in nats.
    count : int
        Number of scores.
    rounds : int
        Greatest number of rounds.

    Returns
    -------
    WeightedPoints
        The points.
    """
    # An additive recurrence is a low-discrepancy sequence in the unit cube. Its steps are powers of 1/x, where
    # x^(count + 1) = x + 1 (M. Roberts 2018; the golden ratio for one score).
    root = 2.0
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (count + 1))
    steps = root ** -np.arange(1.0, count + 1)
    prior = (np.zeros(count), np.eye(count))
    proposals: list[tuple[np.ndarray, np.ndarray]] = [prior]
    points, logs = np.empty((0, count)), np.empty(0)
    while True:
        mean, triangle = proposals[-1]
        even = (0.5 + np.arange(len(points) + 1, len(points) + ROUND + 1)[:, None] * steps) % 1.0
        drawn = np.clip(ndtri(even) @ triangle.T + mean, -REACH, REACH)
        points = np.vstack([points, drawn])
        logs = np.append(logs, [log_likelihood(tuple(z)) for z in drawn.tolist()])
        mixture = np.logaddexp.reduce([_log_normal(points, *proposal) for proposal in proposals], axis=0)
        log_weight = logs + _log_normal(points, *prior) - mixture - np.log(ROUND)
        if effective_size(log_weight) >= ENOUGH_EFFECTIVE or len(proposals) >= rounds:
            return WeightedPoints(points, log_weight)
        # The next normal distribution is fitted to the points, with weights flattened until enough points have weight.
        power = 1.0
        while effective_size(power * log_weight) < 2.0 + 2.0 * count:
            power *= FLATTER
        weight = normalise(power * log_weight)
        mean = weight @ points
        off = points - mean
        covariance = WIDER * (off.T * weight) @ off
        covariance += 1e-10 * np.eye(count) + 1e-4 * np.diag(np.diag(covariance))
        proposals.append((mean, np.linalg.cholesky(covariance)))


def _log_normal(points: np.ndarray, mean: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """Return the log density, (n,), of a normal distribution with Cholesky factor `triangle`."""
    z = np.linalg.solve(triangle, (points - mean).T)
    log_det = np.log(np.diag(triangle)).sum()
    return -0.5 * np.sum(z * z, axis=0) - log_det - 0.5 * mean.size * np.log(2 * np.pi)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Damping sums on an envelope and their probabilities.

    Attributes
    ----------
    sums, candidates
        The sums, and all their candidates.
    log_evidence
        Log evidence plus log prior odds of each sum, with the deviation integrated out, (sums,).
    log_exact
        The part of it under exact laws, including their prior probability, (sums,).
    """

    sums: tuple[Sum, ...]
    candidates: tuple[EnvelopeCandidate, ...]
    log_evidence: np.ndarray
    log_exact: np.ndarray

    @property
    def probability(self) -> np.ndarray:
        """Probability of each sum."""
        return normalise(self.log_evidence)

    @property
    def best(self) -> Sum:
        """The most probable sum."""
        return self.sums[int(np.argmax(self.log_evidence))]

    @property
    def best_exact(self) -> Sum:
        """The most probable sum under exact laws."""
        return self.sums[int(np.argmax(self.log_exact))]

    @property
    def fitted(self) -> EnvelopeCandidate:
        """The most probable candidate of the most probable sum."""
        of_best = (c for c in self.candidates if c.name == self.best.name)
        return max(of_best, key=lambda c: c.total + c.log_share)

    @property
    def exact(self) -> float:
        """Posterior probability of exact laws."""
        return float(np.exp(np.logaddexp.reduce(self.log_exact) - np.logaddexp.reduce(self.log_evidence)))

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms of all sums, the three terms of the paper first."""
        terms = dict.fromkeys(term for s in self.sums for term in s.terms)
        return tuple(sorted(terms, key=lambda term: (*POWERS, *terms).index(term)))

    @property
    def by_sum(self) -> dict[str, float]:
        """Probability of each sum, by name."""
        return {s.name: float(p) for s, p in zip(self.sums, self.probability, strict=True)}

    @property
    def by_term(self) -> dict[str, float]:
        """Total probability of all sums with a term, by term."""
        each = list(zip(self.sums, self.probability, strict=True))
        return {term: float(sum(p for s, p in each if term in s.terms)) for term in self.terms}


def rank_sums(sums: Sequence[Sum], candidates: Sequence[EnvelopeCandidate]) -> Ranking:
    """Compute the probabilities of sums from all their candidates."""

    def by_sum(logs: Sequence[float]) -> np.ndarray:
        """Add the evidence of the candidates of each damping sum; logs: of all candidates."""
        each_sum = [[z for z, c in zip(logs, candidates, strict=True) if c.name == s.name] for s in sums]
        return np.array([np.logaddexp.reduce(each) for each in each_sum])

    log_evidence = by_sum([c.total + c.log_share for c in candidates])
    log_exact = by_sum([c.total_exact + c.log_share for c in candidates])
    return Ranking(tuple(sums), tuple(candidates), log_evidence, log_exact)


def indistinguishable(ranking: Ranking) -> tuple[tuple[str, str], ...]:
    """Return pairs of sums with nearly the same decay, where one of each pair is the most probable sum.

    The first sum of a pair has further parameters and is not simpler than the second, so that the choice between them
    depends only on the priors. (A simpler law that is a special case is distinguished by its evidence.)
    """
    best, most = ranking.best, ranking.log_evidence.max()
    near = [s for s, z in zip(ranking.sums, ranking.log_evidence, strict=True) if z > most - EXCLUDED]
    pairs = []
    for a, b in [*((best, s) for s in near), *((s, best) for s in near)]:
        if a.count == 0 or b.count > 0 or len(a.terms) + a.count < len(b.terms):
            continue
        law = b.law()
        for c in ranking.candidates:
            if c.name != a.name:
                continue
            x = np.linspace(c.fit[0], c.fit[-1], COMPARED_AMPLITUDES)
            losses = law.shapes(x) / np.maximum(c.law.rate(x, c.rates), 1e-300)
            if nnls(losses.T, np.ones(x.size))[1] > SAME * np.sqrt(x.size):
                break
        else:
            pairs.append((a.name, b.name))
    return tuple(pairs)


@dataclass(frozen=True)
class PowerFit:
    """The power law dA/dt = -cA^p: exponent p, and `odds`, its log Bayes factor against the mixture of all sums."""

    exponent: Quantity
    odds: float


def fit_power_law(b: Blocks, ranking: Ranking) -> PowerFit:
    """Fit a power law, and compare its evidence with that of the damping sums."""
    log_z, mean, variance = weigh_power(b)
    prior = np.logaddexp.reduce([s.log_prior for s in ranking.sums])
    odds = float(np.logaddexp.reduce(log_z) - np.logaddexp.reduce(ranking.log_evidence) + prior)
    return PowerFit(mixture_range(log_z, mean, variance), odds)


def power_candidates(b: Blocks) -> list[EnvelopeCandidate]:
    """Compute the candidates of damping by one power of the velocity (the term `power`)."""
    return compare_sums(b, sums_on([("power",)], Scale(), b.ends[0], float(b.x.min())))


def mixture_range(log_weight: np.ndarray, mean: np.ndarray, variance: np.ndarray) -> Quantity:
    """Return median and 95 % interval of a mixture of normal distributions, truncated at 0 and `POWER_MOST`.

    Parameters
    ----------
    log_weight, mean, variance : ndarray, shape (n,)
        Log weight, mean and variance of each component.
    """
    weight = np.exp(log_weight - log_weight.max())
    grid = np.linspace(0.0, POWER_MOST, EXPONENTS)
    density = np.zeros_like(grid)
    for w, m, v in zip(weight, mean, variance, strict=True):
        if w > NEGLIGIBLE:
            density += w / np.sqrt(v) * np.exp(-0.5 * (grid - m) ** 2 / v)
    total = np.cumsum(density)
    if not total[-1] > 0:  # the mixture is narrower than the grid, or outside it
        centre = float(np.clip(weight @ mean / weight.sum(), 0.0, POWER_MOST))
        half = 0.5 * (POWER_MOST / (EXPONENTS - 1))
        return Quantity(centre, max(centre - half, 0.0), min(centre + half, POWER_MOST))
    low, middle, high = (float(q) for q in np.interp([0.025, 0.5, 0.975], total / total[-1], grid))
    return Quantity(middle, low, high)
