"""One power of the amplitude in place of a sum of dampings: its exponent, and its odds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.numbers.draws import Quantity
from bayesdamp.inference.envelope.candidates import Candidate, weigh_power
from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.ranking import Ranking
from bayesdamp.inference.envelope.sums import sums_on, weighed

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
