"""Sequential Monte Carlo from the posterior of a linear model to that with exact motions.

Exact motions are solutions of the equation of motion, one for each draw. The draws pass through posteriors with the
likelihoods L_linear^(1−β) L^β, where β rises from 0 to 1; L is the likelihood with exact motions, L_linear that of the
linear model (P. Del Moral, A. Doucet and A. Jasra, J. R. Stat. Soc. B 68, 2006, 411). Prior and noise are the same at
both ends, so that weights depend only on the ratio of the likelihoods. Crank–Nicolson moves leave the posterior of the
linear model unchanged (S. L. Cotter, G. O. Roberts, A. M. Stuart and D. White, Stat. Sci. 28, 2013, 424). Their
acceptance therefore depends only on this ratio too, in any number of dimensions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.numerics.weights import K_LIMIT, effective_size, pareto_k, resample

SMC_DRAWS = 300
"""Default number of draws of sequential Monte Carlo (conventional)."""
EFFECTIVE_FRACTION = 0.5
"""In each stage of sequential Monte Carlo, β, the exponent of the exact likelihood, is increased until the effective
number of draws has fallen to this fraction of their number; the draws are then resampled. Importance sampling needs at
least this fraction of the requested number of draws as effective number (conventional)."""
LEAST_EFFECTIVE = 0.15
"""Smallest effective fraction of draws for which importance sampling is used instead of sequential Monte Carlo
(conventional). The draws are of a linear model's posterior, and the fraction is for the exact posterior as their
target. From this fraction on, making more draws costs less than moving them."""
SAFETY_FACTOR = 1.2
"""If the first draws are too few for importance sampling, more are made (conventional). The total number is then this
times the number that the effective fraction of the first draws requires, so that the effective number reaches
`EFFECTIVE_FRACTION` of the requested number."""
MOVES_PER_TEMPERATURE, LAST_MOVES = 2, 5
"""Number of Crank–Nicolson moves of every draw at each value of β (conventional): `MOVES_PER_TEMPERATURE` for β < 1,
`LAST_MOVES` for β = 1. β is the exponent of the exact likelihood, which sequential Monte Carlo increases from 0 to
1."""
FIRST_STEP, LEAST_STEP = 0.5, 0.02
"""Initial and smallest size of a Crank–Nicolson move of a draw, in posterior standard deviations (conventional)."""
WANTED_ACCEPTANCE = 0.35
"""Acceptance rate of the Crank–Nicolson moves that is aimed at (conventional): after each move their step is increased
if the rate was larger, and reduced if it was smaller."""
MOST_TEMPERATURES = 30
"""Largest number of increases of β, the exponent of the exact likelihood, which starts at 0 (conventional). If β has
not reached 1 by then, the draws are not trusted."""
LEAST_RISE = 1e-6
"""Smallest increase of β, the exponent of the exact likelihood, from one distribution to the next (conventional)."""
LEAST_ACCEPTANCE = 0.05
"""Draws of sequential Monte Carlo are not trusted if fewer than this fraction of them accepted the last move
(conventional)."""


@dataclass(frozen=True)
class TemperedDraws:
    """Draws from the posterior with exact motions: the equation of motion is solved for each draw.

    β is the exponent with which the likelihood changes from that of a linear model of the motion (β = 0) to that with
    exact motions (β = 1).

    Attributes
    ----------
    draws : ndarray, shape (n, K)
        Draws with equal weights of all unknowns: standard normal scores of the parameters, then the deviations from the
        laws, g (log damping) and h (relative frequency), at knots in time, unless laws are exact. `sample_posterior`
        returns them in the coordinates of its proposal, and `sampling.sampled_result` converts them.
    log_ratios : ndarray, shape (n,)
        Log importance weight of each draw: log of (likelihood with the exact motion / likelihood under the linear
        model), plus the log ratio of the priors if the proposal has other coordinates than scores. If draws were then
        moved by `SlicedProposal.redraw_within_slice`, it is still that of the draw before this move.
    log_evidence, stderr : float
        Log evidence in nats, and its standard error; −∞ and nan if the motions of all first draws are unbounded.
    temperatures : int
        Number of increases of β; 1 after importance sampling, 0 if the motions of all first draws are unbounded.
    beta : float
        The last value of β.
    acceptance : float
        Fraction of draws that accepted the last move; 1 after importance sampling, which needs no moves.
    evaluations : int
        Number of draws whose motion was solved for the likelihood; `sampling.sampled_result` sets it.
    """

    draws: np.ndarray
    log_ratios: np.ndarray
    log_evidence: float
    stderr: float
    temperatures: int
    beta: float
    acceptance: float
    evaluations: int = 0

    @property
    def doubt(self) -> str:
        """Return why the draws may not be used, as a clause; "" if they may be used.

        β must have reached 1, and a fraction of at least `LEAST_ACCEPTANCE` must have accepted the last move.
        """
        if not self.temperatures:
            return "the motions of all first draws are unbounded"
        if self.beta < 1.0:
            return f"the exact likelihood is not reached after {self.temperatures} temperatures"
        rate = f"only {100 * self.acceptance:.0f} % of the last moves were accepted"
        return rate if self.acceptance < LEAST_ACCEPTANCE else ""


class Proposal(Protocol):
    """A distribution from which sampling starts: the posterior of a linear model, with steps that leave it unchanged.

    The K unknowns of a draw are in coordinates that the distribution chooses, such as the standard normal scores of the
    parameters and the deviations from the laws (see `LinearProposal` and `SlicedProposal`). The distribution is a
    mixture of normal distributions (components).
    """

    @property
    def log_evidence(self) -> float:
        """Log evidence of the linear model, in nats."""
        ...

    def draws(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw the unknowns from the posterior of the linear model, which is a mixture of normal distributions.

        The unknowns are the parameters and the deviations from the laws. Return the draws, (count, K), and for each
        draw the index of its component of the mixture (in `SlicedProposal` of the mixture of its slice), (count,).
        """
        ...

    def crank_nicolson_step(
        self, u: np.ndarray, combos: np.ndarray, step: float, rng: np.random.Generator
    ) -> np.ndarray:
        """Return draws, (n, K), after a random step from the draws u, (n, K), that does not change their distribution.

        The distribution is that of the proposal. combos: index of each draw's mixture component, (n,), which the step
        does not change. step: size of the step, up to 1, in posterior standard deviations. Scores of coefficients may
        become negative.
        """
        ...


