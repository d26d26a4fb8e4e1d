"""NUTS and emcee on the parameters of a law that holds approximately, its deviations integrated out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.deviation.sampled.marginal import Marginal, marginal_of
from bayesdamp.inference.samplers import Settings
from bayesdamp.inference.samplers._no_u_turn import Chain
from bayesdamp.types import OK

Array = NDArray[np.float64]
STEP = 0.7
"""Shorter than in `inference.samplers.nuts`: the posterior is a mixture whose core, that of exact laws, is narrower
than the whole (measured: acceptance 0.73 and 2.5 times the effective draws of 1.05, for 1.4 times the motions)."""
BLOCK, LONGEST = 100, 20
"""Steps of an ensemble after which it is looked at, and blocks after which it ends."""
ENSEMBLES = 2
RESOLVED, TIMES = 1000.0, 50.0
"""Effective draws of each parameter, and autocorrelation times, that an ensemble is run for."""
INDEPENDENT, EVOLVED, STRETCHED = 0.5, 0.3, 0.2
"""Shares of an ensemble's moves."""
NOWHERE = -1e300
"""Log density outside the support: emcee subtracts them, and infinities would not cancel."""


@dataclass(frozen=True)
class Chains:
    """u: draws, (chain, draw, K), each with a draw of its deviations; log_likelihood: of the parameters, deviations
    integrated out, (chain, draw), nats; stats by name, (chain, draw); divergences: how many transitions diverged;
    evaluations: of the likelihood; ensembles: into which chains fall that share their moves; outcome: "ok", or why the
    draws are not to be trusted."""

    u: Array
    log_likelihood: Array
    stats: dict[str, np.ndarray]
    divergences: int = 0
    evaluations: int = 0
    ensembles: int | None = None
    outcome: str = OK


@dataclass(frozen=True)
class Round:
    """Coordinates in which the linear posterior of the scores is round: z = centre + factor @ x."""

    centre: Array
    factor: Array

    @staticmethod
    def of(law: Approximate) -> Round:
        """From draws of the linear posterior, cut off at zero as they are."""
        z = law.scores[:, : law.single.result.fit.z.size]
        covariance = np.atleast_2d(np.cov(z.T))
        return Round(
            np.asarray(z.mean(axis=0), np.float64), np.asarray(np.linalg.cholesky(covariance), np.float64)
        )

    def scores(self, x: Array) -> Array:
        """Scores at coordinates, (..., d) each."""
        return np.asarray(self.centre + x @ self.factor.T)

    def whitened(self, z: Array) -> Array:
        """Coordinates of scores, (n, d) each."""
        return np.asarray(np.linalg.solve(self.factor, (z - self.centre).T).T, np.float64)

    @cached_property
    def size(self) -> int:
        """How many there are."""
        return self.centre.size


def _starts(law: Approximate, count: int, seed: int) -> Array:
    """Draws of the linear posterior, (n, d)."""
    rng = np.random.default_rng([seed, 3])
    return law.scores[rng.choice(len(law.scores), count, replace=False), : law.single.result.fit.z.size]


@dataclass(frozen=True)
class _Space:
    """The posterior in coordinates x, (d,), and the force that moves proposals: its gradient."""

    target: Marginal
    at: Round

    @property
    def walls(self) -> Array:
        """Directions of the walls, (k, d)."""
        return self.at.factor[self.target.positive]

    @property
    def offsets(self) -> Array:
        """Distances of the walls, (k,)."""
        return self.at.centre[self.target.positive]

    def height(self, x: Array) -> float:
        """Return the log density."""
        return float(self.target.log_density(self.at.scores(x)[None])[0])

    def slope(self, x: Array) -> Array:
        """Return the force, (d,)."""
        return np.asarray(self.target.gradient(self.at.scores(x)) @ self.at.factor, float)


