"""Draws of a posterior, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayesdamp import __version__, types
from bayesdamp.formatting import compact
from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.derived import Motions, derive, units
from bayesdamp.inference.deviation.single import Single
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.parts import axes as drawing
from bayesdamp.interface.parts.definitions import definition
from bayesdamp.interface.parts.result import Result, outcome_notes
from bayesdamp.plugins import nearest
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.reference import reference_of
from bayesdamp.store.contents import NO_DRAWS
from bayesdamp.table import Table
from bayesdamp.types import InputError, Refusal

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
COLUMNS = ("mean", "sd", "median", "q2.5", "q97.5", "hdi_low", "hdi_high", "ess_bulk", "ess_tail", "rhat")
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
Group = tuple[dict[str, Any], dict[str, Any]]
"""Variables and coordinates of a group, as `xarray.Dataset` takes them."""


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Result, types.Posterior):
    """Draws of the posterior of a fit.

    names: of the parameters; draws: in natural units, shape (chain, draw, parameter); log_likelihood: of each, (chain,
    draw), nats; stats: of the sampler, by name, (chain, draw); summaries: of each parameter; starts: of the chains;
    divergences: how many transitions diverged, None where there is no such thing; evaluations: of the likelihood;
    ensembles: into which chains fall that share their moves; effective: how many draws of the posterior those of an
    approximation are worth; diagnostics: what else the sampler says.
    seed: of all random numbers. outcome: "ok", or a sentence why the draws are not to be trusted, or why there are
    none.
    u: where laws may hold approximately, each draw with its deviations, as `fit.law` reads them, (chain, draw, K);
    a chain of "smc" is a run of its own, in no order of time. The likelihood of "nuts" and "emcee" is there that of the
    parameters, deviations integrated out.
    """

    fit: Fit = field(kw_only=True)
    seed: int = 0
    u: Array = field(default_factory=lambda: NO_DRAWS[0], repr=False)

    @property
    def log_evidence(self) -> float:
        """In nats, of "smc" alone; else nan."""
        return float(self.diagnostics.get("log_evidence", math.nan))  # type: ignore[arg-type]

    @property
    def stderr(self) -> float:
        """Its standard error."""
        return float(self.diagnostics.get("stderr", math.nan))  # type: ignore[arg-type]

    @cached_property
    def data(self) -> xr.DataTree:
        """All of it as ArviZ reads it, computed when it is first asked for.

        Groups: posterior, prior, posterior_predictive, log_likelihood (of each sample given all others, as
        leave-one-out cross-validation weighs it), sample_stats, observed_data, constant_data; units and definitions are
        attributes of the variables. Of very many samples and draws the two groups along the record are thinned, to a
        size of 160 MB each. Raises Refusal without draws.

        Where laws may hold approximately, posterior and prior have the deviations at their knots too, and their sizes
        over the record; the groups along the record have the samples that were fitted.
        """
        self._there()
        return _tree_of(self)

    @cached_property
    def derived(self) -> xr.Dataset:
        """What follows from the draws (chain, draw): natural frequency, damping ratio, half-life and others, with their
        units and definitions as attributes; the reference amplitude is that of the priors. They are of the laws alone;
        where these hold approximately, `damping_ratio` has what the deviations make of them. Raises Refusal without
        draws.
        """
        import xarray as xr

        self._there()
        signal, model = self.fit.signal, self.fit.model
        seen = features(signal)
        amplitude = reference_of(model.system, seen).amplitude
        values = {**self.fit.known, **{n: self.draws[..., i] for i, n in enumerate(self.names)}}
        found = derive(Motions(self.fit.oscillator, values, seen.rest, amplitude))
        unit = units(signal.unit)
        own = signal.own_unit.displacement
        at = f"{amplitude * own.scale:.4g} {own.name}"
        attributes = {n: {"units": unit[n], "amplitude": at} for n in found}
        return xr.Dataset({n: (("chain", "draw"), v, attributes[n]) for n, v in found.items()})

    def damping_ratio(self, amplitudes: Sequence[float] | None = None) -> pd.DataFrame:
        """`Fit.damping_ratio` of these draws. Raises Refusal where laws are taken to hold exactly, or without draws."""
        self._there()
        return self.fit._damping_ratio(
            amplitudes, self.u.reshape(-1, self.u.shape[-1]) if self.u.size else None
        )

    @property
    def log_prior(self) -> Array:
        """Log density of the parameters' prior in natural units at each draw, (chain, draw); deviations have none, as
        they are 0 with a probability of their own."""
        self._there()
        priors = self.fit.priors
        return np.sum([priors[n].log_density(self.draws[..., i]) for i, n in enumerate(self.names)], axis=0)

    def summary(self, derived: bool = True) -> pd.DataFrame:
        """A row for each parameter, and each derived quantity that all draws have: mean, sd, quantiles, the shortest
        interval of 95 %, effective sample sizes, R-hat, unit. Empty without draws."""
        import pandas as pd

        rows = {n: {**s, "unit": self.fit.units[n]} for n, s in self.summaries.items()}
        if derived and self.names:
            for name, values in self.derived.data_vars.items():
                if np.all(np.isfinite(values.values)):
                    found = diagnostics.summarise(values.values, self.ensembles, self.effective)
                    rows[str(name)] = {**found, "unit": values.attrs["units"]}
        parts = ["sd_noise", "sd_law"] if self.fit.law is not None else []
        return pd.DataFrame.from_dict(rows, orient="index", columns=[*COLUMNS, *parts, "unit"])

    def plot(self, ax: drawing.Given = None, names: Sequence[str] | None = None) -> tuple[Axes, ...]:
        """Draw the trace of each parameter, and its density to the right of it; the axes drawn on, two a parameter.

        ax: two for each parameter. names: of the parameters to draw, all by default. Raises InputError for a name that
        is none, Refusal without draws.
        """
        self._there()
        chosen = list(self.names if names is None else names)
        for name in chosen:
            if name not in self.names:
                raise InputError(f"plot: unknown parameter {name!r}{nearest(name, list(self.names))}")
        size = (9.0, 1.6 * len(chosen))
        found = drawing.several(ax, 2 * len(chosen), columns=2, size=size)
        for i, name in enumerate(chosen):
            draws = self.draws[..., self.names.index(name)]
            trace, density = found[2 * i], found[2 * i + 1]
            for chain in draws:
                trace.plot(chain, lw=0.4)
                density.hist(chain, bins=40, density=True, histtype="step")
            grid = np.linspace(*density.get_xlim(), 200)
            density.plot(
                grid,
                np.exp(self.fit.priors[name].log_density(grid)),
                color=drawing.QUIET,
                ls="--",
                label="prior",
            )
            unit = self.fit.units[name]
            trace.set_ylabel(name)
            density.set_xlabel(f"{name} / {unit}")
            trace.set_xlabel("draw")
            density.set_yticks([])
            density.locator_params(axis="x", nbins=5)
        if chosen:
            found[1].legend(loc="upper right")
        return found

    def _there(self) -> None:
        """Raises Refusal without draws."""
        if not self.names:
            raise Refusal(self.outcome)

    def _table(self) -> Table:
        columns = ("mean", "sd", "q2.5", "q97.5", "ess_bulk", "rhat")
        rows = [(n, self.fit.units[n], *(compact(s[c]) for c in columns)) for n, s in self.summaries.items()]
        title = f"Posterior of {self.fit.model.name} on {self.fit.signal.name} by {self.sampler}"
        if self.names:
            title += f": {self.draws.shape[0]} chains of {self.draws.shape[1]} draws"
        return Table(("parameter", "unit", *columns), rows, caption=title, notes=outcome_notes(self.outcome))


def _tree_of(post: Posterior) -> xr.DataTree:
    """Return the groups of `ORDER`.

    Where laws may hold approximately, along the record are the samples that the fit read, neighbours averaged where
    they are closer than it needs.
    """
    import xarray as xr

    law, signal = post.fit.law, post.fit.signal
    seen = {"units": signal.y_unit} | ({"definition": "the record as it was fitted"} if law else {})
    fit = post.fit
    known = {
        n: ((), float(v), {"definition": f"known: {definition(n, fit.oscillator, fit.noise)}"})
        for n, v in fit.known.items()
    }
    groups = {
        "posterior": _parameters(post, post.draws) if law is None else _with_deviations(post, law, post.u),
        "prior": _prior(post),
        **_pointwise(post),
        "observed_data": _along(post, {RECORD: (("time",), law.weighing.data.y if law else signal.y, seen)}),
        "constant_data": _along(post, known),
        "sample_stats": _stats(post),
    }
    tree = xr.DataTree.from_dict({name: xr.Dataset(*groups[name]) for name in ORDER if name in groups})
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


def _parameters(post: Posterior, draws: np.ndarray) -> Group:
    """Draws (chain, draw, parameter) by name."""
    fit = post.fit
    coords = {"chain": np.arange(draws.shape[0]), "draw": np.arange(draws.shape[1])}
    variables: dict[str, Any] = {}
    for i, name in enumerate(post.names):
        attributes = {
            "units": fit.units[name],
            "definition": definition(name, fit.oscillator, fit.noise),
            "prior": fit.priors[name].describe(),
        }
        variables[name] = (("chain", "draw"), draws[..., i], attributes)
    return variables, coords


def _with_deviations(post: Posterior, law: Single, u: np.ndarray) -> Group:
    """Parameters, deviations at the knots and their sizes, of u (chain, draw, K)."""
    chains, count, total = u.shape
    flat = u.reshape(-1, total)
    found, coords = _parameters(post, law.values(u))
    coords["knot"] = ("knot", law.knots, {"units": "s", "definition": "time from the first sample"})
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
    return found, coords


def _prior(post: Posterior) -> Group:
    """As many draws of the prior as a chain has."""
    law, count = post.fit.law, post.draws.shape[1]
    if law is not None:
        return _with_deviations(post, law, law.prior_draws(count, post.seed)[None])
    target, _ = post.fit.engine
    z = target.prior_draws(count, np.random.default_rng([post.seed, 1]))[None]
    return _parameters(post, np.stack(list(target.values(z).values()), axis=-1))


def _pointwise(post: Posterior) -> dict[str, Group]:
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

    def shaped(values: np.ndarray, unit: str, said: str) -> Group:
        own = {"units": unit, "definition": said}
        values = values.reshape(chains, numbers.size, -1)
        return _along(post, {RECORD: (("chain", "draw", "time"), values, own)}, coords)

    found = {"log_likelihood": shaped(likelihoods, "nat", given)}
    if replications is not None:
        said = "motion of a draw with noise of its own"
        found["posterior_predictive"] = shaped(replications, post.fit.signal.y_unit, said)
    return found


def _pointwise_exactly(post: Posterior, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
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
    post: Posterior, variables: dict[str, Any], coords: Mapping[str, np.ndarray] = MappingProxyType({})
) -> Group:
    """Variables along the record's times, or those of the samples that were fitted."""
    law = post.fit.law
    t = post.fit.signal.t if law is None else law.weighing.data.times
    times = ("time", t, {"units": "s", "definition": "time from the first sample"})
    return variables, {**coords, "time": times}


def _stats(post: Posterior) -> Group:
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
    return variables, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}
