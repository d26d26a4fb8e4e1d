"""The posterior of the motions themselves, by a sequential Monte Carlo sampler that starts from the linear model's.

Draws of the linear posterior are led to the one that solves every motion, along L_linear^(1−β) L^β with β from 0 to 1
(P. Del Moral, A. Doucet and A. Jasra, J. R. Stat. Soc. B 68, 2006, 411). Both ends share prior and noise, so that a
draw's weight is the ratio of two likelihoods, and the moves are Crank–Nicolson steps that leave the linear posterior as
it is (S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, Stat. Sci. 28, 2013, 424): their acceptance asks for that
ratio alone, in any number of dimensions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.curves.weighted import effective, resampled
from bayesdamp.inference.deviation.gaussian.linear import Weighed
from bayesdamp.numerics.pareto import pareto_k

DRAWS = 300
KEPT = 0.5
"""Share of the draws that the weights of one temperature must be worth (conventional)."""
FEW = 0.15
"""Share of the first draws that their weights must be worth for more draws to cost less than moves (conventional)."""
MARGIN = 1.2
"""More draws than the first ones promise to be enough."""
HEAVY = 0.7
"""Shape of the weights' tail beyond which they are not relied on (Vehtari et al., 2024)."""
MOVES, LAST = 2, 5
"""Moves of every draw at each temperature, and at the last; none where the first draws are already worth `KEPT`."""
FIRST_STEP, LEAST_STEP = 0.5, 0.02
WANTED = 0.35
"""Acceptance that the step is steered to."""
MOST_TEMPERATURES = 30
LEAST_RISE = 1e-6
MOVED = 0.05
"""Acceptance at the last temperature below which the draws are not trusted."""


@dataclass(frozen=True)
class Sampled:
    """Draws of the posterior of the motions themselves.

    draws: u = (scores, log g, h), (n, K), with equal weights; log_evidence in nats with its standard error;
    temperatures: how many were passed; acceptance: of the last moves.
    """

    draws: np.ndarray
    log_evidence: float
    stderr: float
    temperatures: int
    acceptance: float

    @property
    def trusted(self) -> bool:
        """Whether enough of the last moves were taken for the draws to have left the linear model's."""
        return self.acceptance >= MOVED


@dataclass
class _Cloud:
    """Draws on their way: the combination of hyperparameters each came from, (n,), u, (n, K), log of L / L_linear."""

    combo: np.ndarray
    u: np.ndarray
    ratio: np.ndarray

    def taken(self, rows: np.ndarray) -> None:
        self.combo, self.u, self.ratio = self.combo[rows], self.u[rows], self.ratio[rows]


def sampled(
    ratio: Callable[[np.ndarray], np.ndarray],
    weighed: Weighed,
    positive: np.ndarray,
    *,
    draws: int = DRAWS,
    seed: int = 0,
) -> Sampled:
    """Draws and evidence of the posterior that is `ratio` times the linear one.

    ratio: log of the likelihood over the linear model's, of draws (n, K): (n,), −∞ where a motion escapes. positive:
    which scores must not be negative, (d,).
    """
    rng = np.random.default_rng(seed)
    u, combo = weighed.draws(positive, draws, rng)
    cloud = _Cloud(combo, u, ratio(u))
    if not np.any(np.isfinite(cloud.ratio)):
        return Sampled(cloud.u, -np.inf, float("nan"), 0, 0.0)
    whole = _whole(rng, cloud, weighed, positive, ratio, draws)
    if whole is not None:
        return whole
    beta, step, log_evidence, variance, passed = 0.0, FIRST_STEP, 0.0, 0.0, 0
    accepted = 1.0
    while beta < 1.0 and passed < MOST_TEMPERATURES:
        rise = _rise(cloud.ratio, 1.0 - beta)
        logs = rise * np.maximum(cloud.ratio, -1e300)
        log_evidence += float(np.logaddexp.reduce(logs)) - np.log(draws)
        weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
        variance += float(np.sum(weights**2)) - 1.0 / draws
        beta, passed = beta + rise, passed + 1
        cloud.taken(resampled(logs, draws, rng))
        for _ in range(LAST if beta >= 1.0 else MOVES):
            # One Crank–Nicolson step of every draw within its combination of hyperparameters.
            means, factors = weighed.means[cloud.combo], weighed.factors[cloud.combo]
            noise = np.einsum("nij,nj->ni", factors, rng.standard_normal(cloud.u.shape))
            new = means + np.sqrt(1 - step**2) * (cloud.u - means) + step * noise
            inside = np.all(new[:, np.flatnonzero(positive)] >= 0, axis=1)
            there = np.full(len(new), -np.inf)
            if inside.any():
                there[inside] = ratio(new[inside])
            gain = beta * (there - np.where(np.isfinite(cloud.ratio), cloud.ratio, -1e300))
            yes = np.log(rng.random(len(new))) < gain
            cloud.u[yes], cloud.ratio[yes] = new[yes], there[yes]
            accepted = float(np.mean(yes))
            step = float(np.clip(step * np.exp(accepted - WANTED), LEAST_STEP, 1.0))
    if beta < 1.0:
        accepted = 0.0
    return Sampled(
        cloud.u, weighed.log_evidence + log_evidence, float(np.sqrt(max(variance, 0.0))), passed, accepted
    )  # fmt: skip


def _whole(
    rng: np.random.Generator,
    cloud: _Cloud,
    weighed: Weighed,
    positive: np.ndarray,
    ratio: Callable[[np.ndarray], np.ndarray],
    draws: int,
) -> Sampled | None:
    """All the way in one step, with as many more draws as make their weights worth `KEPT` of those that are asked for;
    None where these are too many, or a few carry the others."""
    worth = _worth(cloud.ratio, 1.0)
    if worth < FEW:
        return None
    u, ratios = cloud.u, cloud.ratio
    if worth < KEPT:
        more = weighed.draws(positive, int(np.ceil(draws * (MARGIN * KEPT / worth - 1.0))), rng)[0]
        u, ratios = np.concatenate([u, more]), np.concatenate([ratios, ratio(more)])
        if _worth(ratios, 1.0) * ratios.size < KEPT * draws or pareto_k(ratios) > HEAVY:
            return None
    logs = np.maximum(ratios, -1e300)
    weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
    error = float(np.sqrt(max(np.sum(weights**2) - 1.0 / ratios.size, 0.0)))
    taken = u[resampled(logs, draws, rng)]
    evidence = weighed.log_evidence + float(np.logaddexp.reduce(logs)) - float(np.log(ratios.size))
    return Sampled(taken, evidence, error, 1, 1.0)


def _rise(ratio: np.ndarray, most: float) -> float:
    """By how much β may rise so that the weights stay worth `KEPT` of the draws."""
    from scipy.optimize import brentq

    def worth(rise: float) -> float:
        return _worth(ratio, rise) - KEPT

    if worth(most) >= 0:
        return most
    if worth(LEAST_RISE) < 0:  # motions that escape have no weight at any temperature
        return LEAST_RISE
    return float(brentq(worth, LEAST_RISE, most, xtol=LEAST_RISE))  # type: ignore[arg-type]


def _worth(ratio: np.ndarray, rise: float) -> float:
    """Which share of the draws their weights are worth after such a rise of β (Kong 1992)."""
    return effective(rise * np.maximum(ratio, -1e300)) / ratio.size
