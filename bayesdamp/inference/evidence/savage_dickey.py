"""The Savage–Dickey ratio: a nested pair of models weighed by the posterior of the larger one alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.priors import HalfNormal, Prior
from bayesdamp.types import OK

FARTHEST = 5.0
"""Log Bayes factor beyond which draws say too little of the density at zero."""
DEGREE = 3
LOWER = 0.5
"""Share of the draws, the smallest, to whose density the curve is fitted: the other flank says nothing of zero."""
FAR_FROM_ZERO = 0.5
"""The smallest draw, in medians, above which nothing is known at zero."""
NODES = 400
STEPS = 100


@dataclass(frozen=True)
class Ratio:
    """Log Bayes factor of the model without a damping term to the one with it (nats), and its standard error.

    outcome: `ok`, or why it is not valid.
    """

    log_bayes_factor: float = float("nan")
    stderr: float = float("nan")
    outcome: str = OK


def savage_dickey(prior: Prior | None, draws: np.ndarray) -> Ratio:
    """Log of posterior to prior density of a coefficient at zero, on the reflected axis (Dickey, Annals of Mathematical
    Statistics 42, 1971).

    draws: of the coefficient's score, shape (chain, draw). Valid under a half-normal prior, where both models share
    all other priors, and while the result is within 5 nats: farther out no draw is near zero.
    """
    if not isinstance(prior, HalfNormal):
        return Ratio(outcome="not applicable: its prior is no half-normal")
    log_density, error = density_at_zero(draws.ravel(), diagnostics.effective_mean(draws))
    ratio = log_density - 0.5 * np.log(2.0 / np.pi)
    if not (abs(ratio) < FARTHEST and error < 1.0):
        return Ratio(ratio, error, "not applicable: beyond 5 nats, or too few draws near zero")
    return Ratio(ratio, error)


def density_at_zero(x: np.ndarray, effective: float) -> tuple[float, float]:
    """Log density at 0 of draws x ≥ 0, shape (n,), and its standard error; effective: draws they are worth.

    The density is the exponential of a cubic on [0, median], by maximum likelihood: a cut-off normal is one, and
    nothing is smoothed across zero.
    """
    top = float(np.quantile(x, LOWER))
    u = x[x <= top] / top
    if u.min() > FAR_FROM_ZERO:
        return float("nan"), float("inf")
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    basis = np.stack([nodes**k for k in range(1, DEGREE + 1)])
    wanted = np.array([np.mean(u**k) for k in range(1, DEGREE + 1)])
    c = np.zeros(DEGREE)

    def moments(c: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        height = c @ basis
        most = height.max()
        mass = weights * np.exp(height - most)
        total = mass.sum()
        mean = basis @ mass / total
        return most + np.log(total), mean, (basis * mass / total) @ basis.T - np.outer(mean, mean)

    log_total, mean, covariance = moments(c)
    for _ in range(STEPS):
        step = np.linalg.solve(covariance, wanted - mean)
        gain, size = float((wanted - mean) @ step), 1.0
        if gain < 1e-12:
            break
        # The log likelihood is concave: halve the step until it rises.
        before = wanted @ c - log_total
        while True:
            trial = moments(c + size * step)
            if wanted @ (c + size * step) - trial[0] >= before or size < 1e-6:
                break
            size *= 0.5
        c = c + size * step
        log_total, mean, covariance = trial
    # log f(0) = log share − log_total − log top; its gradient by c is −mean, c's covariance the inverse of the basis'.
    share = u.size / x.size
    variance = mean @ np.linalg.solve(covariance, mean) / (share * effective) + (1 - share) / (
        share * effective
    )
    error = float(np.sqrt(variance)) if variance > 0 else float("inf")
    return float(np.log(share) - log_total - np.log(top)), error
