"""Convergence of Markov chains: rank-normalised split R̂, and effective sample sizes of bulk, tails and mean.

Source: Vehtari, Gelman, Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R̂ for
assessing convergence of MCMC", Bayesian Analysis 16 (2021), the formulas in brackets. ArviZ computes the same numbers,
but takes half a second to import (xarray, pandas), in every process.

Draws are of shape (chain, draw). With fewer than four draws a chain, or where one is not finite, a result is nan.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.special import ndtri

FEWEST = 4
"""Draws of a chain; conventional."""


def rhat(draws: np.ndarray) -> float:
    """The larger of the rank-normalised split R̂ of the draws (bulk) and of their distances from the median (tails)
    (section 4.1); nan for a single chain."""
    if not _usable(draws) or draws.shape[0] < 2:
        return float("nan")
    halves = _split(draws)
    return max(_rhat(_normalised(halves)), _rhat(_normalised(np.abs(halves - np.median(halves)))))


def ess_bulk(draws: np.ndarray) -> float:
    """Effective sample size of the rank-normalised draws (section 4.2)."""
    return _ess(_normalised(_split(draws))) if _usable(draws) else float("nan")


def ess_tail(draws: np.ndarray, levels: Sequence[float] = (0.05, 0.95)) -> float:
    """The smallest effective sample size of the quantiles at these levels (section 4.3)."""
    if not _usable(draws):
        return float("nan")
    return min(_ess(_split(draws <= np.quantile(draws, level)).astype(float)) for level in levels)


def effective_mean(draws: np.ndarray) -> float:
    """Effective sample size for the mean: of the draws as they are (section 3.2)."""
    return _ess(_split(draws)) if _usable(draws) else float("nan")


def monte_carlo_error(draws: np.ndarray) -> float:
    """Monte Carlo standard error of the mean."""
    return float(np.std(draws, ddof=1) / np.sqrt(effective_mean(draws)))


def _usable(draws: np.ndarray) -> bool:
    return draws.shape[1] >= FEWEST and bool(np.all(np.isfinite(draws)))


def _split(draws: np.ndarray) -> np.ndarray:
    """Each chain's first and last half as chains; of an odd number of draws the middle one is left out."""
    half = draws.shape[1] // 2
    return np.vstack((draws[:, :half], draws[:, -half:]))


def _normalised(draws: np.ndarray) -> np.ndarray:
    """Normal scores of the ranks among all draws, ties averaged, with Blom's offset (14)."""
    _, which, ties = np.unique(draws, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(ties) - (ties - 1) / 2)[which].reshape(draws.shape)
    return ndtri((ranks - 3 / 8) / (draws.size + 1 / 4))


def _rhat(chains: np.ndarray) -> float:
    """Potential scale reduction (1) to (4)."""
    n = chains.shape[1]
    between = n * np.var(np.mean(chains, axis=1), ddof=1)
    within = np.mean(np.var(chains, axis=1, ddof=1))
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # chains that stand still: inf, or nan where all are alike
        return float(np.sqrt((between / within + n - 1) / n))


def _ess(chains: np.ndarray) -> float:
    """Effective sample size by Geyer's initial monotone positive sequence of autocorrelations (10) to (13)."""
    if np.ptp(chains) < np.finfo(float).resolution:
        return float(chains.size)
    count, n = chains.shape
    size, away = next_fast_len(2 * n, real=True), chains - np.mean(chains, axis=1, keepdims=True)
    power = np.abs(np.asarray(rfft(away, size, axis=1))) ** 2
    covariance = np.mean(np.asarray(irfft(power, size, axis=1))[:, :n] / n, axis=0)
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (np.var(np.mean(chains, axis=1), ddof=1) if count > 1 else 0.0)
    rho = 1.0 - (within - covariance) / total
    rho[0] = 1.0
    pairs = rho[0 : n - 1 : 2] + rho[1:n:2]
    # The first pair that is not positive, or the last that lags allow (as in Stan).
    ends = ~(pairs > 0) | (np.arange(pairs.size) >= (n - 3) // 2)
    last = int(np.argmax(ends))
    left = rho[2 * last] if pairs[last] >= 0 or rho[2 * last] > 0 else 0.0
    time = -1.0 + 2.0 * np.sum(np.minimum.accumulate(pairs[:last])) + left
    return float(chains.size / max(time, 1.0 / np.log10(chains.size)))
