"""The sensitivity of the evidence to priors and data.

The evidence is computed with wider and narrower priors of the damping, for the first half of the record only, and
without one damping coefficient (by the Savage–Dickey ratio, from the posterior of the model with it).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

from bayesdamp.inference.checks import PREDICTIVE_DRAWS, Prediction
from bayesdamp.inference.diagnostics import effective_mean
from bayesdamp.inference.evidence.importance import Importance
from bayesdamp.inference.mode import Mode, mode_near
from bayesdamp.numerics.weights import K_LIMIT, effective_size, pareto_k, resample
from bayesdamp.priors import (
    SHARED_SIGMAS,
    HalfNormal,
    LogNormal,
    Prior,
    SharedHalfNormal,
    shared_log_density,
)
from bayesdamp.types import OK, Evidence, NestedRatio, Refusal

PRIOR_FACTORS = np.geomspace(0.1, 10.0, 9)
"""Factors by which the scales of the priors of damping coefficients are multiplied: two decades."""
LEAST_EFFECTIVE = 400.0
"""The evidence under a scaled prior is computed from the draws under the original prior, reweighted, if their effective
number is at least this and the Pareto shape of their weights is small; otherwise from new draws (conventional)."""
MOST_NATS = 5.0
"""If the log Bayes factor of a model without a coefficient has at least this absolute value (nats), the posterior draws
do not determine the density at zero (conventional)."""
POLYNOMIAL_DEGREE = 3
"""Degree of the polynomial that approximates the log density of a coefficient between zero and the median."""
LOWER_FRACTION = 0.5
"""The density of a coefficient at zero is estimated from a polynomial that is fitted to the smallest draws; this is the
fraction of the draws that are used."""
FAR_FROM_ZERO = 0.5
"""If the smallest draw is larger than this fraction of the median, the draws do not determine the density at zero."""
QUADRATURE_NODES = 400
"""Number of Gauss–Legendre nodes for the integral that normalises a density whose logarithm is a polynomial."""


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


def first_half(mode: Mode) -> Mode:
    """Return the mode given only the first half of the samples.

    The model must have exact laws (no deviations). Raises Refusal if the half has no more samples than there are
    parameters, or if the posterior is not finite at its mode.
    """
    target = mode.likelihood.target
    part = slice(0, target.signal.t.size // 2)
    if part.stop <= len(target.names):
        raise Refusal(
            f"half the record has {part.stop} samples for {len(target.names)} parameters, which is too few"
        )
    return mode_near(replace(mode.likelihood, part=part), mode, mode.z)


def predict_from_half(
    model: str, half: Mode, carry: Callable[[np.ndarray], Prediction], seed: int
) -> tuple[Evidence, Prediction]:
    """Compute the evidence of the first half of a record by importance sampling, and predict the second half.

    Parameters
    ----------
    model : str
        Name of the model.
    half : Mode
        Mode of the posterior given the first half.
    carry : callable
        Function that predicts the second half from draws of the scores, (m, d); it raises Refusal if no draw has a
        finite motion in the second half.
    seed : int
        Seed of the draws.

    Returns
    -------
    Evidence, Prediction
        The evidence of the first half (without its draws), and the prediction of the second half from
        `PREDICTIVE_DRAWS` of these draws, resampled by their weights.

    Raises
    ------
    Refusal
        If `carry` raises it.
    """
    evidence = Importance().evidence(model, half.likelihood.target, half, seed)
    rows = resample(evidence.arrays["log_weights"], PREDICTIVE_DRAWS, np.random.default_rng(seed))
    return replace(evidence, arrays={}), carry(evidence.arrays["y"][rows])


def log_predictive(whole: Evidence, half: Evidence) -> tuple[float, float]:
    """Return the log density of the second half of a record given the first, and its standard error, in nats.

    whole, half: evidence of the whole record and of its first half, of which this is the difference. Both results are
    nan if one of them is unreliable.
    """
    if not whole.outcome == half.outcome == OK:
        return float("nan"), float("nan")
    return whole.log_evidence - half.log_evidence, float(np.hypot(whole.stderr, half.stderr))


def savage_dickey(
    priors: Mapping[str, Prior],
    name: str,
    scores: Mapping[str, np.ndarray],
    scales: ArrayLike = SHARED_SIGMAS,
) -> NestedRatio:
    """Return the log Bayes factor of the model without a coefficient against the model with it.

    It is the log of the ratio of posterior to prior density of the coefficient at zero (Savage and Dickey), positive if
    the record favours the model without it. Coefficients with a common, unknown prior scale need a correction: given
    that one of them is zero, the prior of the others is not their prior in the smaller model. The draws are then
    weighted by the ratio of these two priors, which depends on the sum of squares of the other coefficients' scores.

    Parameters
    ----------
    priors : mapping of str to Prior
        Priors of the parameters of the larger model.
    name : str
        Name of the coefficient. Its prior must be half-normal, with a given or a common scale.
    scores : mapping of str to ndarray
        Posterior draws of the parameters of the larger model as scores, (chain, draw) each.
    scales : array_like, shape (s,)
        Possible values of the common prior scale (standard deviation of the scores), equally probable.

    Returns
    -------
    NestedRatio
        The log Bayes factor in nats and its standard error. The outcome begins with "not applicable" if the coefficient
        has another prior or no draws, or if the draws do not determine the density at zero: if the log Bayes factor is
        beyond `MOST_NATS`, or its standard error is 1 nat or more.

    References
    ----------
    Dickey, Annals of Mathematical Statistics 42, 1971; Verdinelli and Wasserman, Journal of the American Statistical
    Association 90, 1995, for other priors of the smaller model.
    """
    prior, draws = priors.get(name), scores.get(name)
    if draws is None or not isinstance(prior, HalfNormal | SharedHalfNormal):
        return NestedRatio(outcome="not applicable: the coefficient has no draws or no half-normal prior")
    log_ratios = np.full(draws.shape, -0.5 * np.log(2.0 / np.pi))
    if isinstance(prior, SharedHalfNormal):
        others = [n for n, p in priors.items() if n != name and isinstance(p, SharedHalfNormal)]
        squares = np.sum([scores[n] ** 2 for n in others], axis=0) if others else np.zeros(draws.shape)
        smaller = shared_log_density(squares, len(others), scales)
        log_ratios = smaller - shared_log_density(squares, len(others) + 1, scales)
    top = float(log_ratios.max())
    weights = np.exp(log_ratios - top)
    size = effective_mean(draws)
    log_density, error = density_at_zero(draws.ravel(), size, weights.ravel())
    ratio = log_density + top + float(np.log(weights.mean()))
    if not (abs(ratio) < MOST_NATS and error < 1.0):
        return NestedRatio(
            ratio,
            error,
            "not applicable: the log Bayes factor is beyond 5 nats, or too few draws are near zero",
        )
    return NestedRatio(ratio, error)


def density_at_zero(x: np.ndarray, effective: float, weights: np.ndarray) -> tuple[float, float]:
    """Estimate the log of the probability density of non-negative draws at zero.

    Between zero and the median the log density is a cubic polynomial, fitted by maximum likelihood. (The log density of
    a truncated normal distribution is a polynomial too.)

    Parameters
    ----------
    x : ndarray, shape (n,)
        The draws.
    effective : float
        Effective number of the draws without weights (they may be autocorrelated).
    weights : ndarray, shape (n,)
        Weights of the draws.

    Returns
    -------
    log_density, stderr : float
        The log density and its standard error; nan and infinite if no draw is near zero (`FAR_FROM_ZERO`).
    """
    top = float(np.quantile(x, LOWER_FRACTION))
    low = x <= top
    u, w = x[low] / top, weights[low]
    if u.min() > FAR_FROM_ZERO:
        return float("nan"), float("inf")
    nodes, node_weights = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
    degrees = np.arange(1, POLYNOMIAL_DEGREE + 1)[:, None]
    basis, wanted = (0.5 * (nodes + 1.0)) ** degrees, np.average(u**degrees, axis=1, weights=w)

    def moments(c: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return log ∫ exp(c·basis) over [0, 1], and the mean (k,) and covariance (k, k) of the basis.

        Mean and covariance are under the density that is proportional to exp(c·basis). c: coefficients, (k,).
        """
        log_total = float(scipy.special.logsumexp(c @ basis, b=0.5 * node_weights))
        mass = 0.5 * node_weights * np.exp(c @ basis - log_total)
        mean = basis @ mass
        return log_total, mean, (basis * mass) @ basis.T - np.outer(mean, mean)

    c = scipy.optimize.minimize(
        lambda c: moments(c)[0] - wanted @ c,
        np.zeros(POLYNOMIAL_DEGREE),
        jac=lambda c: moments(c)[1] - wanted,
        hess=lambda c: moments(c)[2],
        method="trust-exact",
        options={"gtol": 1e-7},
    ).x
    log_total, mean, covariance = moments(c)
    # log f(0) = log fraction − log_total − log top. Its gradient by c is −mean; the covariance of c is the inverse of
    # that of the basis, divided by the number of draws.
    fraction = float(w.sum() / weights.sum())
    size = fraction * effective * float(np.sum(weights) ** 2 / np.sum(weights**2) / weights.size)
    variance = mean @ np.linalg.solve(covariance, mean) / size + (1 - fraction) / size
    error = float(np.sqrt(variance)) if variance > 0 else float("inf")
    return float(np.log(fraction) - log_total - np.log(top)), error