def sample_posterior(
    ratio: Callable[[np.ndarray], np.ndarray], start: Proposal, *, draws: int = SMC_DRAWS, seed: int = 0
) -> TemperedDraws:
    """Draw from the posterior with exact motions, starting from that of a linear model, and compute its evidence.

    For exact motions the equation of motion is solved for each draw. The method is importance sampling if enough draws
    of `start` are effective (`LEAST_EFFECTIVE`), otherwise sequential Monte Carlo. The draws are in the coordinates of
    `start`. If the motions of all first draws are unbounded, the log evidence is −∞ and the draws are not trusted.

    Parameters
    ----------
    ratio : callable
        Function that returns the log importance weights, (n,), of draws from `start`, (n, K). Each is the log of (exact
        likelihood / likelihood of the linear model), plus the log ratio of their priors. It is −∞ where a motion is
        unbounded, or where a coefficient that must be ≥ 0 is negative.
    start : Proposal
        The posterior of the linear model.
    draws, seed : int
        Number of draws, and the seed of their random stream.
    """
    rng = np.random.default_rng(seed)
    u, combos = start.draws(draws, rng)
    ratios = ratio(u)
    if not np.any(np.isfinite(ratios)):
        return TemperedDraws(u, ratios, -np.inf, float("nan"), 0, 0.0, 0.0)
    direct = _importance_resampled(rng, u, ratios, start, ratio)
    if direct is not None:
        return direct
    beta, step, log_evidence, variance, temperatures, acceptance = 0.0, FIRST_STEP, 0.0, 0.0, 0, 1.0
    while beta < 1.0 and temperatures < MOST_TEMPERATURES:
        rise = _next_rise(ratios, 1.0 - beta)
        logs = rise * np.maximum(ratios, -1e300)
        log_evidence += float(np.logaddexp.reduce(logs)) - np.log(draws)
        weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
        variance += float(np.sum(weights**2)) - 1.0 / draws
        beta, temperatures = beta + rise, temperatures + 1
        rows = resample(logs, draws, rng)
        combos, u, ratios = combos[rows], u[rows], ratios[rows]
        for _ in range(LAST_MOVES if beta >= 1.0 else MOVES_PER_TEMPERATURE):
            new = start.crank_nicolson_step(u, combos, step, rng)
            new_ratios = ratio(new)
            gain = beta * (new_ratios - np.where(np.isfinite(ratios), ratios, -1e300))
            accepted = np.log(rng.random(draws)) < gain
            u[accepted], ratios[accepted] = new[accepted], new_ratios[accepted]
            acceptance = float(np.mean(accepted))
            step = float(np.clip(step * np.exp(acceptance - WANTED_ACCEPTANCE), LEAST_STEP, 1.0))
    log_evidence += start.log_evidence
    stderr = float(np.sqrt(max(variance, 0.0)))
    return TemperedDraws(u, ratios, log_evidence, stderr, temperatures, beta, acceptance)


