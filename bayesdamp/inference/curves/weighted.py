"""Summaries of weighted draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEVELS = {"q2.5": 0.025, "median": 0.5, "q97.5": 0.975}


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
