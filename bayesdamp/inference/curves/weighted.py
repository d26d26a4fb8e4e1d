"""Summaries of draws that have weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEVELS = {"q2.5": 0.025, "median": 0.5, "q97.5": 0.975}


def shares(log_weights: np.ndarray) -> np.ndarray:
    """Weights that sum to one from their logarithms, (n,)."""
    w = np.exp(log_weights - log_weights.max())
    return w / w.sum()


def effective(log_weights: np.ndarray) -> float:
    """How many draws of equal weight these, (n,), are worth."""
    return float(1.0 / np.sum(shares(log_weights) ** 2))


def resampled(log_weights: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Which draws, (count,) of them, stand for all by their weights: systematic resampling (Kitagawa, JCGS 5, 1996)."""
    ladder = np.cumsum(shares(log_weights))
    at = (rng.uniform() + np.arange(count)) / count
    return np.minimum(np.searchsorted(ladder, at * ladder[-1], side="right"), log_weights.size - 1)


def quantiles(x: np.ndarray, weights: np.ndarray, levels: Sequence[float] | np.ndarray) -> np.ndarray:
    """Quantiles of draws x, (n,), with weights that sum to one, (n,)."""
    order = np.argsort(x)
    ladder = np.cumsum(weights[order]) - 0.5 * weights[order]
    return np.interp(np.asarray(levels, float), ladder, x[order])


def summarise(x: np.ndarray, weights: np.ndarray) -> dict[str, float]:
    """Mean, sd and central 95 % of draws x, (n,), with weights that sum to one, (n,)."""
    mean = float(weights @ x)
    ends = quantiles(x, weights, list(LEVELS.values())).tolist()
    found = dict(zip(LEVELS, ends, strict=True))
    return {"mean": mean, "sd": float(np.sqrt(weights @ (x - mean) ** 2)), **found}
