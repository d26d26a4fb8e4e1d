"""The one place that talks to ArviZ: convergence diagnostics, intervals, Pareto smoothing, files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.types import OK, Posterior

RHAT_LIMIT = 1.01
ESS_LIMIT = 400.0


TAILS = (0.05, 0.95)
"""Quantiles whose effective sample sizes are the tails'."""


def _statistics() -> Any:
    """ArviZ's statistics of arrays, which take half a second to import: only where there are draws to judge."""
    from arviz_stats.base.array import array_stats

    return array_stats


def summarise(
    draws: np.ndarray, ensembles: int | None = None, effective: float | None = None
) -> dict[str, float]:
    """Summary of one parameter's draws, shape (chain, draw).

    ensembles: number of independent groups of chains where the chains of a group share their moves (emcee's
    walkers): R̂ is then taken between groups, while the effective sample size uses each walker's own series.
    effective: for independent draws of an approximation, how many draws of the posterior they are worth by their
    importance weights. Both effective sample sizes are then this number and R̂ is nan: there are no chains.
    """
    chains = draws if ensembles is None else _grouped(draws, ensembles)
    flat = draws.reshape(-1)
    quantiles = np.quantile(flat, [0.025, 0.25, 0.5, 0.75, 0.975])
    low, high = _statistics().hdi(flat, prob=0.95)
    return {
        "mean": float(flat.mean()),
        "sd": float(flat.std(ddof=1)),
        "median": float(quantiles[2]),
        "q2.5": float(quantiles[0]),
        "q25": float(quantiles[1]),
        "q75": float(quantiles[3]),
        "q97.5": float(quantiles[4]),
        "hdi_low": float(low),
        "hdi_high": float(high),
        "ess_bulk": _bulk(draws) if effective is None else effective,
        "ess_tail": _tail(draws) if effective is None else effective,
        "rhat": float(_statistics().rhat(chains)) if effective is None else float("nan"),
    }


def _bulk(draws: np.ndarray) -> float:
    return float(_statistics().ess(draws, method="bulk"))


def _tail(draws: np.ndarray) -> float:
    return float(_statistics().ess(draws, method="tail", prob=TAILS))


def _grouped(draws: np.ndarray, ensembles: int) -> np.ndarray:
    """Draws (walker, step) as (ensemble, step · walker), in the order of time."""
    steps = draws.shape[1]
    return draws.reshape(ensembles, -1, steps).swapaxes(1, 2).reshape(ensembles, -1)


def verdict(summaries: Mapping[str, Mapping[str, float]]) -> str:
    """`ok`, or a sentence that names the first parameter whose draws are not to be trusted."""
    for name, s in summaries.items():
        if not s["rhat"] <= RHAT_LIMIT:
            return f"not converged: R-hat of {name} is {s['rhat']:.3f}, above {RHAT_LIMIT}"
        for kind in ("bulk", "tail"):
            if not s[f"ess_{kind}"] >= ESS_LIMIT:
                size = s[f"ess_{kind}"]
                what = f"{kind} effective sample size of {name}"
                return f"too few draws: {what} is {size:.0f}, below {ESS_LIMIT:.0f}"
    return OK


def effective(draws: np.ndarray) -> float:
    """The smaller of bulk and tail effective sample sizes of draws, shape (chain, draw)."""
    return min(_bulk(draws), _tail(draws))


def effective_mean(draws: np.ndarray) -> float:
    """Effective sample size for the mean of draws, shape (chain, draw)."""
    return float(_statistics().ess(draws, method="mean"))


def monte_carlo_error(draws: np.ndarray) -> float:
    """Standard error of the mean of draws, shape (chain, draw)."""
    return float(_statistics().mcse(draws, method="mean"))


NOUGHT, FEWEST = 690.0, 5
"""Nats below the largest from which a weight is none, and how many weights have a shape."""


def pareto_k(log_weights: np.ndarray) -> float:
    """Shape of the generalised Pareto fitted to the upper tail of importance weights, shape (n,); −∞ where all are
    equal, and have no tail, ∞ where all but a few are nought."""
    if np.sum(log_weights > np.max(log_weights) - NOUGHT) < FEWEST:
        return np.inf
    # Where a tail ends the smoothed weights, which are not used, overflow; of one that is nought no shape is found.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        try:
            shape = float(_statistics().psislw(-log_weights)[1])  # it takes the ratios' inverse
        except ValueError:  # all of the tail is one number
            return -np.inf
    return np.inf if np.isnan(shape) else shape


def save(posterior: Posterior, path: Path) -> None:
    """Write draws, log likelihood and sample statistics as ArviZ reads them (netCDF)."""
    from arviz_base import from_dict

    groups = {n: posterior.draws[:, :, i] for i, n in enumerate(posterior.names)}
    data = from_dict(
        {
            "posterior": groups,
            "sample_stats": {k: np.asarray(v) for k, v in posterior.stats.items()},
            "log_likelihood": {"record": posterior.log_likelihood[:, :, None]},
        }
    )
    data.to_netcdf(path, engine="h5netcdf")
