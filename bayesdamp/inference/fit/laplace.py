"""Laplace's approximation in numbers: the log evidence near a mode, and the sds of the parameters."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import log_probability

NEGLIGIBLE = 15.0
"""Scales this many nats less probable than the best one are left out; together they add less than 1e-5."""
TWO_SIDED = 1.959964
"""Half-width of a normal's 95 % interval, in standard deviations."""


def log_evidence_near(likelihood: Likelihood, z: np.ndarray) -> float:
    """Return Laplace's log evidence from the expansion at scores z, (d,), at or near a mode.

    The likelihood is expanded, and each value of a scale that coefficients share has its own integral.
    """
    target, scales = likelihood.target, np.asarray(likelihood.scales)
    at = np.where(target.reflected, np.abs(z), z)
    value, gradient, information = likelihood.held(1.0).curvature(at)
    reflected, shared = np.flatnonzero(target.reflected), target.shared
    if not shared.any():
        return log_integral(value, gradient, information, at, reflected)
    count, squares = int(shared.sum()), float(np.sum(at[shared] ** 2))

    def log_at_scale(scale: float, walls: np.ndarray) -> float:
        extra = (scale**-2 - 1.0) * shared
        height = value - 0.5 * (scale**-2 - 1.0) * squares - count * np.log(scale)
        return log_integral(height, gradient - extra * at, information + np.diag(extra), at, walls)

    logs: list[float] = []
    folded = float(reflected.size * np.log(2.0))
    for whole, scale in sorted(((log_at_scale(s, reflected[:0]), s) for s in scales), reverse=True):
        if logs and whole + folded < max(logs) - NEGLIGIBLE:
            break  # walls can only make an integral smaller
        logs.append(log_at_scale(scale, reflected))
    return float(logsumexp(logs) - np.log(scales.size))


def log_evidence_about(mode: Mode) -> float:
    """Return Laplace's log evidence about a mode; where laws may hold approximately, that of the linear model."""
    return log_evidence_near(mode.likelihood, mode.z) if mode.linear is None else mode.linear.log_evidence


def log_integral(
    value: float, gradient: np.ndarray, information: np.ndarray, at: np.ndarray, reflected: np.ndarray
) -> float:
    """Integrate exp(value + g·(z − at) − (z − at)ᵀ H (z − at)/2) over z ≥ 0 in the reflected scores.

    Parameters
    ----------
    value : float
        Log density at `at`.
    gradient, information : ndarray, shapes (d,) and (d, d)
        g and H.
    at : ndarray, shape (d,)
        Point of expansion.
    reflected : ndarray of int
        Indices of the reflected scores.

    Returns
    -------
    float
        Log of the integral, times two for each reflected score.
    """
    covariance = np.linalg.inv(information)
    mean = at + covariance @ gradient
    log_det = np.linalg.slogdet(information)[1]
    whole = value + 0.5 * gradient @ covariance @ gradient
    whole += 0.5 * at.size * np.log(2 * np.pi) - 0.5 * log_det
    if not reflected.size:
        return float(whole)
    inside = log_probability(mean[None, reflected], covariance[None, reflected[:, None], reflected])[0]
    return float(whole + inside + reflected.size * np.log(2.0))


def value_sds(target: Target, z: np.ndarray, covariance: np.ndarray) -> dict[str, float]:
    """Return Laplace sds of the parameters in natural units from the covariance of the scores, (d, d)."""
    sds = np.abs(target.rates(z)) * np.sqrt(np.diag(covariance))
    return dict(zip(target.names, sds.tolist(), strict=True))


def value_intervals(target: Target, z: np.ndarray, sd: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return the 95 % interval of each parameter by name, from the normal distribution of its score about the mode.

    An interval ends at the edge of a half-normal prior.
    """
    low, high = z - TWO_SIDED * sd, z + TWO_SIDED * sd
    low = np.where(target.reflected, np.maximum(low, 0.0), low)
    ends = target.values(low), target.values(high)
    return {n: (float(ends[0][n]), float(ends[1][n])) for n in target.names}
