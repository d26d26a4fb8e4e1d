"""A sum's likelihood of its rates alone, and its evidence when their prior's scale is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from bayesdamp.envelope.model.orthant import log_orthant
from bayesdamp.priors import SHARED_SCALES

LEFT_OUT = 1e-5
"""Posterior probability of all combinations of hyperparameters and scales together that are left out."""


@dataclass(frozen=True)
class Marginal:
    """Likelihood of the rates under each of c combinations of hyperparameters, all else integrated out.

    With δ the rates less those of the fit, (d,), in 1/s, the likelihood is exp(log + δᵀ slope − δᵀ information δ / 2).
    Given δ, the deviation at the knots is normal with mean `mean` + `gain` δ and covariance `covariance`.

    Attributes
    ----------
    log
        Nats, with the prior probability of the combination, (c,).
    slope
        In s, (c, d).
    information
        In s², (c, d, d).
    mean
        Of the deviation, (c, KNOTS).
    gain
        In s, (c, KNOTS, d).
    covariance
        Of the deviation, (c, KNOTS, KNOTS).
    tau
        Size of the deviation, (c,).
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    mean: np.ndarray
    gain: np.ndarray
    covariance: np.ndarray
    tau: np.ndarray


@dataclass(frozen=True)
class Weighed:
    """Evidence and rates under the m pairs of a combination and a scale of the prior that count.

    Attributes
    ----------
    log_evidence
        Nats, (m,).
    combination
        Place of the pair's combination in the marginal, (m,).
    rates, covariance
        Mean and covariance in 1/s before rates are cut off at 0, (m, d) and (m, d, d).
    """

    log_evidence: np.ndarray
    combination: np.ndarray
    rates: np.ndarray
    covariance: np.ndarray


def weigh_scales(marginal: Marginal, fit: np.ndarray, omega: float) -> Weighed:
    """Integrate the rates out under half-normal priors that share one unknown scale.

    The scale is one of `SHARED_SCALES` of the damping ratio, all equally probable.

    Parameters
    ----------
    marginal
        The likelihood.
    fit
        Rates of the fit in 1/s, (d,).
    omega
        Rate in 1/s at a damping ratio of 1.
    """
    d = fit.size
    sigma = SHARED_SCALES * omega
    # In the directions that the information is diagonal in: a prior of any scale is diagonal there too.
    gained, axes = np.linalg.eigh(marginal.information)
    gained = np.maximum(gained, 0.0)[:, None, :]
    slope = np.einsum("cij,ci->cj", axes, marginal.slope)[:, None, :]
    start = np.einsum("cij,i->cj", axes, fit)[:, None, :]
    prior = (sigma**-2.0)[:, None]
    precision = gained + prior
    log = marginal.log[:, None] + d * np.log(2.0 / sigma) - np.log(sigma.size)
    squares = slope**2 - prior * start * (2.0 * slope + gained * start)
    log = log + 0.5 * np.sum(squares / precision - np.log(precision), axis=2)
    centre = (slope + gained * start) / precision
    mean = np.einsum("cij,csj->csi", axes, centre)
    variance = np.einsum("cij,csj->csi", axes**2, 1.0 / precision)
    # The least likely positive rate bounds the probability that all are positive.
    bound = log + log_ndtr(mean / np.sqrt(variance)).min(axis=2)
    exact = np.broadcast_to((marginal.tau == 0.0)[:, None], bound.shape)
    # Of laws that hold exactly there is an answer of their own, however improbable they are.
    counts = _counting(bound) | _counting(np.where(exact, bound, -np.inf))
    combination, scale = np.nonzero(counts)
    kept = axes[combination]
    covariance = (kept / precision[combination, scale][:, None, :]) @ np.swapaxes(kept, 1, 2)
    rates = mean[combination, scale]
    found = log[combination, scale] + log_orthant(rates, covariance)
    return Weighed(found, combination, rates, covariance)


def _counting(log: np.ndarray) -> np.ndarray:
    """Which of these have all but `LEFT_OUT` of the probability, the shape of `log`."""
    order = np.argsort(-log, axis=None)
    total = np.cumsum(np.exp(log.ravel()[order] - log.max()))
    counts = np.zeros(log.size, bool)
    counts[order[: int(np.searchsorted(total, (1.0 - LEFT_OUT) * total[-1])) + 1]] = True
    return counts.reshape(log.shape)
