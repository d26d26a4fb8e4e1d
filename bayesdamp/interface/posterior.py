"""Draws of a posterior, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from bayesdamp.formatting import compact
from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.derived import Motions, derive, units
from bayesdamp.inference.model.defaults import reference_of
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.parts import axes as drawing
from bayesdamp.interface.parts.result import Packed, Result, outcome_notes
from bayesdamp.plugins import nearest
from bayesdamp.records.oscillation.features import features
from bayesdamp.table import Table
from bayesdamp.types import OK, ChainStart, InputError, Refusal, Seed

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
COLUMNS = ("mean", "sd", "median", "q2.5", "q97.5", "hdi_low", "hdi_high", "ess_bulk", "ess_tail", "rhat")
SAID = ("summaries", "divergences", "evaluations", "ensembles", "effective")
"""What is saved as it is."""
NO_DRAWS, _NO_VALUES = np.empty((0, 0, 0)), np.empty((0, 0))


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Result):
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

    fit: Fit
    sampler: str
    names: tuple[str, ...] = ()
    draws: Array = field(default_factory=lambda: NO_DRAWS)
    log_likelihood: Array = field(default_factory=lambda: _NO_VALUES)
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    diagnostics: Mapping[str, object] = field(default_factory=dict)
    seed: int = 0
    seconds: float = 0.0
    outcome: str = OK
    u: Array = field(default_factory=lambda: NO_DRAWS, repr=False)
    summaries: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    starts: tuple[ChainStart, ...] = ()
    divergences: int | None = None
    evaluations: int = 0
    ensembles: int | None = None
    effective: float | None = None

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
        from bayesdamp.interface.trees.tree import tree_of

        return tree_of(self)

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

    def _packed(self) -> Packed:
        fit = self.fit._packed()
        meta = {
            "fit": fit.meta,
            "sampler": self.sampler,
            "names": self.names,
            "diagnostics": self.diagnostics,
        }
        meta |= {k: getattr(self, k) for k in SAID} | {"starts": [asdict(one) for one in self.starts]}
        meta |= {"seed": self.seed, "seconds": self.seconds, "outcome": self.outcome}
        arrays = {"draws": self.draws, "log_likelihood": self.log_likelihood}
        arrays |= {"u": self.u} if self.u.size else {}
        arrays |= {f"stats/{n}": np.asarray(v) for n, v in self.stats.items()}
        return Packed("Posterior", meta, arrays | fit.within("fit"))

    @classmethod
    def _unpacked(cls, packed: Packed) -> Self:
        meta = {k: v for k, v in packed.meta.items() if k not in ("fit", "names", "starts")}
        starts = (ChainStart(**{**one, "seed": Seed(**one["seed"])}) for one in packed.meta["starts"])
        stats = {n.removeprefix("stats/"): a for n, a in packed.arrays.items() if n.startswith("stats/")}
        fit, own = Fit._unpacked(packed.part("fit")), packed.arrays
        return cls(
            fit=fit,
            names=tuple(packed.meta["names"]),
            starts=tuple(starts),
            draws=own["draws"],
            log_likelihood=own["log_likelihood"],
            stats=stats,
            u=own.get("u", NO_DRAWS),
            **meta,
        )
