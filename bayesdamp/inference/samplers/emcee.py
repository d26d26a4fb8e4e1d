"""The affine-invariant ensemble sampler emcee: two independent ensembles, which run until there are enough draws."""

from dataclasses import replace

import emcee
import numpy as np

from bayesdamp.inference.coordinates import whitening_of
from bayesdamp.inference.diagnostics import ess_bulk, ess_tail, summarise, verdict
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Sampler, Settings, seeded_starts
from bayesdamp.numerics.orthant import ReflectedT
from bayesdamp.types import OK, Posterior

ENSEMBLES = 2
"""Number of independent ensembles of walkers; their comparison shows whether they have converged."""
STEPS_PER_BLOCK = 200
"""Number of steps of each emcee walker between checks of whether there are enough draws."""
OUTSIDE_LOG_DENSITY = -1e300
"""Log density that emcee gets outside the support of the posterior. It is finite, because emcee computes
differences."""
MOST_BLOCKS = 40
"""Greatest number of blocks of `STEPS_PER_BLOCK` steps that emcee makes. If there are still too few draws, the outcome
says so."""


class Emcee(Sampler):
    """Two independent ensembles of walkers (Goodman and Weare 2010) with a mixture of moves.

    Half of the moves are proposals from a Student t distribution about the mode, which is close to the posterior if
    this has a regular shape. The other half, differential evolution and stretch moves, are for posteriors of other
    shapes. (The snooker move of emcee is not used: up to release 3.1.6 it does not preserve the posterior. Used alone,
    it makes the sd of a normal distribution a fifth too small.)

    The ensembles, each of at least 4 · `settings.chains` walkers, run until each parameter has 1,100 effective draws
    and the chains are fifty autocorrelation times long. If these two goals are not reached after `MOST_BLOCKS` blocks
    of steps, the outcome says so. `settings.draws` has an effect only if `settings.grows` is False: each walker then
    makes just this number of steps after the warm-up, and the outcome says if the goals are missed.
    """

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws of two ensembles, whose walkers start widely scattered about the mode (`seeded_starts`).

        In the result each walker is a chain, first those of one ensemble, then those of the other. If `settings.grows`,
        long chains are thinned to between 40,000 and 80,000 draws in total; the summaries are those of all draws before
        thinning.
        """
        d, warmup = mode.z.size, settings.warmup_of(mode) // 2
        walkers = 4 * max(d + 2, 8, settings.chains)
        reflected = target.reflected
        at = whitening_of(target, mode)
        proposal = ReflectedT(at.centre, at.factor, reflected)

        # Reflected scores stay non-negative, so that walkers do not divide among mirror modes.
        def log_probability(u: np.ndarray) -> np.ndarray:
            z = at.scores(u)
            values = mode.likelihood.log_posteriors(z) + at.log_volume(u)
            inside = np.isfinite(values) & np.all((z >= -1e-9) | ~reflected, axis=1)
            return np.where(inside, values, OUTSIDE_LOG_DENSITY)

        def propose(u: np.ndarray, rng: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
            """Return a proposal for each of n walkers at u, (n, d), and the log Metropolis–Hastings factors, (n,).

            Proposals are draws from the Student t about the mode, in whitened coordinates, (n, d).
            """
            old, new = at.straight(u), proposal.draw(rng, len(u))
            moved = np.linalg.solve(at.factor, (new - at.centre).T).T
            return moved, proposal.log_density(old) - proposal.log_density(new)

        moves = [
            (emcee.moves.MHMove(propose), 0.5),
            (emcee.moves.DEMove(), 0.3),
            (emcee.moves.StretchMove(), 0.2),
        ]
        ensembles = []
        for k in range(ENSEMBLES):
            sampler = emcee.EnsembleSampler(walkers, d, log_probability, vectorize=True, moves=moves)
            sampler.random_state = np.random.RandomState((settings.seed + k) % 2**32).get_state()
            seeded = replace(settings, seed=settings.seed + 7919 * k)
            start, _ = seeded_starts(target, mode, at, walkers, seeded)
            state = sampler.run_mcmc(start, warmup)
            sampler.reset()
            ensembles.append((sampler, state))

        resolved, draws = False, np.empty((0, 0, 0))
        for block in [STEPS_PER_BLOCK] * MOST_BLOCKS if settings.grows else [settings.draws]:
            ensembles = [(s, s.run_mcmc(state, block)) for s, state in ensembles]
            draws = np.concatenate([s.get_chain().swapaxes(0, 1) for s, _ in ensembles])
            sizes = [min(ess_bulk(v), ess_tail(v)) for v in target.values(at.scores(draws)).values()]
            resolved = not any(n < 1100 or n < 50 * len(draws) for n in sizes)
            if resolved:
                break
        thin = max(1, draws.shape[0] * draws.shape[1] // 40_000) if settings.grows else 1
        log_density = np.concatenate([s.get_log_prob().T for s, _ in ensembles])[:, ::thin]
        u = draws[:, ::thin]
        z = at.scores(u)
        values, full = target.values(z), target.values(at.scores(draws))
        summaries = {n: summarise(v, ensembles=ENSEMBLES) for n, v in full.items()}
        outcome = verdict(summaries)
        if outcome == OK and not resolved:
            short = "fewer than 50 autocorrelation times or 1,100 effective draws"
            outcome = f"not resolved after {draws.shape[1]} steps: {short}"
        acceptance = np.concatenate([s.acceptance_fraction for s, _ in ensembles])[:, None]
        return Posterior(
            sampler=self.name,
            names=target.names,
            draws=np.stack(list(values.values()), axis=-1),
            log_likelihood=log_density - at.log_volume(u) - mode.likelihood.log_prior(z),
            stats={"acceptance_rate": acceptance * np.ones(z.shape[1])},
            diagnostics={"walkers": walkers, "thinned_by": thin},
            outcome=outcome,
            summaries=summaries,
            evaluations=int(ENSEMBLES * walkers * (draws.shape[1] + warmup)),
            ensembles=ENSEMBLES,
        )


PLUGIN = Emcee()