def _importance_resampled(
    rng: np.random.Generator,
    u: np.ndarray,
    ratios: np.ndarray,
    start: Proposal,
    ratio: Callable[[np.ndarray], np.ndarray],
) -> TemperedDraws | None:
    """Resample draws of a linear model's posterior by their importance weights, after making more draws if needed.

    u: draws, (n, K). ratios: their log importance weights, (n,), which `ratio` computes. start: the linear model's
    posterior, from which more draws are made. The result has n draws of equal weight. Return None if too many more
    draws would be needed (`LEAST_EFFECTIVE`), or if, with more draws, still too few are effective or a few draws have
    nearly all of the weight (`K_LIMIT`).
    """
    draws, share = len(u), _effective_share(ratios, 1.0)
    if share < LEAST_EFFECTIVE:
        return None
    if share < EFFECTIVE_FRACTION:
        more = start.draws(int(np.ceil(draws * (SAFETY_FACTOR * EFFECTIVE_FRACTION / share - 1.0))), rng)[0]
        u, ratios = np.concatenate([u, more]), np.concatenate([ratios, ratio(more)])
        few = _effective_share(ratios, 1.0) * ratios.size < EFFECTIVE_FRACTION * draws
        if few or pareto_k(ratios) > K_LIMIT:
            return None
    logs = np.maximum(ratios, -1e300)
    weights = np.exp(logs - float(np.logaddexp.reduce(logs)))
    error = float(np.sqrt(max(np.sum(weights**2) - 1.0 / ratios.size, 0.0)))
    evidence = start.log_evidence + float(np.logaddexp.reduce(logs)) - float(np.log(ratios.size))
    rows = resample(logs, draws, rng)
    return TemperedDraws(u[rows], ratios[rows], evidence, error, 1, 1.0, 1.0)


def _next_rise(ratios: np.ndarray, most: float) -> float:
    """Return the increase of β that reduces the effective fraction of the draws to `EFFECTIVE_FRACTION`.

    β is the exponent of the exact likelihood (see `TemperedDraws`). The effective fraction is the effective number of
    draws divided by their number; it falls as β increases. ratios: log importance weights at β = 1, (n,); at an
    increase δ the log weights are δ times these. most: largest increase; it is returned if the fraction is still large
    enough there. The result is `LEAST_RISE` if the fraction is already too small at this increase.
    """

    def excess(rise: float) -> float:
        return _effective_share(ratios, rise) - EFFECTIVE_FRACTION

    if excess(most) >= 0:
        return most
    if excess(LEAST_RISE) < 0:  # unbounded motions have no weight at any β
        return LEAST_RISE
    return float(scipy.optimize.brentq(excess, LEAST_RISE, most, xtol=LEAST_RISE))  # type: ignore[arg-type]


def _effective_share(ratios: np.ndarray, rise: float) -> float:
    """Return the effective number of draws after an increase `rise` of β, divided by their number (Kong 1992).

    β is the exponent of the exact likelihood (see `TemperedDraws`). ratios: log importance weights of the draws at β =
    1, (n,).
    """
    return effective_size(rise * np.maximum(ratios, -1e300)) / ratios.size
