"""Build a `Posterior` from draws of an approximation of it, and judge the approximation by importance weights."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.diagnostics import summarise
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Settings
from bayesdamp.numerics.weights import K_LIMIT, effective_size, normalise, pareto_k
from bayesdamp.types import OK, Posterior

MEAN_LIMIT, SD_LIMIT = 0.3, 1.25
"""An approximation is called poor if its importance weights change a parameter's mean by more than `MEAN_LIMIT`
standard deviations, or its standard deviation by more than the factor `SD_LIMIT` (conventional)."""


def approximate_posterior(
    sampler: str,
    target: Target,
    mode: Mode,
    z: np.ndarray,
    log_density: np.ndarray,
    settings: Settings,
    more: Mapping[str, object] | None = None,
) -> Posterior:
    """Return the posterior from independent draws of an approximation, which are not reweighted.

    The effective sample sizes of all summaries are that of the importance weights. The outcome is not "ok" if the
    approximation is poor: a large Pareto shape of the weights, or weights that change a mean or standard deviation too
    much.

    Parameters
    ----------
    sampler : str
        Name of the sampler, which the result contains.
    target : Target
        The model with its record and priors.
    mode : Mode
        Mode of the posterior.
    z : ndarray, shape (chains · draws, d)
        Draws of the approximation, as standard normal scores.
    log_density : ndarray, shape (chains · draws,)
        Log density of the approximation at z, up to a constant.
    settings : Settings
        Numbers of chains and draws, into which the draws are divided.
    more : mapping, optional
        Further entries of the diagnostics.

    Returns
    -------
    Posterior
        The draws of the parameters, with their log weights (`log_weight`) among the statistics.
    """
    likelihood, prior = mode.likelihood.log_likelihoods(z), mode.likelihood.log_prior(z)
    weights = np.where(np.isfinite(likelihood), likelihood + prior, -np.inf) - log_density
    shape = pareto_k(weights)
    size = effective_size(weights)
    grid = (settings.chains, settings.draws)
    values = {n: v.reshape(grid) for n, v in target.values(z).items()}
    outcome = OK
    if not shape < K_LIMIT:
        poor = f"Pareto shape of its importance weights is {shape:.2f}, above {K_LIMIT}"
        outcome = f"a poor approximation: {poor} ({size:.0f} effective of {weights.size} draws)"
    elif change := _large_change(values, normalise(weights)):
        outcome = f"a poor approximation: {change}"
    return Posterior(
        sampler=sampler,
        names=target.names,
        draws=np.stack(list(values.values()), axis=-1),
        log_likelihood=likelihood.reshape(grid),
        stats={"log_weight": weights.reshape(grid)},
        diagnostics={"pareto_k": shape, **(more or {})},
        outcome=outcome,
        summaries={n: summarise(v, effective=size) for n, v in values.items()},
        divergences=0,
        evaluations=weights.size,
        effective=size,
    )


def _large_change(values: Mapping[str, np.ndarray], weights: np.ndarray) -> str:
    """Return a clause on the first parameter whose mean or sd the importance weights change too much; "" if none.

    values: n draws of each parameter, by name. weights: normalised importance weights of the draws, (n,). The limits
    are `MEAN_LIMIT` and `SD_LIMIT`. The clause can follow a colon.
    """
    for name, draws in values.items():
        x = draws.reshape(-1)
        mean = float(weights @ x)
        sd = float(np.sqrt(weights @ (x - mean) ** 2))
        if abs(mean - x.mean()) > MEAN_LIMIT * sd:
            away = abs(mean - float(x.mean())) / sd
            return f"according to its importance weights, the mean of {name} is wrong by {away:.1f} sd"
        if not 1 / SD_LIMIT < x.std() / sd < SD_LIMIT:
            return (
                f"according to its importance weights, the sd of {name} is {sd / x.std():.2f} times as large"
            )
    return ""
