"""A posterior as ArviZ reads it: groups of an xarray.DataTree, with units and definitions as attributes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import xarray as xr

from bayesdamp import __version__
from bayesdamp.inference.deviation.single import Single
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
DAMPING, FREQUENCY = "damping_deviation", "frequency_deviation"
"""The deviations along the record, and with `_size` their sizes over it."""
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
    """The groups posterior, prior, posterior_predictive, observed_data, constant_data, log_likelihood, sample_stats.

    Where laws may hold approximately, along the record are the samples that the fit read, neighbours averaged where
    they are closer than it needs.
    """
    law, signal = post.fit.law, post.fit.signal
    seen = {"units": signal.y_unit} | ({"definition": "the record as it was fitted"} if law else {})
    groups = {
        "posterior": _posterior(post),
        "prior": _prior(post),
        **_pointwise(post),
        "observed_data": _along(post, {RECORD: (("time",), law.weighing.data.y if law else signal.y, seen)}),
        "constant_data": _constant(post),
        "sample_stats": _stats(post),
    }
    tree = xr.DataTree.from_dict({name: groups[name] for name in ORDER if name in groups})
    tree.attrs |= {
        "inference_library": "bayesdamp",
        "inference_library_version": __version__,
        "sampler": post.sampler,
        "model": post.fit.model.name,
        "noise": post.fit.noise,
        "signal": signal.name,
        "outcome": post.outcome,
    }
    return tree


def _parameters(post: Drawn, draws: np.ndarray) -> xr.Dataset:
    """Draws (chain, draw, parameter) by name."""
    fit = post.fit
    coords = {"chain": np.arange(draws.shape[0]), "draw": np.arange(draws.shape[1])}
    variables = {}
    for i, name in enumerate(post.names):
        attributes = {
            "units": fit.units[name],
            "definition": definition(name, fit.oscillator, fit.noise),
            "prior": fit.priors[name].describe(),
        }
        variables[name] = (("chain", "draw"), draws[..., i], attributes)
    return xr.Dataset(variables, coords)


def _with_deviations(post: Drawn, law: Single, u: np.ndarray) -> xr.Dataset:
    """Parameters, deviations at the knots and their sizes, of u (chain, draw, K)."""
    chains, count, total = u.shape
    flat = u.reshape(-1, total)
    found = _parameters(post, law.values(u))
    found["knot"] = ("knot", law.knots, {"units": "s", "definition": "time from the first sample"})
    share = {"units": "1", "prior": "Gaussian process, 0 with probability 0.8"}
    g, h = law.deviations(flat)
    both = ((DAMPING, np.expm1(g), "damping"), (FREQUENCY, h, "frequency"))
    for (name, values, what), size in zip(both, law.sizes(flat), strict=True):
        said = f"relative deviation of the {what} from its law"
        shaped = values.reshape(chains, count, -1)
        found[name] = (("chain", "draw", "knot"), shaped, {**share, "definition": said})
        whole = f"{said}: mean of its size over the record, weighted by energy"
        found[f"{name}_size"] = (
            ("chain", "draw"),
            size.reshape(chains, count),
            {**share, "definition": whole},
        )
    return found


def _posterior(post: Drawn) -> xr.Dataset:
    law = post.fit.law
    return _parameters(post, post.draws) if law is None else _with_deviations(post, law, post.u)


def _prior(post: Drawn) -> xr.Dataset:
    """As many draws of the prior as a chain has."""
    law, count = post.fit.law, post.draws.shape[1]
    if law is not None:
        return _with_deviations(post, law, law.prior_draws(count, post.seed)[None])
    target, _ = post.fit.engine
    z = target.prior_draws(count, np.random.default_rng([post.seed, 1]))[None]
    return _parameters(post, np.stack(list(target.values(z).values()), axis=-1))


def _pointwise(post: Drawn) -> dict[str, xr.Dataset]:
    """Log likelihoods and replications of each sample, (chain, draw, time)."""
    law, (chains, count, _) = post.fit.law, post.draws.shape
    n = post.fit.signal.t.size if law is None else law.weighing.data.t.size
    numbers = np.arange(0, count, max(1, -(-chains * count * n // CELLS)))
    given = "log density of each sample given all others"
    if law is None:
        likelihoods, replications = _pointwise_exactly(post, numbers)
    else:
        rng = np.random.default_rng([post.seed, 2])
        motions = law.motions(post.u[:, numbers].reshape(-1, post.u.shape[-1]))
        likelihoods = law.log_likelihoods(motions)
        noise = np.sqrt(law.weighing.variance) * rng.standard_normal((chains, numbers.size, n))
        replications = motions + noise.reshape(motions.shape)
        given = "log density of each sample; they sum to the log likelihood"
    coords = {"chain": np.arange(chains), "draw": numbers}

    def shaped(values: np.ndarray, unit: str, said: str) -> xr.Dataset:
        own = {"units": unit, "definition": said}
        values = values.reshape(chains, numbers.size, -1)
        return _along(post, {RECORD: (("chain", "draw", "time"), values, own)}, coords)

    found = {"log_likelihood": shaped(likelihoods, "nat", given)}
    if replications is not None:
        said = "motion of a draw with noise of its own"
        found["posterior_predictive"] = shaped(replications, post.fit.signal.y_unit, said)
    return found


def _pointwise_exactly(post: Drawn, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Where laws hold exactly: (m, n) each, no replications where the noise cannot be drawn from."""
    target, mode = post.fit.engine
    n, noise = post.fit.signal.t.size, NOISES.get(target.noise)
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
    return likelihoods, replications if drawn else None


def _along(
    post: Drawn, variables: Mapping[str, tuple[Any, ...]], coords: Mapping[str, np.ndarray] | None = None
) -> xr.Dataset:
    """Variables along the record's times, or those of the samples that were fitted."""
    law = post.fit.law
    t = post.fit.signal.t if law is None else law.weighing.data.times
    times = ("time", t, {"units": "s", "definition": "time from the first sample"})
    return xr.Dataset(dict(variables), {**(coords or {}), "time": times})


def _constant(post: Drawn) -> xr.Dataset:
    """Times, and what is known."""
    whole = _along(post, {})
    for name, value in post.fit.known.items():
        said = f"known: {definition(name, post.fit.oscillator, post.fit.noise)}"
        whole[name] = ((), float(value), {"definition": said})
    return whole


def _stats(post: Drawn) -> xr.Dataset:
    """What the sampler says of each draw, with its density: where laws may hold approximately, its log likelihood."""
    shape, dims = post.draws.shape[:2], ("chain", "draw")
    variables: dict[str, Any] = {
        n: (dims, np.asarray(v)) for n, v in post.stats.items() if np.shape(v) == shape
    }
    if post.fit.law is None:
        lp = {"definition": "log prior plus log likelihood, in natural units", "units": "nat"}
        variables["lp"] = (dims, post.log_prior + post.log_likelihood, lp)
    else:
        nats = {"definition": "log likelihood of the record", "units": "nat"}
        variables["log_likelihood"] = (dims, post.log_likelihood, nats)
    return xr.Dataset(variables, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])})
