"""Drawing from the posterior of a fit."""

from __future__ import annotations

from dataclasses import replace

from bayesdamp.inference.deviation.single import sample_motions
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.posterior import Posterior
from bayesdamp.store.contents import NO_DRAWS
from bayesdamp.types import OK, InputError, Refusal

TEMPERED = "smc"
"""The sampler where laws may hold approximately."""
EXACT_SAMPLER = "nuts"
DRAWS = 1000
"""Of each chain where nobody says how many (conventional)."""


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
    many draws from the linear model to the motions themselves; warmup has no meaning there. The others draw the
    parameters by motions that are linear in the deviations, which are integrated out, and each draw is then given its
    own; they agree with "smc" where deviations are small enough for that. kalman takes laws to hold exactly.
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
    sampler = sampler or (TEMPERED if fit.model.approximate else EXACT_SAMPLER)
    blank = Posterior(sampler, (), *NO_DRAWS, fit=fit, seed=seed, outcome=fit.outcome)
    if fit.outcome != OK:
        return blank
    law = fit.law
    try:
        if law is not None and sampler == TEMPERED:
            found = sample_motions(law, chains, draws, seed)
        else:
            plugin, (target, mode) = SAMPLERS.get(sampler), fit.engine
            settings = Settings(chains, warmup, draws, seed % 2**31, grows)
            found = plugin.summarised(target, mode, settings)
    except Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    if law is None:
        return Posterior(**vars(found), fit=fit, seed=seed)
    completed, u = law.completed(found, seed)
    return Posterior(**vars(completed), fit=fit, seed=seed, u=u)
