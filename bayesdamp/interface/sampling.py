"""Drawing from the posterior of a fit."""

from __future__ import annotations

import time

import numpy as np

from bayesdamp.inference.approximate.chains import by_emcee, by_nuts
from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.approximate.runs import runs_of, summaries_of
from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.posterior import Posterior
from bayesdamp.types import OK, InputError, Refusal

TEMPERED = "smc"
"""The sampler where laws may hold approximately."""
EXACT_SAMPLER = "nuts"
DRAWS = 1000
"""Of each chain where nobody says how many (conventional)."""
CHAINS = {"nuts": by_nuts, "emcee": by_emcee}
"""Those that draw parameters there with the deviations integrated out."""


def sample(
    fit: Fit,
    sampler: str | None = None,
    *,
    chains: int = 4,
    warmup: int = 500,
    draws: int | None = None,
    seed: int = 0,
) -> Posterior:
    """Draw from the posterior of a fit.

    sampler: a name in `bayesdamp.inference.samplers.SAMPLERS`: nuts, by default, emcee, kalman, laplace, variational.
    chains, warmup, draws: how long; as many draws of each chain are kept as are asked for. By default they are 1,000,
    and nuts and emcee add some where these are too few. emcee's chains are walkers, of which there are more than asked
    for. Where there is no fit, or the sampler cannot work on it, the result's outcome is the sentence; it also says
    where draws are too few. Raises InputError for misuse.

    Where laws may hold approximately the sampler is "smc", by default: each chain is a run of its own that leads so
    many draws from the linear model to the motions themselves; warmup has no meaning there. "nuts" and "emcee" draw
    the parameters by motions that are linear in the deviations, which are integrated out, and each draw is then given
    its own; they agree with "smc" where deviations are small enough for that.
    """
    if not isinstance(fit, Fit):
        raise InputError(
            f"sample: the first argument is {type(fit).__name__}; it must be a Fit, as fit(signal, model) gives it"
        )
    grows, draws = draws is None, DRAWS if draws is None else draws
    for name, value, least in (
        ("chains", chains, 2),
        ("warmup", warmup, 10),
        ("draws", draws, 10),
        ("seed", seed, 0),
    ):
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise InputError(f"sample: {name} is {value!r}; it must be a whole number, {least} or more")
    approximate = fit.model.approximate
    sampler = sampler or (TEMPERED if approximate else EXACT_SAMPLER)
    if approximate and sampler not in (TEMPERED, *CHAINS):
        raise InputError(
            f"sample: {sampler!r} draws under laws that hold exactly; under deviation {fit.model.deviation!r} "
            f"it must be {', '.join((TEMPERED, *CHAINS))}"
        )
    if fit.law is not None:
        if sampler in CHAINS:
            return _by_chains(fit, fit.law, sampler, Settings(chains, warmup, draws, seed, grows))
        return _tempered(fit, fit.law, chains, draws, seed)
    if fit.outcome != OK:
        return Posterior(fit, sampler, seed=seed, outcome=fit.outcome)
    plugin = SAMPLERS.get(sampler)
    try:
        target, mode = fit.engine
        settings = Settings(chains, warmup, draws, seed % 2**31, grows)
        found = diagnostics.summarised(plugin.sample(target, mode, settings))
    except Refusal as refusal:
        return Posterior(fit, sampler, seed=seed, outcome=str(refusal))
    return Posterior(
        fit=fit,
        sampler=sampler,
        names=found.names,
        draws=found.draws,
        log_likelihood=found.log_likelihood,
        stats=found.stats,
        diagnostics=found.diagnostics,
        seed=seed,
        seconds=found.seconds,
        outcome=found.outcome,
        summaries=found.summary,
        starts=found.starts,
        divergences=found.divergences,
        evaluations=found.evaluations,
        ensembles=found.ensembles,
        effective=found.effective,
    )


def _by_chains(fit: Fit, law: Approximate, sampler: str, asked: Settings) -> Posterior:
    began = time.perf_counter()
    try:
        found = CHAINS[sampler](law, asked)
    except Refusal as refusal:
        return Posterior(fit, sampler, seed=asked.seed, outcome=str(refusal))
    values = law.values(found.u)
    summary = summaries_of(law, values, found.ensembles)
    outcome = diagnostics.verdict(summary) if found.outcome == OK else found.outcome
    return Posterior(
        fit=fit,
        sampler=sampler,
        names=law.names,
        draws=values,
        log_likelihood=found.log_likelihood,
        stats=found.stats,
        summaries=summary,
        divergences=found.divergences,
        evaluations=found.evaluations,
        ensembles=found.ensembles,
        seed=asked.seed,
        seconds=time.perf_counter() - began,
        outcome=outcome,
        u=found.u,
    )


def _tempered(fit: Fit, law: Approximate, chains: int, draws: int, seed: int) -> Posterior:
    runs = runs_of(law, chains, draws, seed)
    values = law.values(runs.u)
    summary = summaries_of(law, values)
    log_evidence, stderr = runs.log_evidence
    own = {
        "acceptance_rate": np.repeat([[r.acceptance] for r in runs.each], draws, axis=1),
        "temperatures": np.repeat([[r.temperatures] for r in runs.each], draws, axis=1),
    }
    outcome = runs.outcome
    return Posterior(
        fit=fit,
        sampler=TEMPERED,
        names=law.names,
        draws=values,
        log_likelihood=runs.log_likelihood,
        stats=own,
        summaries=summary,
        log_evidence=log_evidence,
        stderr=stderr,
        seed=seed,
        seconds=runs.seconds,
        outcome=diagnostics.verdict(summary) if outcome == OK else outcome,
        u=runs.u,
    )
