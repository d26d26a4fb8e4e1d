"""Which damping sum the evidence names, one power of the amplitude instead, and sums that no envelope distinguishes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from bayesdamp.inference.curves.weighted import shares
from bayesdamp.inference.deviation.draws import Quantity
from bayesdamp.inference.envelope.candidates import Blocks, EnvelopeCandidate, weigh_power
from bayesdamp.inference.envelope.sums import Sum, sums_on, weighed
from bayesdamp.physics.amplitude import POWERS, Scale

ALONG = 65
"""Amplitudes, evenly spaced in their logarithm."""
SAME = 1e-4
"""Root mean square difference of two relative losses that no record shows."""
EXCLUDED = 7.0
"""Nats behind the most probable sum at which the other's parameters are where their priors exclude them."""
LEAST, MOST = 0.0, 3.0
"""Range of the exponent of a power law."""
GRID = 3001
"""Values of the exponent."""
NEGLIGIBLE = 1e-5
"""Weight in a mixture, relative to the largest, that is ignored."""


@dataclass(frozen=True, eq=False)
class Ranking:
    """Damping sums on a record and their weights.

    Attributes
    ----------
    sums, candidates
        The sums, and all of their candidates.
    log_evidence
        Log evidence of each sum plus its log prior, the law's deviation integrated out, (sums,).
    log_exact
        The part of it under laws that hold exactly, with their prior probability, (sums,).
    """

    sums: tuple[Sum, ...]
    candidates: tuple[EnvelopeCandidate, ...]
    log_evidence: np.ndarray
    log_exact: np.ndarray

    @property
    def probability(self) -> np.ndarray:
        """Probability of each sum."""
        return shares(self.log_evidence)

    @property
    def best(self) -> Sum:
        """The most probable sum."""
        return self.sums[int(np.argmax(self.log_evidence))]

    @property
    def best_exact(self) -> Sum:
        """The most probable sum under laws that hold exactly."""
        return self.sums[int(np.argmax(self.log_exact))]

    @property
    def fitted(self) -> EnvelopeCandidate:
        """The most probable candidate of the most probable sum."""
        own = (c for c in self.candidates if c.name == self.best.name)
        return max(own, key=lambda c: c.total + c.log_share)

    @property
    def exact(self) -> float:
        """Probability that the law holds exactly."""
        return float(np.exp(np.logaddexp.reduce(self.log_exact) - np.logaddexp.reduce(self.log_evidence)))

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms of all sums, the paper's first."""
        terms = dict.fromkeys(term for s in self.sums for term in s.terms)
        return tuple(sorted(terms, key=lambda term: (*POWERS, *terms).index(term)))

    @property
    def by_sum(self) -> dict[str, float]:
        """Probability of each sum by name."""
        return {s.name: float(p) for s, p in zip(self.sums, self.probability, strict=True)}

    @property
    def by_term(self) -> dict[str, float]:
        """Probability of each term, over all sums that have it."""
        each = list(zip(self.sums, self.probability, strict=True))
        return {term: float(sum(p for s, p in each if term in s.terms)) for term in self.terms}


def ranked(sums: Sequence[Sum], candidates: Sequence[EnvelopeCandidate]) -> Ranking:
    """Rank sums by all of their candidates."""

    def by_sum(logs: Sequence[float]) -> np.ndarray:
        """Return ln of the sum over each sum's candidates."""
        own = [[z for z, c in zip(logs, candidates, strict=True) if c.name == s.name] for s in sums]
        return np.array([np.logaddexp.reduce(each) for each in own])

    log_evidence = by_sum([c.total + c.log_share for c in candidates])
    log_exact = by_sum([c.total_exact + c.log_share for c in candidates])
    return Ranking(tuple(sums), tuple(candidates), log_evidence, log_exact)


def untold(ranking: Ranking) -> tuple[tuple[str, str], ...]:
    """Return pairs of sums, with the most probable one among them, of which the first loses as the second does.

    The first has further parameters besides coefficients and is not simpler than the second: only the priors choose
    between them. A simpler law within a wider one is distinguished by its evidence.
    """
    best, most = ranking.best, ranking.log_evidence.max()
    near = [s for s, z in zip(ranking.sums, ranking.log_evidence, strict=True) if z > most - EXCLUDED]
    pairs = [(best, s) for s in near] + [(s, best) for s in near]
    return tuple((a.name, b.name) for a, b in pairs if _loses_as(ranking, a, b))


def _loses_as(ranking: Ranking, a: Sum, b: Sum) -> bool:
    if a.count == 0 or b.count > 0 or len(a.terms) + a.count < len(b.terms):
        return False
    law, own = b.law(), [c for c in ranking.candidates if c.name == a.name]
    for c in own:
        x = np.linspace(c.fit[0], c.fit[-1], ALONG)
        shapes = law.shapes(x) / np.maximum(c.law.rate(x, c.rates), 1e-300)
        if nnls(shapes.T, np.ones(x.size))[1] > SAME * np.sqrt(x.size):
            return False
    return True


@dataclass(frozen=True)
class PowerFit:
    """The power law dA/dt = -cA^p: the exponent p, and the log Bayes factor against the mixture of sums (`odds`)."""

    exponent: Quantity
    odds: float


def power_law(b: Blocks, ranking: Ranking) -> PowerFit:
    """Weigh a power law on a decay whose sums are ranked."""
    log_z, mean, variance = weigh_power(b)
    prior = np.logaddexp.reduce([s.log_prior for s in ranking.sums])
    odds = float(np.logaddexp.reduce(log_z) - np.logaddexp.reduce(ranking.log_evidence) + prior)
    return PowerFit(mixture_range(log_z, mean, variance, LEAST, MOST), odds)


def by_power(b: Blocks) -> list[EnvelopeCandidate]:
    """Weigh one power of the velocity, as a damping term."""
    return weighed(b, sums_on([("power",)], Scale(), b.ends[0], float(b.x.min())))


def mixture_range(
    log_weight: np.ndarray, mean: np.ndarray, variance: np.ndarray, least: float, most: float
) -> Quantity:
    """Return median and 95 % interval of a mixture of normals that is truncated at both ends.

    Parameters
    ----------
    log_weight, mean, variance : ndarray, shape (n,)
        Of the normals.
    least, most : float
        The ends.
    """
    weight = np.exp(log_weight - log_weight.max())
    grid = np.linspace(least, most, GRID)
    density = np.zeros_like(grid)
    for w, m, v in zip(weight, mean, variance, strict=True):
        if w > NEGLIGIBLE:
            density += w / np.sqrt(v) * np.exp(-0.5 * (grid - m) ** 2 / v)
    total = np.cumsum(density)
    if not total[-1] > 0:  # narrower than the grid, or beyond one of its ends
        centre, cell = float(np.clip(weight @ mean / weight.sum(), least, most)), (most - least) / (GRID - 1)
        return Quantity(centre, max(centre - 0.5 * cell, least), min(centre + 0.5 * cell, most))
    low, middle, high = (float(q) for q in np.interp([0.025, 0.5, 0.975], total / total[-1], grid))
    return Quantity(middle, low, high)
