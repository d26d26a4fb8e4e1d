"""From an approximation of a posterior to draws that say how good it is."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves import weighted
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Settings
from bayesdamp.types import OK, Posterior

K_LIMIT = 0.7
"""Pareto shape of the importance weights above which an approximation is called poor (Vehtari et al., JMLR 25,
2024)."""

MEAN_LIMIT, SD_LIMIT = 0.3, 1.25
"""How far importance weights may move a mean, in sds, or an sd, by a factor."""


def approximate_posterior(
    sampler: str,
    target: Target,
    mode: Mode,
    z: np.ndarray,
    log_density: np.ndarray,
    settings: Settings,
    more: Mapping[str, object] | None = None,
) -> Posterior:
    """Independent draws of an approximation as they are, and their importance weights against the posterior.

    z: scores, (chains · draws, d); log_density: the approximation's, up to a constant, (chains · draws,). What the
    weights say goes into the diagnostics: Pareto shape, and the effective number of draws, which stands for both
    effective sample sizes; the draws themselves are not reweighted. The outcome says where the shape is poor, or where
    the weights, then to be trusted, move a mean or an sd too far.
    """
    likelihood, prior = mode.likelihood.log_likelihoods(z), mode.likelihood.log_prior(z)
    weights = np.where(np.isfinite(likelihood), likelihood + prior, -np.inf) - log_density
    shape = diagnostics.pareto_k(weights)
    size = weighted.effective(weights)
    grid = (settings.chains, settings.draws)
    values = {n: v.reshape(grid) for n, v in target.values(z).items()}
    outcome = OK
    if not shape < K_LIMIT:
        said = f"Pareto shape of its importance weights is {shape:.2f}, above {K_LIMIT}"
        outcome = f"a poor approximation: {said} ({size:.0f} effective of {weights.size} draws)"
    elif moved := _moved(values, weighted.shares(weights)):
        outcome = f"a poor approximation: {moved}"
    return Posterior(
        sampler=sampler,
        names=target.names,
        draws=np.stack(list(values.values()), axis=-1),
        log_likelihood=likelihood.reshape(grid),
        stats={"log_weight": weights.reshape(grid)},
        diagnostics={"pareto_k": shape, **(more or {})},
        outcome=outcome,
        summaries={n: diagnostics.summarise(v, effective=size) for n, v in values.items()},
        divergences=0,
        evaluations=weights.size,
        effective=size,
    )


def _moved(values: Mapping[str, np.ndarray], weights: np.ndarray) -> str:
    """What the weights, (n,), say of the first parameter whose mean or sd they move too far; nothing where none."""
    for name, draws in values.items():
        x = draws.reshape(-1)
        mean = float(weights @ x)
        sd = float(np.sqrt(weights @ (x - mean) ** 2))
        if abs(mean - x.mean()) > MEAN_LIMIT * sd:
            away = abs(mean - float(x.mean())) / sd
            return f"by its importance weights the mean of {name} is {away:.1f} sds off"
        if not 1 / SD_LIMIT < x.std() / sd < SD_LIMIT:
            return f"by its importance weights the sd of {name} is {sd / x.std():.2f} times that of its draws"
    return ""
