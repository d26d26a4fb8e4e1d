"""Weighted draws: their summaries, and whether a few of them have all the weight.

The latter is shown by the shape of a generalised Pareto distribution that is fitted to the largest weights. Sources:
Vehtari, Simpson, Gelman, Yao, Gabry, "Pareto smoothed importance sampling", Journal of Machine Learning Research 25
(2024); the fit is by Zhang and Stephens, "A new and efficient estimation method for the generalized Pareto
distribution", Technometrics 51 (2009).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import logsumexp

LEVELS = {"q2.5": 0.025, "median": 0.5, "q97.5": 0.975}
NOUGHT, FEWEST = 690.0, 5
"""Nats below the largest at which a weight is zero, and fewest weights that have a shape."""
PRIOR_SHAPE, PRIOR_DRAWS = 0.5, 10
"""A weak prior of the shape, and the number of draws that it is worth (Vehtari et al., appendix C)."""
CURVED = 3.0
"""Factor of the quartile in the grid of Zhang and Stephens."""


def shares(log_weights: np.ndarray) -> np.ndarray:
    """Return weights that sum to one from their logarithms, (n,)."""
    w = np.exp(log_weights - log_weights.max())
    return w / w.sum()


def effective(log_weights: np.ndarray) -> float:
    """Return how many draws of equal weight draws with these log weights, (n,), are worth."""
    return float(1.0 / np.sum(shares(log_weights) ** 2))


def resampled(log_weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return the indices, (count,), of draws of equal weight: systematic resampling (Kitagawa, JCGS 5, 1996)."""
    ladder = np.cumsum(shares(log_weights))
    at = (rng.uniform() + np.arange(count)) / count
    return np.minimum(np.searchsorted(ladder, at * ladder[-1], side="right"), log_weights.size - 1)


def quantiles(x: np.ndarray, weights: np.ndarray, levels: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return quantiles of draws x, (n,), with weights that sum to one, (n,)."""
    order = np.argsort(x)
    ladder = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(np.asarray(levels, float), ladder, x[order])


def summarise(x: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Return mean, sd and central 95 % of draws x, (n,), with weights that sum to one, (n,)."""
    mean = float(weights @ x)
    ends = quantiles(x, weights, list(LEVELS.values())).tolist()
    sd = float(np.sqrt(weights @ (x - mean) ** 2))
    return {"mean": mean, "sd": sd, **dict(zip(LEVELS, ends, strict=True))}


def pareto_k(log_weights: np.ndarray) -> float:
    """Return the shape k of the generalised Pareto distribution of the upper tail of importance weights, (n,).

    −∞ where all are equal and there is no tail, ∞ where all but a few are zero.
    """
    if np.sum(log_weights > np.max(log_weights) - NOUGHT) < FEWEST:
        return np.inf
    n = log_weights.size
    ordered = np.sort(log_weights) - np.max(log_weights)
    size = int(3 * np.sqrt(n)) if n > 225 else n // 5
    tail = ordered[n - size :]
    if size < FEWEST or tail[-1] - tail[0] < np.finfo(float).tiny:
        return -np.inf
    # A tail of zeros has no shape.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        shape = _fit_shape(np.exp(tail) - np.exp(ordered[n - size - 1]))
    return np.inf if np.isnan(shape) else shape


def _fit_shape(above: np.ndarray) -> float:
    """Return the shape of exceedances, (n,), in rising order.

    It is the profile likelihood's mean over the grid of Zhang and Stephens, with a weak prior.
    """
    n = above.size
    count = 30 + int(np.sqrt(n))
    grid = 1 - np.sqrt(count / (np.arange(1, count + 1) - 0.5))
    grid = grid / (CURVED * above[int(n / 4 + 0.5) - 1]) + 1 / above[-1]
    shapes = np.mean(np.log1p(-grid[:, None] * above), axis=1)
    profile = n * (np.log(-grid / shapes) - shapes - 1)
    weights = np.exp(profile - logsumexp(profile))
    large = weights >= 10 * np.finfo(float).eps
    best = np.sum(grid[large] * weights[large]) / np.sum(weights[large])
    shape = np.mean(np.log1p(-best * above))
    return float((n * shape + PRIOR_DRAWS * PRIOR_SHAPE) / (n + PRIOR_DRAWS))
