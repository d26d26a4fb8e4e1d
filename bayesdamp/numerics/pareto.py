"""The tail of importance weights: the shape of the generalised Pareto distribution that is fitted to it.

Sources: Vehtari, Simpson, Gelman, Yao, Gabry, "Pareto smoothed importance sampling", Journal of Machine Learning
Research 25 (2024); the fit is that of Zhang and Stephens, "A new and efficient estimation method for the generalized
Pareto distribution", Technometrics 51 (2009).
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

NOUGHT, FEWEST = 690.0, 5
"""Nats below the largest from which a weight is none, and how many weights have a shape."""
PRIOR_SHAPE, PRIOR_DRAWS = 0.5, 10
"""A weak prior of the shape, worth this many draws (Vehtari et al., appendix C)."""
CURVED = 3.0
"""Factor of the quartile in the grid of Zhang and Stephens."""


def pareto_k(log_weights: np.ndarray) -> float:
    """Shape of the generalised Pareto fitted to the upper tail of importance weights, shape (n,); −∞ where all are
    equal, and have no tail, ∞ where all but a few are nought."""
    if np.sum(log_weights > np.max(log_weights) - NOUGHT) < FEWEST:
        return np.inf
    n = log_weights.size
    ordered = np.sort(log_weights) - np.max(log_weights)
    size = int(3 * np.sqrt(n)) if n > 225 else n // 5
    tail = ordered[n - size :]
    if size < FEWEST or tail[-1] - tail[0] < np.finfo(float).tiny:
        return -np.inf
    # Of a tail that is nought no shape is found.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        shape = _shape(np.exp(tail) - np.exp(ordered[n - size - 1]))
    return np.inf if np.isnan(shape) else shape


def _shape(above: np.ndarray) -> float:
    """The shape of exceedances, (n,), in rising order: the profile likelihood's mean over the grid of Zhang and
    Stephens, drawn a little to the prior's."""
    n = above.size
    count = 30 + int(np.sqrt(n))
    grid = 1 - np.sqrt(count / (np.arange(1, count + 1) - 0.5))
    grid = grid / (CURVED * above[int(n / 4 + 0.5) - 1]) + 1 / above[-1]
    shapes = np.mean(np.log1p(-grid[:, None] * above), axis=1)
    profile = n * (np.log(-grid / shapes) - shapes - 1)
    weights = np.exp(profile - logsumexp(profile))
    kept = weights >= 10 * np.finfo(float).eps
    best = np.sum(grid[kept] * weights[kept]) / np.sum(weights[kept])
    shape = np.mean(np.log1p(-best * above))
    return float((n * shape + PRIOR_DRAWS * PRIOR_SHAPE) / (n + PRIOR_DRAWS))
