"""Which damping sum the evidence names, one power of the amplitude instead, and sums that no envelope tells apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from bayesdamp.inference.deviation.numbers.draws import Quantity
from bayesdamp.inference.envelope.candidates import Candidate, weigh_power
from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.sums import Sum, sums_on, weighed
from bayesdamp.physics.amplitude.laws import POWERS

ALONG = 65
"""Amplitudes, evenly in their logarithm."""
SAME = 1e-4
"""Root mean square difference of two relative losses that no record shows."""
EXCLUDED = 7.0
"""Nats behind the most probable sum at which the other's parameters are where their priors exclude them."""


def untold(ranking: Ranking) -> tuple[tuple[str, str], ...]:
    """Pairs of sums, the most probable one among them, of which the first loses as the second does.

    The first has parameters beside coefficients and is no simpler than the second: priors alone choose between them. A
    simpler law within a wider one is told by its evidence.
    """
    best, most = ranking.best, ranking.log_evidence.max()
    near = [one for one, z in zip(ranking.sums, ranking.log_evidence, strict=True) if z > most - EXCLUDED]
    pairs = [(best, one) for one in near] + [(one, best) for one in near]
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


LEAST, MOST = 0.0, 3.0
GRID = 3001
"""Values of the exponent."""
NEGLIGIBLE = 1e-5
"""Of the largest weight in a mixture."""


@dataclass(frozen=True)
class PowerLaw:
    """exponent: p of dA/dt = -cA^p; odds: log Bayes factor against the mixture of sums."""

    exponent: Quantity
    odds: float


def power_law(decay: Decay, ranking: Ranking) -> PowerLaw:
    """On a decay whose sums are ranked."""
    log_z, mean, variance = weigh_power(decay.blocks, decay.noises, decay.inverse)
    prior = np.logaddexp.reduce([one.log_prior for one in ranking.sums])
    odds = float(np.logaddexp.reduce(log_z) - np.logaddexp.reduce(ranking.log_evidence) + prior)
    return PowerLaw(mixture_range(log_z, mean, variance, LEAST, MOST), odds)


def by_power(decay: Decay) -> list[Candidate]:
    """One power of the velocity, as a term."""
    from bayesdamp.physics.amplitude.loss import Scale

    b = decay.blocks
    return weighed(
        b, sums_on([("power",)], Scale(), b.ends[0], float(b.x.min())), decay.noises, decay.inverse
    )


def mixture_range(
    log_weight: np.ndarray, mean: np.ndarray, variance: np.ndarray, least: float, most: float
) -> Quantity:
    """Median and 95 % interval of a mixture of normals cut off at both ends; each array (n,)."""
    weight = np.exp(log_weight - log_weight.max())
    grid = np.linspace(least, most, GRID)
    density = np.zeros_like(grid)
    for w, m, v in zip(weight, mean, variance, strict=True):
        if w > NEGLIGIBLE:
            density += w / np.sqrt(v) * np.exp(-0.5 * (grid - m) ** 2 / v)
    total = np.cumsum(density)
    if not total[-1] > 0:  # narrower than the grid, or beyond an end of it
        centre, cell = float(np.clip(weight @ mean / weight.sum(), least, most)), (most - least) / (GRID - 1)
        return Quantity(centre, max(centre - 0.5 * cell, least), min(centre + 0.5 * cell, most))
    low, middle, high = (float(q) for q in np.interp([0.025, 0.5, 0.975], total / total[-1], grid))
    return Quantity(middle, low, high)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Damping sums on a record and what weighs them.

    log_evidence, log_exact: of each sum with its odds before, (sums,), the law's deviation integrated out, and given
    that it holds exactly times that prior.
    """

    sums: tuple[Sum, ...]
    candidates: tuple[Candidate, ...]
    log_evidence: np.ndarray
    log_exact: np.ndarray

    @property
    def probability(self) -> np.ndarray:
        """Of each sum."""
        found = np.exp(self.log_evidence - self.log_evidence.max())
        return found / found.sum()

    @property
    def best(self) -> Sum:
        """The most probable sum."""
        return self.sums[int(np.argmax(self.log_evidence))]

    @property
    def best_exact(self) -> Sum:
        """The most probable sum of those that hold exactly."""
        return self.sums[int(np.argmax(self.log_exact))]

    @property
    def fitted(self) -> Candidate:
        """Its most probable candidate."""
        own = (c for c in self.candidates if c.name == self.best.name)
        return max(own, key=lambda c: c.total + c.log_share)

    @property
    def exact(self) -> float:
        """Probability that the law holds exactly."""
        return float(np.exp(np.logaddexp.reduce(self.log_exact) - np.logaddexp.reduce(self.log_evidence)))

    @property
    def terms(self) -> tuple[str, ...]:
        """Of all sums, the paper's first."""
        there = dict.fromkeys(term for one in self.sums for term in one.terms)
        return tuple(sorted(there, key=lambda term: (*POWERS, *there).index(term)))

    @property
    def by_sum(self) -> dict[str, float]:
        """Probability of each sum by name."""
        return {one.name: float(p) for one, p in zip(self.sums, self.probability, strict=True)}

    @property
    def by_term(self) -> dict[str, float]:
        """Probability of each term, over all sums that have it."""
        each = list(zip(self.sums, self.probability, strict=True))
        return {term: float(sum(p for one, p in each if term in one.terms)) for term in self.terms}


def ranked(sums: Sequence[Sum], candidates: Sequence[Candidate]) -> Ranking:
    """Of sums by all of their candidates."""
    names = [one.name for one in sums]
    return Ranking(
        tuple(sums),
        tuple(candidates),
        _by_sum(names, candidates, [c.total + c.log_share for c in candidates]),
        _by_sum(names, candidates, [c.total_exact + c.log_share for c in candidates]),
    )


def _by_sum(names: Sequence[str], candidates: Sequence[Candidate], logs: Sequence[float]) -> np.ndarray:
    """ln of the sum over each sum's candidates."""
    return np.array(
        [
            np.logaddexp.reduce([one for one, c in zip(logs, candidates, strict=True) if c.name == name])
            for name in names
        ]
    )