def by_nuts(law: Approximate, asked: Settings) -> Chains:
    """Chains of the no-U-turn sampler (Hoffman and Gelman 2014), reflected where a coefficient is zero."""
    target, at = marginal_of(law.single.weighing, law.single.result), Round.of(law)
    space, warmup, seed = _Space(target, at), asked.warmup, asked.seed
    begun = at.whitened(_starts(law, asked.chains, seed))
    each = [
        Chain(space, STEP, np.random.default_rng([seed, i])).sampled(x, space.height(x), warmup + asked.draws)
        for i, x in enumerate(begun)
    ]
    x, log, diverging, steps, accepted = (np.stack([one[i][warmup:] for one in each]) for i in range(5))
    stats = {"diverging": diverging, "n_steps": steps, "acceptance_rate": accepted}
    divergences = int(diverging.sum())
    outcome = (
        f"{divergences} of {diverging.size} transitions diverged"
        if divergences > 0.01 * diverging.size
        else OK
    )
    found = _finished(target, at.scores(x), log, stats, seed)
    return replace(found, divergences=divergences, evaluations=int(steps.sum()), outcome=outcome)


def by_emcee(law: Approximate, asked: Settings) -> Chains:
    """Goodman and Weare's ensembles, two of them, until each parameter is resolved; where draws are not to be added,
    for as many steps as there are to be draws. Of walkers there are at least four times the chains."""
    import emcee

    from bayesdamp.inference.checks.diagnostics import effective
    from bayesdamp.inference.coordinates.reflected_t import ReflectedT

    target, at = marginal_of(law.single.weighing, law.single.result), Round.of(law)
    walkers, seed = max(2 * (at.size + 2), 4 * asked.chains), asked.seed
    proposal = ReflectedT(at.centre, at.factor, target.positive)

    def log_density(x: Array) -> Array:
        value = target.log_density(at.scores(x))
        return np.where(np.isfinite(value), value, NOWHERE)

    moves = [
        (emcee.moves.MHMove(_independent(proposal, at)), INDEPENDENT),
        (emcee.moves.DEMove(), EVOLVED),
        (emcee.moves.StretchMove(), STRETCHED),
    ]
    ensembles = []
    for k in range(ENSEMBLES):
        sampler = emcee.EnsembleSampler(walkers, at.size, log_density, vectorize=True, moves=moves)
        sampler.random_state = np.random.RandomState((seed + k) % 2**32).get_state()
        state = sampler.run_mcmc(at.whitened(_starts(law, walkers, seed + k)), min(asked.warmup, BLOCK))
        sampler.reset()
        ensembles.append((sampler, state))
    resolved, x = False, np.empty((0, 0, at.size))
    for block in [BLOCK] * LONGEST if asked.grows else [asked.draws]:
        ensembles = [(s, s.run_mcmc(state, block)) for s, state in ensembles]
        x = np.concatenate([s.get_chain().swapaxes(0, 1) for s, _ in ensembles])
        total, length = x.shape[0] * x.shape[1], x.shape[1]
        worth = min(effective(x[..., i]) for i in range(at.size))
        if worth >= RESOLVED and length * worth >= TIMES * total:
            resolved = True
            break
    wanted = max(1, asked.draws * asked.chains // (ENSEMBLES * walkers)) if asked.grows else asked.draws
    kept = slice(None, None, max(1, x.shape[1] // wanted))
    log = np.concatenate([s.get_log_prob().T for s, _ in ensembles])
    accepted = np.concatenate([s.acceptance_fraction for s, _ in ensembles])
    thinned = x[:, kept]
    stats = {"acceptance_rate": np.repeat(accepted[:, None], thinned.shape[1], axis=1)}
    found = _finished(target, at.scores(thinned), log[:, kept], stats, seed)
    short = (
        f"not resolved after {x.shape[1]} steps: fewer than 50 autocorrelation times or 1,000 effective draws"
    )
    outcome = OK if resolved else short
    return replace(found, ensembles=ENSEMBLES, evaluations=x.size // at.size, outcome=outcome)


def _independent(proposal, at: Round) -> Callable:
    """Proposals drawn anew about the linear posterior, with their Metropolis–Hastings factors."""

    def propose(x: Array, rng: np.random.RandomState) -> tuple[Array, Array]:
        old, new = at.scores(x), proposal.draw(rng, len(x))
        return at.whitened(new), proposal.log_density(old) - proposal.log_density(new)

    return propose


def _finished(target: Marginal, z: Array, log: Array, stats: dict[str, np.ndarray], seed: int) -> Chains:
    flat = z.reshape(-1, z.shape[-1])
    u = target.with_deviations(flat, np.random.default_rng([seed, 4]))
    likelihood = log - target.log_prior_of(flat).reshape(log.shape)
    return Chains(u.reshape(*z.shape[:2], -1), likelihood, stats)
