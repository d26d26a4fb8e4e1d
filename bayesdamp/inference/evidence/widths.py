"""How the evidence changes with the width of the damping's priors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.weighted import effective
from bayesdamp.inference.evidence.methods.importance import K_LIMIT, Importance
from bayesdamp.inference.fit.mode import Mode, mode_near
from bayesdamp.priors import HalfNormal, LogNormal, Prior
from bayesdamp.types import OK, Refusal

Near = Callable[[Mapping[str, Prior]], Mode]
"""The mode under other priors. Raises Refusal where there is none."""

FACTORS = np.geomspace(0.1, 10.0, 9)
"""Factors on the prior's scale: two decades."""
ENOUGH = 400.0
"""Effective draws below which reweighting gives way to importance sampling under the prior itself."""


@dataclass(frozen=True)
class Widths:
    """Log evidence against the factor on the prior's scale, each array of shape (m,).

    effective: draws that the reweighted ones are worth; anew: where importance sampling ran under that prior instead;
    trusted: where the diagnostics are good. varied: the coefficients whose priors changed.
    """

    varied: tuple[str, ...]
    factors: np.ndarray
    log_evidence: np.ndarray
    stderr: np.ndarray
    effective: np.ndarray
    anew: np.ndarray
    trusted: np.ndarray


def widened(prior: Prior, factor: float) -> Prior | None:
    """The prior with its scale times the factor and its support as it is; None where it has no such scale, as where the
    scale is unknown and averaged over."""
    if isinstance(prior, HalfNormal):
        return HalfNormal(scale=prior.scale * factor)
    if isinstance(prior, LogNormal):
        return LogNormal(median=prior.median, sigma=prior.sigma * factor)
    return None


def against_width(
    priors: Mapping[str, Prior],
    coefficients: Sequence[str],
    y: np.ndarray,
    log_weights: np.ndarray,
    near: Near,
    seed: int,
) -> Widths:
    """Evidence under narrower and wider priors of the damping coefficients, all at once.

    y: importance draws on the reflected scores, (n, d), in the order of the priors; log_weights: their log weights
    under the prior as it is, (n,). The likelihoods of these draws do not depend on the prior: each width needs prior
    densities alone.
    """
    varied = tuple(n for n in coefficients if widened(priors[n], 2.0) is not None)
    values = {n: np.asarray(p.value(y[:, i])) for i, (n, p) in enumerate(priors.items()) if n in coefficients}

    def weighed(factor: float, seed: int) -> tuple[float, float, float, bool, bool]:
        others, weights = dict(priors), log_weights.copy()
        for name in coefficients:
            other = widened(priors[name], factor)
            if other is not None:
                weights += np.asarray(
                    other.log_density(values[name]) - priors[name].log_density(values[name])
                )
                others[name] = other
        log_evidence = float(logsumexp(weights) - np.log(weights.size))
        w = np.exp(weights - log_evidence)
        size = effective(weights)
        if size >= ENOUGH and diagnostics.pareto_k(weights) < K_LIMIT:
            return log_evidence, float(np.std(w, ddof=1) / np.sqrt(w.size)), size, False, True
        try:
            mode = near(others)
            found = Importance().evidence("", mode.likelihood.target, mode, seed)
        except Refusal:
            return np.nan, np.nan, size, True, False
        return found.log_evidence, found.stderr, size, True, found.outcome == OK

    rows = [weighed(factor, seed + i) for i, factor in enumerate(FACTORS if varied else (1.0,))]
    rows *= 1 if varied else FACTORS.size
    return Widths(varied, FACTORS, *(np.array(column) for column in zip(*rows, strict=True)))


def under_priors(mode: Mode, priors: Mapping[str, Prior]) -> Mode:
    """Return the mode under other priors of the same parameters, where laws hold exactly. Raises Refusal where there is
    none."""
    target = mode.likelihood.target
    values = target.all_values(mode.z)
    start = np.array([float(p.score(values[n])) for n, p in priors.items()])
    return mode_near(replace(mode.likelihood, target=replace(target, priors=priors)), mode, start)
