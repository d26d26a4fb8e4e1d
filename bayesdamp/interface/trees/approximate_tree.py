"""Draws under a deviation as ArviZ reads them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.interface.parts.definitions import definition
from bayesdamp.interface.trees.tree import CELLS, RECORD, Drawn, in_order, origin_of

DAMPING, FREQUENCY = "damping_deviation", "frequency_deviation"
"""The deviations along the record, and with `_size` their sizes over it."""


def approximate_tree(post: Drawn, approximate: Approximate) -> xr.DataTree:
    """The groups of `Posterior.data`; along the record are the samples that the fit read, neighbours averaged where
    they are closer than it needs."""
    chains, count, total = post.u.shape
    every = max(1, -(-chains * count * approximate.single.weighing.data.t.size // CELLS))
    numbers = np.arange(0, count, every)
    u = post.u[:, numbers]
    motions = approximate.motions(u.reshape(-1, total)).reshape(chains, numbers.size, -1)
    sd = np.sqrt(approximate.single.weighing.variance)
    noise = sd * np.random.default_rng([post.seed, 2]).standard_normal(motions.shape)
    along = {"chain": np.arange(chains), "draw": numbers}
    unit, dims = post.fit.signal.y_unit, ("chain", "draw", "time")
    pointwise = "log density of each sample; they sum to the log likelihood"
    seen = {"units": unit, "definition": "the record as it was fitted"}
    groups = {
        "posterior": _drawn(post, approximate, post.u),
        "prior": _drawn(post, approximate, approximate.prior_draws(count, post.seed)[None]),
        "posterior_predictive": _along(
            approximate,
            (dims, motions + noise, {"units": unit, "definition": "motion of a draw with noise of its own"}),
            along,
        ),
        "log_likelihood": _along(
            approximate,
            (dims, approximate.log_likelihoods(motions), {"units": "nat", "definition": pointwise}),
            along,
        ),
        "sample_stats": _stats(post),
        "observed_data": _along(approximate, (("time",), approximate.single.weighing.data.y, seen)),
        "constant_data": _constant(post, approximate),
    }
    tree = xr.DataTree.from_dict(in_order(groups))
    tree.attrs |= origin_of(post)
    return tree


def _drawn(post: Drawn, approximate: Approximate, u: np.ndarray) -> xr.Dataset:
    """Parameters, deviations at the knots and their sizes, of u (chain, draw, K)."""
    chains, count, total = u.shape
    values = approximate.values(u)
    flat = u.reshape(-1, total)
    g, h = (x.reshape(chains, count, -1) for x in approximate.deviations(flat))
    sizes = [x.reshape(chains, count) for x in approximate.sizes(flat)]
    dims, knots = ("chain", "draw"), ("chain", "draw", "knot")
    variables: dict[str, Any] = {
        n: (dims, values[..., i], _attributes(post, approximate, n)) for i, n in enumerate(approximate.names)
    }
    share = {"units": "1", "prior": "Gaussian process, 0 with probability 0.8"}
    what = {
        DAMPING: (np.expm1(g), "relative deviation of the damping from its law"),
        FREQUENCY: (h, "relative deviation of the frequency from its law"),
    }
    for (name, (values_of, said)), size in zip(what.items(), sizes, strict=True):
        variables[name] = (knots, values_of, {**share, "definition": said})
        whole = f"{said}: mean of its size over the record, weighted by energy"
        variables[f"{name}_size"] = (dims, size, {**share, "definition": whole})
    at = ("knot", approximate.knots, {"units": "s", "definition": "time from the first sample"})
    return xr.Dataset(variables, {"chain": np.arange(chains), "draw": np.arange(count), "knot": at})


def _attributes(post: Drawn, approximate: Approximate, name: str) -> dict[str, str]:
    return {
        "units": post.fit.units[name],
        "definition": definition(name, approximate.oscillator, post.fit.noise),
        "prior": post.fit.priors[name].describe(),
    }


def _along(
    approximate: Approximate,
    variable: tuple[Any, ...] | None,
    coords: Mapping[str, np.ndarray] | None = None,
) -> xr.Dataset:
    """One variable along the samples that were fitted."""
    times = (
        "time",
        approximate.single.weighing.data.times,
        {"units": "s", "definition": "time from the first sample"},
    )
    return xr.Dataset({} if variable is None else {RECORD: variable}, {**(coords or {}), "time": times})


def _constant(post: Drawn, approximate: Approximate) -> xr.Dataset:
    """Times, and what was held."""
    whole = _along(approximate, None)
    for name, value in post.fit.known.items():
        said = f"known: {definition(name, approximate.oscillator, post.fit.noise)}"
        whole[name] = ((), float(value), {"definition": said})
    return whole


def _stats(post: Drawn) -> xr.Dataset:
    """What a sampler without chains in time has: the log likelihood of each draw, and how its run went."""
    shape = post.u.shape[:2]
    dims = ("chain", "draw")
    variables: dict[str, Any] = {n: (dims, np.asarray(v)) for n, v in post.stats.items()}
    nats = {"definition": "log likelihood of the record", "units": "nat"}
    variables["log_likelihood"] = (dims, post.log_likelihood, nats)
    return xr.Dataset(variables, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])})
