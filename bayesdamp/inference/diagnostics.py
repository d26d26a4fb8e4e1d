"""Summaries, convergence diagnostics and ArviZ files of posterior draws.

The diagnostics are the rank-normalised split R̂ and effective sample sizes of bulk, tails and mean (Vehtari, Gelman,
Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R̂ for assessing convergence of
MCMC", Bayesian Analysis 16 (2021); numbers in brackets are those of its formulas). ArviZ computes the same numbers, but
its import takes half a second in each process. Draws have the shape (chain, draw). A result is nan if a chain has fewer
than four draws or a draw is not finite.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from contextlib import nullcontext

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.types import OK, Posterior

LEAST_DRAWS = 4
"""Least number of draws in a chain for which diagnostics are computed; with fewer they are nan (conventional)."""
RHAT_LIMIT = 1.01
ESS_LIMIT = 400.0
"""RHAT_LIMIT is the largest R̂, and ESS_LIMIT the smallest effective sample size, of reliable draws (recommended by
Vehtari et al.)."""


def rhat(draws: np.ndarray) -> float:
    """Return the rank-normalised split R̂ of draws, (chain, draw) (section 4.1); nan for a single chain.

    It is the larger of two values: that of the draws (bulk) and that of their distances from the median (tails).
    """
    if not _usable(draws) or draws.shape[0] < 2:
        return float("nan")
    halves = _split(draws)
    return max(_rhat(_normalised(halves)), _rhat(_normalised(np.abs(halves - np.median(halves)))))


def ess_bulk(draws: np.ndarray) -> float:
    """Return the effective sample size of the rank-normalised draws, (chain, draw) (section 4.2)."""
    return _ess(_normalised(_split(draws))) if _usable(draws) else float("nan")


def ess_tail(draws: np.ndarray) -> float:
    """Return the smaller effective sample size of two quantiles of draws, (chain, draw): 5 % and 95 % (section 4.3)."""
    if not _usable(draws):
        return float("nan")
    return min(_ess(_split(draws <= np.quantile(draws, level)).astype(float)) for level in (0.05, 0.95))


def effective_mean(draws: np.ndarray) -> float:
    """Return the effective sample size for the mean of draws, (chain, draw) (section 3.2)."""
    return _ess(_split(draws)) if _usable(draws) else float("nan")


def monte_carlo_error(draws: np.ndarray) -> float:
    """Return the Monte Carlo standard error of the mean of draws, (chain, draw), in their unit."""
    return float(np.std(draws, ddof=1) / np.sqrt(effective_mean(draws)))


def _usable(draws: np.ndarray) -> bool:
    """Return whether draws, (chain, draw), are at least `LEAST_DRAWS` a chain and all finite."""
    return draws.shape[1] >= LEAST_DRAWS and bool(np.all(np.isfinite(draws)))


def _split(draws: np.ndarray) -> np.ndarray:
    """Return the first and last halves of all chains as chains of their own, (2 · chain, draw / 2)."""
    half = draws.shape[1] // 2
    return np.vstack((draws[:, :half], draws[:, -half:]))


def _normalised(draws: np.ndarray) -> np.ndarray:
    """Return the normal quantiles of the ranks among all draws, (chain, draw), by formula (14).

    Ties get their mean rank.
    """
    _, which, ties = np.unique(draws, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(ties) - (ties - 1) / 2)[which].reshape(draws.shape)
    return scipy.special.ndtri((ranks - 3 / 8) / (draws.size + 1 / 4))


def _rhat(chains: np.ndarray) -> float:
    """Return the potential scale reduction factor of chains, (chain, draw), by formulas (1) to (4)."""
    n = chains.shape[1]
    between = n * np.var(np.mean(chains, axis=1), ddof=1)
    within = np.mean(np.var(chains, axis=1, ddof=1))
    with np.errstate(divide="ignore", invalid="ignore"):  # constant chains give inf, or nan if all are equal
        return float(np.sqrt((between / within + n - 1) / n))


def _ess(chains: np.ndarray) -> float:
    """Return the effective sample size of chains, (chain, draw), by formulas (10) to (13).

    The sum of autocorrelations ends as in Geyer's initial monotone positive sequence. The result is the number of draws
    of all chains if all draws are equal.
    """
    if np.ptp(chains) < np.finfo(float).resolution:
        return float(chains.size)
    count, n = chains.shape
    size, away = scipy.fft.next_fast_len(2 * n, real=True), chains - np.mean(chains, axis=1, keepdims=True)
    power = np.abs(np.asarray(scipy.fft.rfft(away, size, axis=1))) ** 2
    covariance = np.mean(np.asarray(scipy.fft.irfft(power, size, axis=1))[:, :n] / n, axis=0)
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (np.var(np.mean(chains, axis=1), ddof=1) if count > 1 else 0.0)
    rho = 1.0 - (within - covariance) / total
    rho[0] = 1.0
    pairs = rho[0 : n - 1 : 2] + rho[1:n:2]
    # The sum ends at the first pair that is not positive, or at the largest lag (as in Stan).
    ends = ~(pairs > 0) | (np.arange(pairs.size) >= (n - 3) // 2)
    last = int(np.argmax(ends))
    remainder = rho[2 * last] if pairs[last] >= 0 or rho[2 * last] > 0 else 0.0
    time = -1.0 + 2.0 * np.sum(np.minimum.accumulate(pairs[:last])) + remainder
    return float(chains.size / max(time, 1.0 / np.log10(chains.size)))


def summarise(
    draws: np.ndarray, ensembles: int | None = None, effective: float | None = None
) -> dict[str, float]:
    """Summarise one parameter's draws.

    Parameters
    ----------
    draws : ndarray, shape (chain, draw)
        Draws in natural units.
    ensembles : int, optional
        Number of independent groups of chains, if the chains of a group are not independent (emcee's walkers). R̂ then
        compares the groups.
    effective : float, optional
        Effective number of independent draws of an approximation, by their importance weights. It is used for both
        effective sample sizes; R̂ is then nan.

    Returns
    -------
    dict of str to float
        mean, sd, median, quantiles (q2.5 to q97.5), ends of the shortest 95 % interval (hdi_low, hdi_high), ess_bulk,
        ess_tail and rhat.
    """
    chains = draws
    if ensembles is not None:  # (walker, step) to (ensemble, step · walker)
        chains = draws.reshape(ensembles, -1, draws.shape[1]).swapaxes(1, 2).reshape(ensembles, -1)
    flat = draws.reshape(-1)
    quantiles = np.quantile(flat, [0.025, 0.25, 0.5, 0.75, 0.975])
    ordered = np.sort(flat)
    inside = int(0.95 * ordered.size)
    start = int(np.argmin(ordered[inside:] - ordered[: ordered.size - inside]))
    low, high = float(ordered[start]), float(ordered[start + inside])
    return {
        "mean": float(flat.mean()),
        "sd": float(flat.std(ddof=1)),
        "median": float(quantiles[2]),
        "q2.5": float(quantiles[0]),
        "q25": float(quantiles[1]),
        "q75": float(quantiles[3]),
        "q97.5": float(quantiles[4]),
        "hdi_low": low,
        "hdi_high": high,
        "ess_bulk": ess_bulk(draws) if effective is None else effective,
        "ess_tail": ess_tail(draws) if effective is None else effective,
        "rhat": rhat(chains) if effective is None else float("nan"),
    }


def verdict(summaries: Mapping[str, Mapping[str, float]]) -> str:
    """Return "ok", or a sentence on the first parameter whose draws are not reliable (`RHAT_LIMIT`, `ESS_LIMIT`).

    summaries: those of `summarise`, by parameter. A nan counts as not reliable.
    """
    for name, s in summaries.items():
        if not s["rhat"] <= RHAT_LIMIT:
            return f"not converged: R-hat of {name} is {s['rhat']:.3f}, above {RHAT_LIMIT}"
        for kind in ("bulk", "tail"):
            if not s[f"ess_{kind}"] >= ESS_LIMIT:
                size = f"{kind} effective sample size of {name} is {s[f'ess_{kind}']:.0f}"
                return f"too few draws: {size}, below {ESS_LIMIT:.0f}"
    return OK


def effective(draws: np.ndarray) -> float:
    """Return the smaller of the bulk and the tail effective sample size of draws, (chain, draw)."""
    return min(ess_bulk(draws), ess_tail(draws))


def to_netcdf(posterior: Posterior) -> bytes:
    """Return draws, log likelihood and sample statistics as the content of a netCDF file for ArviZ.

    The content is created in memory, because HDF5 crashes the process if a disk is full.
    """
    from arviz_base import from_dict

    groups = {n: posterior.draws[:, :, i] for i, n in enumerate(posterior.names)}
    data = from_dict(
        {
            "posterior": groups,
            "sample_stats": {k: np.asarray(v) for k, v in posterior.stats.items()},
            "log_likelihood": {"record": posterior.log_likelihood[:, :, None]},
        }
    )
    content = io.BytesIO()
    # On a Dask worker xarray would lock the file by its name, which a file in memory does not have.
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        data.to_netcdf(content, engine="h5netcdf")
    return content.getvalue()
