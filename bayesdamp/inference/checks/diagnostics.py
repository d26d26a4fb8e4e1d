"""What draws say: summaries, whether they converged, and files as ArviZ reads them."""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from contextlib import nullcontext

import numpy as np

from bayesdamp.inference.checks.convergence import (
    effective_mean,
    ess_bulk,
    ess_tail,
    monte_carlo_error,
    rhat,
)
from bayesdamp.numerics.pareto import pareto_k
from bayesdamp.types import OK, Posterior

__all__ = [
    "effective", "effective_mean", "monte_carlo_error", "pareto_k", "saved", "summarise", "verdict",
]  # fmt: skip

RHAT_LIMIT = 1.01
ESS_LIMIT = 400.0


def summarise(
    draws: np.ndarray, ensembles: int | None = None, effective: float | None = None
) -> dict[str, float]:
    """Summary of one parameter's draws, shape (chain, draw).

    ensembles: number of independent groups of chains where the chains of a group share their moves (emcee's
    walkers): R̂ is then taken between groups, while the effective sample size uses each walker's own series.
    effective: for independent draws of an approximation, how many draws of the posterior they are worth by their
    importance weights. Both effective sample sizes are then this number and R̂ is nan: there are no chains.
    """
    chains = draws
    if ensembles is not None:  # (walker, step) as (ensemble, step · walker), in the order of time
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
    return min(ess_bulk(draws), ess_tail(draws))


def saved(posterior: Posterior) -> bytes:
    """Draws, log likelihood and sample statistics as ArviZ reads them (netCDF); made in memory, for HDF5 ends the
    process where a disk is full."""
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
    # On a worker of Dask xarray takes the cluster's lock of a file by its name, and memory has none.
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        data.to_netcdf(content, engine="h5netcdf")
    return content.getvalue()
