"""Resample weighted draws, and check whether a few of them dominate the weights.

The check is the shape k of a generalised Pareto distribution that is fitted to the largest weights (Vehtari, Simpson,
Gelman, Yao, Gabry, "Pareto smoothed importance sampling", Journal of Machine Learning Research 25 (2024)). The fit is
that of Zhang and Stephens, "A new and efficient estimation method for the generalized Pareto distribution",
Technometrics 51 (2009).
"""

from collections.abc import Sequence

import numpy as np
import scipy  # loads its modules when they are used

NEGLIGIBLE_NATS, MIN_WEIGHTS = 690.0, 5
"""`NEGLIGIBLE_NATS`: a log weight that is smaller than the largest by this much counts as a weight of zero (e^−690 is
close to the smallest float). `MIN_WEIGHTS`: smallest number of weights from which a Pareto shape is fitted
(conventional)."""
PRIOR_SHAPE, PRIOR_DRAWS = 0.5, 10
"""Weak prior of the Pareto shape k in `_fit_shape`: `PRIOR_SHAPE` is its mean, `PRIOR_DRAWS` the number of draws to
which the prior is equivalent (Vehtari et al., JMLR 25, 2024, appendix C)."""
K_LIMIT = 0.7
"""Importance weights are unreliable if their Pareto shape k is at least this (Vehtari et al., JMLR 25, 2024)."""
QUARTILE_FACTOR = 3.0
"""The constant 3 in the formula of Zhang and Stephens for the trial parameters over which `_fit_shape` averages; it
multiplies the first quartile of the data."""


def normalise(log_weights: np.ndarray) -> np.ndarray:
    """Return the weights, (n,), normalised to sum 1, from their logarithms."""
    w = np.exp(log_weights - log_weights.max())
    return w / w.sum()


def effective_size(log_weights: np.ndarray) -> float:
    """Return the effective number of draws, 1 / Σ w², from their log weights, (n,).

    The weights w are first normalised, so that their sum is 1.
    """
    return float(1.0 / np.sum(normalise(log_weights) ** 2))


def resample(log_weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return indices, (count,), of draws chosen in proportion to their weights; these draws then have equal weights.

    The method is systematic resampling (Kitagawa, JCGS 5, 1996). The indices rise, so that copies of a draw follow each
    other. log_weights: (n,).
    """
    cumulative = np.cumsum(normalise(log_weights))
    at = (rng.uniform() + np.arange(count)) / count
    return np.minimum(np.searchsorted(cumulative, at * cumulative[-1], side="right"), log_weights.size - 1)


def quantiles(x: np.ndarray, weights: np.ndarray, levels: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the quantiles, (p,), of weighted draws x, (n,), by linear interpolation between the draws.

    A quantile is never smaller than the smallest draw or larger than the largest. weights: weights of the draws, which
    sum to 1, (n,). levels: probabilities of the quantiles in [0, 1], (p,).
    """
    order = np.argsort(x)
    cumulative = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(np.asarray(levels, float), cumulative, x[order])


def pareto_k(log_weights: np.ndarray) -> float:
    """Return the Pareto shape k of importance weights; above about 0.7 a few draws dominate the weights.

    k is the shape of a generalised Pareto distribution that is fitted to the largest of n weights: to 3 √n weights, or
    n/5 if n ≤ 225. The fit includes a weak prior with the mean 0.5 (`_fit_shape`). log_weights: (n,), up to a constant.
    The result is ∞ if fewer than `MIN_WEIGHTS` weights are not negligible (`NEGLIGIBLE_NATS`), or if the fit fails.
    Otherwise it is −∞ if n < 25, because there are too few weights for a fit, or if the fitted weights are all equal.
    """
    if np.sum(log_weights > np.max(log_weights) - NEGLIGIBLE_NATS) < MIN_WEIGHTS:
        return np.inf
    n = log_weights.size
    ordered = np.sort(log_weights) - np.max(log_weights)
    size = int(3 * np.sqrt(n)) if n > 225 else n // 5
    tail = ordered[n - size :]
    if size < MIN_WEIGHTS or tail[-1] - tail[0] < np.finfo(float).tiny:
        return -np.inf
    # Overflow and NaN occur if the tail is all zeros; the shape is then taken as infinite.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        shape = _fit_shape(np.exp(tail) - np.exp(ordered[n - size - 1]))
    return np.inf if np.isnan(shape) else shape


def _fit_shape(above: np.ndarray) -> float:
    """Return the shape k of a generalised Pareto distribution, fitted to values above a threshold.

    above: the values minus the threshold, in rising order, (n,).

    The ratio of shape and scale is averaged over the trial values of Zhang and Stephens, weighted by the profile
    likelihood. The average determines an estimate of the shape. The result is the mean of this estimate and
    `PRIOR_SHAPE`, with weights n and `PRIOR_DRAWS`.
    """
    n = above.size
    count = 30 + int(np.sqrt(n))
    grid = 1 - np.sqrt(count / (np.arange(1, count + 1) - 0.5))
    grid = grid / (QUARTILE_FACTOR * above[int(n / 4 + 0.5) - 1]) + 1 / above[-1]
    shapes = np.mean(np.log1p(-grid[:, None] * above), axis=1)
    profile = n * (np.log(-grid / shapes) - shapes - 1)
    weights = np.exp(profile - scipy.special.logsumexp(profile))
    large = weights >= 10 * np.finfo(float).eps
    best = np.sum(grid[large] * weights[large]) / np.sum(weights[large])
    shape = np.mean(np.log1p(-best * above))
    return float((n * shape + PRIOR_DRAWS * PRIOR_SHAPE) / (n + PRIOR_DRAWS))
