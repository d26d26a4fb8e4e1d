"""A posterior as ArviZ reads it: groups of an xarray.DataTree, with units and definitions as attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import xarray as xr

from bayesdamp import __version__
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.parts.definitions import definition
from bayesdamp.types import Refusal

if TYPE_CHECKING:
    from bayesdamp.interface.fit import Fit

CELLS = 20_000_000
"""Numbers that a pointwise group may hold (160 MB): beyond them draws are thinned, evenly, to every so manieth."""
TOGETHER = 500_000
"""Numbers that are computed at a time."""
ORDER = (
    "posterior", "prior", "posterior_predictive", "log_likelihood", "sample_stats", "observed_data", "constant_data",
)  # fmt: skip
RECORD = "record"
"""The one variable of observed, predicted and pointwise groups."""


class Drawn(Protocol):
    """Draws of a posterior, such as `bayesdamp.Posterior`."""

    @property
    def fit(self) -> Fit:
        """What the draws are of."""
        ...

    @property
    def sampler(self) -> str:
        """What drew them."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        ...

    @property
    def draws(self) -> np.ndarray:
        """(chain, draw, parameter)."""
        ...

    @property
    def u(self) -> np.ndarray:
        """With the deviations, (chain, draw, K)."""
        ...

    @property
    def log_likelihood(self) -> np.ndarray:
        """(chain, draw)."""
        ...

    @property
    def log_prior(self) -> np.ndarray:
        """(chain, draw)."""
        ...

    @property
    def stats(self) -> Mapping[str, np.ndarray]:
        """Of the sampler, by name."""
        ...

    @property
    def seed(self) -> int:
        """Of all random numbers."""
        ...

    @property
    def outcome(self) -> str:
        """ "ok", or why the draws are not to be trusted."""
        ...


def tree_of(post: Drawn) -> xr.DataTree:
    """The groups posterior, prior, posterior_predictive, observed_data, constant_data, log_likelihood, sample_stats."""
    target, mode = post.fit.engine
    groups = {
        "posterior": parameters(post, post.draws, np.arange(post.draws.shape[1])),
        "prior": _prior(post),
        **_pointwise(post, target, mode),
        "observed_data": _on_the_record(
            post, {RECORD: post.fit.signal.y}, units={RECORD: post.fit.signal.y_unit}
        ),
        "constant_data": _constant(post),
        "sample_stats": _stats(post),
    }
    tree = xr.DataTree.from_dict(in_order(groups))
    tree.attrs |= origin_of(post)
    return tree


