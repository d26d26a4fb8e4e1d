"""The sensitivity of the evidence to the widths of the priors of damping coefficients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.evidence.importance import Importance
from bayesdamp.inference.mode import Mode, mode_near
from bayesdamp.numerics.weights import K_LIMIT, effective_size, pareto_k
from bayesdamp.priors import HalfNormal, LogNormal, Prior
from bayesdamp.types import OK, Refusal

PRIOR_FACTORS = np.geomspace(0.1, 10.0, 9)
"""Factors by which the scales of the priors of damping coefficients are multiplied: two decades."""
LEAST_EFFECTIVE = 400.0
"""The evidence under a scaled prior is computed from the draws under the original prior, reweighted, if their effective
number is at least this and the Pareto shape of their weights is small; otherwise from new draws (conventional)."""


@dataclass(frozen=True)
class Widths:
    """Log evidence with the scales of the damping priors multiplied by each of m factors; arrays have the shape (m,).

    Attributes
    ----------
    varied : tuple of str
        Coefficients whose priors are scaled; () if no prior can be scaled, and the values are then all equal.
    factors, log_evidence, stderr : ndarray
        The factors, and for each of them the log evidence and its standard error in nats.
    effective : ndarray
        Effective number of the original importance draws, reweighted for the scaled priors.
    anew : ndarray of bool
        Whether the evidence is from new importance draws instead of the reweighted ones.
    trusted : ndarray of bool
        Whether the importance weights are reliable. False also where no mode was found; log evidence and standard error
        are then nan.
    """

    varied: tuple[str, ...]
    factors: np.ndarray
    log_evidence: np.ndarray
    stderr: np.ndarray
    effective: np.ndarray
    anew: np.ndarray
    trusted: np.ndarray


def scale_prior(prior: Prior, factor: float) -> Prior | None:
    """Return a copy of a prior that is wider by a factor; None unless it is half-normal or lognormal.

    The factor, which may be below 1, multiplies the scale of a half-normal prior, and sigma of a lognormal prior. The
    result is also None for `SharedHalfNormal`, whose scale is unknown.
    """
    if isinstance(prior, HalfNormal):
        return HalfNormal(scale=prior.scale * factor)
    if isinstance(prior, LogNormal):
        return LogNormal(median=prior.median, sigma=prior.sigma * factor)
    return None


def evidence_by_prior_width(
    priors: Mapping[str, Prior],
    coefficients: Sequence[str],
    y: np.ndarray,
    log_weights: np.ndarray,
    fit_under: Callable[[Mapping[str, Prior]], Mode],
    seed: int,
) -> Widths:
    """Compute the evidence with the priors of all damping coefficients scaled by each of `PRIOR_FACTORS`.

    The given draws are reweighted by the ratio of the prior densities, which needs no new likelihoods. If too few of
    them have weight (`LEAST_EFFECTIVE`), or the Pareto shape of the weights is large, new draws are made under the
    scaled priors. Only half-normal and lognormal priors are scaled; if there are none, every factor has the evidence of
    the given draws.

    Parameters
    ----------
    priors : mapping of str to Prior
        Priors of all inferred parameters.
    coefficients : sequence of str
        Names of the damping coefficients.
    y : ndarray, shape (n, d)
        Importance draws of the parameters as standard normal scores, in the order of `priors`.
    log_weights : ndarray, shape (n,)
        Log importance weights of the draws under the given priors.
    fit_under : callable
        Function that returns the mode under given other priors, or raises Refusal if there is none.
    seed : int
        Seed of new draws.

    Returns
    -------
    Widths
        The log evidence for each factor.
    """
    varied = tuple(n for n in coefficients if scale_prior(priors[n], 2.0) is not None)
    values = {n: np.asarray(p.value(y[:, i])) for i, (n, p) in enumerate(priors.items()) if n in varied}

    def evidence_at(factor: float, seed: int) -> tuple[float, float, float, bool, bool]:
        """Compute the log evidence for one factor of the prior scales.

        Returns the values of log_evidence, stderr, effective, anew and trusted in `Widths`, in this order.
        """
        others = {n: p for n in varied if (p := scale_prior(priors[n], factor)) is not None}
        weights = log_weights.copy()
        for name, other in others.items():
            weights += np.asarray(other.log_density(values[name]) - priors[name].log_density(values[name]))
        log_evidence = float(scipy.special.logsumexp(weights) - np.log(weights.size))
        w = np.exp(weights - log_evidence)
        size = effective_size(weights)
        if size >= LEAST_EFFECTIVE and pareto_k(weights) < K_LIMIT:
            return log_evidence, float(np.std(w, ddof=1) / np.sqrt(w.size)), size, False, True
        try:
            mode = fit_under({**priors, **others})
            evidence = Importance().evidence("", mode.likelihood.target, mode, seed)
        except Refusal:
            return np.nan, np.nan, size, True, False
        return evidence.log_evidence, evidence.stderr, size, True, evidence.outcome == OK

    rows = [evidence_at(factor, seed + i) for i, factor in enumerate(PRIOR_FACTORS if varied else (1.0,))]
    rows *= 1 if varied else PRIOR_FACTORS.size
    return Widths(varied, PRIOR_FACTORS, *(np.array(column) for column in zip(*rows, strict=True)))


def under_priors(mode: Mode, priors: Mapping[str, Prior]) -> Mode:
    """Return the mode of the same model and record under other priors of the same parameters.

    The model must have exact laws (no deviations). Raises Refusal if the posterior is not finite at its mode.
    """
    target = mode.likelihood.target
    values = target.all_values(mode.z)
    start = np.array([float(p.score(values[n])) for n, p in priors.items()])
    return mode_near(replace(mode.likelihood, target=replace(target, priors=priors)), mode, start)
