"""The posterior of the motions themselves, by a sequential Monte Carlo sampler that starts from the linear model's.

Draws of the linear posterior are led to the posterior that solves every motion, along L_linear^(1−β) L^β with β from
0 to 1 (P. Del Moral, A. Doucet and A. Jasra, J. R. Stat. Soc. B 68, 2006, 411). Both ends share prior and noise, so
that a draw's weight is the ratio of two likelihoods. The moves are Crank–Nicolson steps, which leave the linear
posterior unchanged (S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, Stat. Sci. 28, 2013, 424): their
acceptance depends on that ratio alone, in any number of dimensions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.numerics.weights import effective_size, pareto_k, resample

DRAWS = 300
KEPT = 0.5
"""Smallest effective share of the draws after a rise in temperature (conventional)."""
FEW = 0.15
"""Smallest effective share of the first draws for which more draws cost less than moves (conventional)."""
MARGIN = 1.2
"""Factor on the number of draws that the first ones suggest is enough."""
HEAVY = 0.7
"""Shape of the weights' tail beyond which the weights are not relied on (Vehtari et al., 2024)."""
MOVES, LAST = 2, 5
"""Moves of every draw at each temperature, and at the last; none where the first draws already suffice (`KEPT`)."""
FIRST_STEP, LEAST_STEP = 0.5, 0.02
WANTED = 0.35
"""Acceptance that the step is adapted to."""
MOST_TEMPERATURES = 30
LEAST_RISE = 1e-6
MOVED = 0.05
"""Acceptance at the last temperature below which the draws are not trusted."""


@dataclass(frozen=True)
class Sampled:
    """Draws of the posterior of the motions themselves.

    Attributes
    ----------
    draws : ndarray, shape (n, K)
        u = (scores, log g, h), with equal weights.
    log_ratios : ndarray, shape (n,)
        Log of their likelihood over the linear model's.
    log_evidence, stderr : float
        In nats, with its standard error.
    temperatures : int
        Number of temperatures.
    acceptance : float
        Of the last moves.
    """

    draws: np.ndarray
    log_ratios: np.ndarray
    log_evidence: float
    stderr: float
    temperatures: int
    acceptance: float

    @property
    def trusted(self) -> bool:
        """Whether enough of the last moves were accepted for the draws to have left the linear model's."""
        return self.acceptance >= MOVED


class Proposal(Protocol):
    """A posterior from which draws are taken and that random steps leave unchanged."""

    @property
    def log_evidence(self) -> float:
        """In nats."""
        ...

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw (count, K), and return each draw's combination of hyperparameters too, (count,)."""
        ...

    def moved(self, u: np.ndarray, combos: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
        """Return draws (n, K) after a random step of a size up to 1 within their combinations (n,)."""
        ...

    def inside(self, u: np.ndarray) -> np.ndarray:
        """Return which draws (n, K) have no negative score that must be positive, (n,)."""
        ...


def sample_posterior(
    ratio: Callable[[np.ndarray], np.ndarray],
    start: Proposal,
    *,
    draws: int = DRAWS,
    seed: int = 0,
) -> Sampled:
    """Draw from the posterior that is `ratio` times the linear one, and compute its evidence.

    Parameters
    ----------
    ratio : callable
        Log of the likelihood over the linear model's, of draws (n, K): (n,), −∞ where a motion escapes.
    start : Proposal
        The linear posterior.
    draws, seed : int
        Number of draws, and the seed of their random stream.
    """
    rng = np.random.default_rng(seed)
    u, combos = start.draws(draws, rng)
    ratios = ratio(u)
    if not np.any(np.isfinite(ratios)):
        return Sampled(u, ratios, -np.inf, float("nan"), 0, 0.0)
    direct = _in_one_step(rng, u, ratios, start, ratio)
    if direct is not None:
        return direct
    beta, step, log_evidence, variance, temperatures, acceptance = 0.0, FIRST_STEP, 0.0, 0.0, 0, 1.0
    while beta < 1.0 and temperatures < MOST_TEMPERATURES:
        rise = _rise(ratios, 1.0 - beta)
        logs = rise * np.maximum(ratios, -1e300)
        log_evidence += float(np.logaddexp.reduce(logs)) - np.log(draws)
        weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
        variance += float(np.sum(weights**2)) - 1.0 / draws
        beta, temperatures = beta + rise, temperatures + 1
        rows = resample(logs, draws, rng)
        combos, u, ratios = combos[rows], u[rows], ratios[rows]
        for _ in range(LAST if beta >= 1.0 else MOVES):
            new = start.moved(u, combos, step, rng)
            inside = start.inside(new)
            new_ratios = np.full(draws, -np.inf)
            if inside.any():
                new_ratios[inside] = ratio(new[inside])
            gain = beta * (new_ratios - np.where(np.isfinite(ratios), ratios, -1e300))
            accepted = np.log(rng.random(draws)) < gain
            u[accepted], ratios[accepted] = new[accepted], new_ratios[accepted]
            acceptance = float(np.mean(accepted))
            step = float(np.clip(step * np.exp(acceptance - WANTED), LEAST_STEP, 1.0))
    acceptance = acceptance if beta >= 1.0 else 0.0
    log_evidence += start.log_evidence
    return Sampled(u, ratios, log_evidence, float(np.sqrt(max(variance, 0.0))), temperatures, acceptance)


def _in_one_step(
    rng: np.random.Generator,
    u: np.ndarray,
    ratios: np.ndarray,
    start: Proposal,
    ratio: Callable[[np.ndarray], np.ndarray],
) -> Sampled | None:
    """Weight draws of the linear posterior, with as many more as make them effectively `KEPT` of those asked for.

    None where too many more are needed, or where a few draws have nearly all of the weight.
    """
    draws, share = len(u), _effective_share(ratios, 1.0)
    if share < FEW:
        return None
    if share < KEPT:
        more = start.draws(int(np.ceil(draws * (MARGIN * KEPT / share - 1.0))), rng)[0]
        u, ratios = np.concatenate([u, more]), np.concatenate([ratios, ratio(more)])
        if _effective_share(ratios, 1.0) * ratios.size < KEPT * draws or pareto_k(ratios) > HEAVY:
            return None
    logs = np.maximum(ratios, -1e300)
    weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
    error = float(np.sqrt(max(np.sum(weights**2) - 1.0 / ratios.size, 0.0)))
    evidence = start.log_evidence + float(np.logaddexp.reduce(logs)) - float(np.log(ratios.size))
    rows = resample(logs, draws, rng)
    return Sampled(u[rows], ratios[rows], evidence, error, 1, 1.0)


def _rise(ratios: np.ndarray, most: float) -> float:
    """Return the rise of β, `most` at most, after which the draws are still effectively `KEPT` of their number."""

    def excess(rise: float) -> float:
        return _effective_share(ratios, rise) - KEPT

    if excess(most) >= 0:
        return most
    if excess(LEAST_RISE) < 0:  # motions that escape have no weight at any temperature
        return LEAST_RISE
    return float(scipy.optimize.brentq(excess, LEAST_RISE, most, xtol=LEAST_RISE))  # type: ignore[arg-type]


def _effective_share(ratios: np.ndarray, rise: float) -> float:
    """Return the effective share of the draws after a rise of β (Kong 1992)."""
    return effective_size(rise * np.maximum(ratios, -1e300)) / ratios.size