def in_order(groups: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Groups in the order in which ArviZ lists them."""
    return {name: groups[name] for name in ORDER if name in groups}


def origin_of(post: Drawn) -> dict[str, str]:
    """What a tree says of where it is from."""
    return {
        "inference_library": "bayesdamp",
        "inference_library_version": __version__,
        "sampler": post.sampler,
        "model": post.fit.model.name,
        "noise": post.fit.noise,
        "signal": post.fit.signal.name,
        "outcome": post.outcome,
    }


def parameters(post: Drawn, draws: np.ndarray, numbers: np.ndarray) -> xr.Dataset:
    """Draws (chain, draw, parameter) by name. numbers: of the draws, (draw,)."""
    coords = {"chain": np.arange(draws.shape[0]), "draw": numbers}
    return xr.Dataset(
        {n: (("chain", "draw"), draws[..., i], _attributes(post, n)) for i, n in enumerate(post.names)},
        coords,
    )


def _attributes(post: Drawn, name: str) -> dict[str, str]:
    target, _ = post.fit.engine
    prior = target.priors[name].describe()
    units, what = post.fit.units[name], definition(name, target.oscillator, target.noise)
    return {"units": units, "definition": what, "prior": prior}


def _prior(post: Drawn) -> xr.Dataset:
    """As many draws of the prior as a chain has."""
    target, _ = post.fit.engine
    count = post.draws.shape[1]
    z = target.prior_draws(count, np.random.default_rng([post.seed, 1]))[None]
    values = [target.priors[n].value(z[..., i]) for i, n in enumerate(post.names)]
    return parameters(post, np.stack(values, axis=-1), np.arange(count))


def _pointwise(post: Drawn, target: Target, mode: Mode) -> dict[str, xr.Dataset]:
    """Log likelihoods and replications of each sample, (chain, draw, time)."""
    chains, count, _ = post.draws.shape
    n, noise = post.fit.signal.t.size, NOISES.get(target.noise)
    every = max(1, -(-chains * count * n // CELLS))
    numbers = np.arange(0, count, every)
    draws = post.draws[:, numbers].reshape(-1, len(post.names))
    values = {**{k: np.full(len(draws), float(v)) for k, v in target.known.items()}}
    values |= {name: draws[:, i] for i, name in enumerate(post.names)}
    gaps, rng = np.diff(post.fit.signal.t), np.random.default_rng([post.seed, 2])
    likelihoods, replications = np.empty((len(draws), n)), np.empty((len(draws), n))
    drawn = True
    for rows in np.array_split(np.arange(len(draws)), max(1, len(draws) * n // TOGETHER)):
        some = {name: v[rows] for name, v in values.items()}
        motion = mode.likelihood.motions.many(some)
        of_noise = {name: some[name] for name in (*noise.parameters, *noise.constants)}
        likelihoods[rows] = noise.log_likelihoods(post.fit.signal.y - motion, gaps, of_noise)
        try:
            for i, row in enumerate(rows):
                own = {name: float(v[i]) for name, v in of_noise.items()}
                replications[row] = motion[i] + noise.draw(rng, gaps, own)
        except Refusal:
            drawn = False
    shape = (chains, numbers.size, n)
    coords = {"chain": np.arange(chains), "draw": numbers}
    dims = ("chain", "draw", "time")
    given = {RECORD: "log density of each sample given all others"}
    found = {
        "log_likelihood": _on_the_record(
            post, {RECORD: likelihoods.reshape(shape)}, dims, coords, {RECORD: "nat"}, given
        )
    }
    if drawn:
        unit = {RECORD: post.fit.signal.y_unit}
        given = {RECORD: "motion of a draw with noise of its own"}
        whole = {RECORD: replications.reshape(shape)}
        found["posterior_predictive"] = _on_the_record(post, whole, dims, coords, unit, given)
    return found


def _on_the_record(
    post: Drawn,
    values: Mapping[str, np.ndarray],
    dims: tuple[str, ...] = ("time",),
    coords: Mapping[str, np.ndarray] | None = None,
    units: Mapping[str, str] | None = None,
    definitions: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Variables along the record's times."""
    times = ("time", post.fit.signal.t, {"units": "s", "definition": "time from the first sample"})

    def attributes(name: str) -> dict[str, str]:
        unit = {"units": units[name]} if units else {}
        return unit | ({"definition": definitions[name]} if definitions else {})

    variables = {name: (dims, v, attributes(name)) for name, v in values.items()}
    return xr.Dataset(variables, {**(coords or {}), "time": times})


def _constant(post: Drawn) -> xr.Dataset:
    """Times, and what is known."""
    target, _ = post.fit.engine
    whole = _on_the_record(post, {})
    for name, value in target.known.items():
        whole[name] = (
            (),
            float(value),
            {"definition": f"known: {definition(name, target.oscillator, target.noise)}"},
        )
    return whole


def _stats(post: Drawn) -> xr.Dataset:
    shape = post.draws.shape[:2]
    variables: dict[str, Any] = {
        n: (("chain", "draw"), np.asarray(v)) for n, v in post.stats.items() if np.shape(v) == shape
    }
    lp = {"definition": "log prior plus log likelihood, in natural units", "units": "nat"}
    variables["lp"] = (("chain", "draw"), post.log_prior + post.log_likelihood, lp)
    return xr.Dataset(variables, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])})
