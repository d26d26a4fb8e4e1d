"""Laplace's approximation in numbers: the log evidence near a mode, and the sds of the parameters."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.orthant import log_probability

NEGLIGIBLE = 15.0
"""Nats below the most probable scale from which on scales are left out: together they add less than 1e-5."""
TWO_SIDED = 1.959964
"""Standard deviations of a normal's 95 % interval."""


def log_evidence_near(likelihood: Likelihood, z: np.ndarray) -> float:
    """Return Laplace's log evidence from the expansion at scores z, (d,), at or near a mode.

    The likelihood is expanded: of a scale that coefficients share, each value has its own integral.
    """
    target, scales = likelihood.target, np.asarray(likelihood.scales)
    at = np.where(target.reflected, np.abs(z), z)
    value, gradient, information = likelihood.held(1.0).curvature(at)
    reflected, shared = np.flatnonzero(target.reflected), target.shared
    if not shared.any():
        return log_integral(value, gradient, information, at, reflected)
    count, squares = int(shared.sum()), float(np.sum(at[shared] ** 2))

    def at_scale(scale: float, walls: np.ndarray) -> float:
        extra = (scale**-2 - 1.0) * shared
        there = value - 0.5 * (scale**-2 - 1.0) * squares - count * np.log(scale)
        return log_integral(there, gradient - extra * at, information + np.diag(extra), at, walls)

    found: list[float] = []
    folded = float(reflected.size * np.log(2.0))
    for whole, scale in sorted(((at_scale(s, reflected[:0]), s) for s in scales), reverse=True):
        if found and whole + folded < max(found) - NEGLIGIBLE:
            break  # walls only take away from it
        found.append(at_scale(scale, reflected))
    return float(logsumexp(found) - np.log(scales.size))


def log_evidence_about(mode: Mode) -> float:
    """Return Laplace's log evidence about a mode: of the linear model, where laws may hold approximately."""
    return log_evidence_near(mode.likelihood, mode.z) if mode.linear is None else mode.linear.log_evidence


def log_integral(
    value: float, gradient: np.ndarray, information: np.ndarray, at: np.ndarray, reflected: np.ndarray
) -> float:
    """log ∫ exp(value + g·(z − at) − (z − at)ᵀ H (z − at)/2) dz over z ≥ 0 in the reflected scores, times two for each.

    gradient g: (d,); information H: (d, d); reflected: their indices.
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
    """Laplace sds of the parameters in natural units from the covariance of the scores, shape (d, d)."""
    sds = np.abs(target.rates(z)) * np.sqrt(np.diag(covariance))
    return dict(zip(target.names, sds.tolist(), strict=True))


def value_intervals(target: Target, z: np.ndarray, sd: np.ndarray) -> dict[str, tuple[float, float]]:
    """The 95 % interval of each parameter, by name: from the normal distribution of each score about the mode,
    none beyond a half-normal prior's edge."""
    low, high = z - TWO_SIDED * sd, z + TWO_SIDED * sd
    low = np.where(target.reflected, np.maximum(low, 0.0), low)
    ends = target.values(low), target.values(high)
    return {n: (float(ends[0][n]), float(ends[1][n])) for n in target.names}
