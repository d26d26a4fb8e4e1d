"""Sample the posterior of a fit, derive results from the draws, and compute the evidence of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bayesdamp import __version__, types
from bayesdamp.calls import KINDS
from bayesdamp.config.checks import check_keys, read_section
from bayesdamp.config.study import Header, PosteriorTable
from bayesdamp.formatting import Table, data_frame, digits
from bayesdamp.inference import diagnostics
from bayesdamp.inference.derived import Motions, derive_quantities, units
from bayesdamp.inference.deviation.single import Single, sample_motions
from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.interface.fit import Fit, tabulate_ratios
from bayesdamp.interface.result import QUIET, GivenAxes, Result, frame_table, get_axes, outcome_notes
from bayesdamp.physics.oscillator import reference_of
from bayesdamp.priors import joint_log_density
from bayesdamp.records.oscillation.features import features
from bayesdamp.store.results import NO_DRAWS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.axes import Axes


Array = NDArray[np.float64]
MOST_VALUES = 20_000_000
"""Approximate largest number of values in each group of `Posterior.data` that has a value for each draw and each sample
of the record; this is 160 MB."""
DAMPING, FREQUENCY = "damping_deviation", "frequency_deviation"
"""Names of the variables in `Posterior.data` with the relative deviations of damping and frequency from their laws, at
times along the record. With the suffix `_size` they name the mean size of each over the record (`Single.sizes`)."""
RECORD = "record"
"""Name of the only variable in each group of `Posterior.data` whose values belong to the samples of the record: the
observed values, the simulated values, or the log likelihoods."""
Group = tuple[dict[str, Any], dict[str, Any]]
"""Type of the content of a group of `Posterior.data`: its variables and its coordinates, the first two arguments of
`xarray.Dataset`."""
TEMPERED = "smc"
"""Default sampler (sequential Monte Carlo with tempering) if the model allows deviations from its laws."""
EXACT_SAMPLER = "nuts"
"""Default sampler if the model assumes exact laws of damping and restoring force."""
DEFAULT_DRAWS = 1000
"""Default number of draws of each chain (conventional)."""


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Result, types.Posterior):
    """Draws of the posterior of a fit.

    If the model allows deviations from its laws, each chain of the sampler "smc" is an independent run, and the order
    of its draws has no meaning. The samplers "nuts" and "emcee" then sample the parameters only, with a likelihood in
    which the deviations are integrated out.

    Attributes
    ----------
    fit, sampler
        The fit, and the name of the sampler.
    names, summaries
        Names of the inferred parameters, and mean, sd, quantiles and diagnostics of each, by name. Both are empty if
        the sampler gave no draws.
    draws
        Draws in natural units (`fit.units`), shape (chain, draw, parameter), without warmup; emcee may thin them.
    log_likelihood
        Log likelihood of each draw in nats, shape (chain, draw).
    stats
        Statistics of the sampler by name, each of shape (chain, draw).
    divergences
        Number of divergent transitions of "nuts"; None for samplers without them.
    evaluations, seconds
        Number of evaluations of the likelihood, and computing time in s.
    ensembles
        Number of ensembles of chains that exchange information (emcee), for the diagnostics.
    diagnostics
        Other results of the sampler.
    seed
        Seed of all random numbers.
    outcome
        "ok", or a sentence that says why the draws are unreliable or missing.
    u
        If the model allows deviations from its laws: all unknowns of each draw, shape (chain, draw, K). These are the
        parameters as scores (transformed values with the prior N(0, 1)), the log deviation g of the damping, and the
        relative deviation h of the frequency. g and h are at the times `fit.law.knots`. Otherwise empty.
    """

    fit: Fit = field(kw_only=True)
    seed: int = 0
    u: Array = field(default_factory=lambda: NO_DRAWS[0], repr=False)

    @property
    def log_evidence(self) -> float:
        """The log evidence of the model in nats; NaN unless the sampler is "smc", because others do not compute it."""
        return float(self.diagnostics.get("log_evidence", np.nan))  # type: ignore[arg-type]

    @property
    def stderr(self) -> float:
        """Standard error of `log_evidence` in nats; NaN unless the sampler is "smc"."""
        return float(self.diagnostics.get("stderr", np.nan))  # type: ignore[arg-type]

    @cached_property
    def data(self) -> xr.DataTree:
        """All results as a data tree for ArviZ, computed at the first use.

        The groups are posterior, prior, posterior_predictive, log_likelihood (of each sample given all others, as in
        leave-one-out cross-validation), sample_stats, observed_data and constant_data. posterior_predictive is missing
        if the noise model cannot be simulated. Times are in s from the first sample, and units are attributes. With
        very many samples and draws, posterior_predictive and log_likelihood contain only every n-th draw, so that each
        has a size of 160 MB. Raises Refusal if the sampler gave no draws.

        If the model allows deviations from its laws, posterior and prior also contain the deviations at the times at
        which they are inferred (coordinate `knot`), and their mean sizes. Observed, simulated and log likelihood values
        then belong to the data that were fitted, as in `Data`. These are samples, or averages of neighbouring samples
        if the sampling is denser than the fit needs. For a record of many cycles they are amplitudes, phases and
        midlines of blocks of cycles, scaled so that all have the same noise, in the unit of the record.
        """
        return build_tree(self, MOST_VALUES)

    @cached_property
    def derived(self) -> xr.Dataset:
        """Natural frequency, damping ratio, half-life and other quantities of each draw, (chain, draw).

        natural_frequency, damping_ratio and quality_factor are those of small oscillations. The others are at the
        amplitude to which default priors are scaled; half_life is the time from this amplitude to half of it. Each has
        the attributes `units` and `amplitude` (this amplitude as text, also for the three that do not depend on it). A
        quantity that the model does not have, such as damping_ratio with friction alone, is missing, and so is
        natural_frequency if all parameters of the restoring law are known. A value is not finite if the quantity does
        not exist for a draw. Deviations from the laws are not included; the method `damping_ratio` includes them.
        Raises Refusal if the sampler gave no draws.
        """
        import xarray as xr

        self._require_draws()
        signal, model = self.fit.signal, self.fit.model
        own = features(signal)
        amplitude = reference_of(model.system, own).amplitude
        values = {**self.fit.known, **{n: self.draws[..., i] for i, n in enumerate(self.names)}}
        derived = derive_quantities(Motions(self.fit.oscillator, values, own.rest, amplitude))
        unit = units(signal.unit)
        displacement = signal.own_unit.displacement
        at = f"{digits(amplitude * displacement.scale)} {displacement.name}"
        return xr.Dataset(
            {n: (("chain", "draw"), v, {"units": unit[n], "amplitude": at}) for n, v in derived.items()}
        )

    def damping_ratio(self, amplitudes: Sequence[float] | None = None) -> pd.DataFrame:
        """Return a table of equivalent damping ratios at several amplitudes, from these draws.

        The columns, `amplitudes` and errors are those of `Fit.damping_ratio`. Raises Refusal also if the sampler gave
        no draws.
        """
        self._require_draws()
        u = self.u.reshape(-1, self.u.shape[-1]) if self.u.size else None
        return tabulate_ratios(self.fit, amplitudes, u)

    @property
    def log_prior(self) -> Array:
        """Log of the joint prior density of the parameters in natural units at each draw, (chain, draw).

        Deviations are not included, because they have no density: their prior is a mixture with a point mass at 0.
        Raises Refusal if the sampler gave no draws.
        """
        self._require_draws()
        scales = self.fit.engine[0].scales
        return joint_log_density([self.fit.priors[n] for n in self.names], self.draws, scales)

    def summary(self, derived: bool = True) -> pd.DataFrame:
        """Return a table with a row for each parameter and, if `derived`, for each quantity of the property `derived`.

        It is empty if the sampler gave no draws. Quantities that do not exist for some draws are left out. The columns
        are mean, sd, quantiles, the shortest 95 % interval, effective sample sizes, R-hat and unit. If the model allows
        deviations from its laws, there are also the parts of each parameter's sd that are due to the noise and to the
        deviations, as in `Fit`.
        """
        rows = {n: {**s, "unit": self.fit.units[n]} for n, s in self.summaries.items()}
        if derived and self.names:
            for name, values in self.derived.data_vars.items():
                if np.all(np.isfinite(values.values)):
                    row = diagnostics.summarise(values.values, self.ensembles)
                    rows[str(name)] = {**row, "unit": values.attrs["units"]}
        return data_frame(rows.values(), index=rows)

    def plot(self, ax: GivenAxes = None, names: Sequence[str] | None = None) -> tuple[Axes, ...]:
        """Plot the trace of each parameter, and to the right a histogram of each chain with the prior (dashed).

        Derived quantities are not plotted.

        Parameters
        ----------
        ax
            Two axes for each parameter; by default new ones.
        names
            Parameters to plot; by default all.

        Returns
        -------
        tuple of Axes
            The axes, two for each parameter.

        Raises
        ------
        InputError
            If a name is not an inferred parameter, or `ax` contains another number of axes.
        Refusal
            If the sampler gave no draws.
        """
        self._require_draws()
        chosen = list(self.names if names is None else names)
        check_keys(chosen, self.names, "plot.names")
        axes = get_axes(ax, 2 * len(chosen), columns=2, size=(9.0, 1.6 * len(chosen)))
        for i, name in enumerate(chosen):
            draws = self.draws[..., self.names.index(name)]
            trace, density = axes[2 * i], axes[2 * i + 1]
            for chain in draws:
                trace.plot(chain, lw=0.4)
                density.hist(chain, bins=40, density=True, histtype="step")
            grid = np.linspace(*density.get_xlim(), 200)
            prior = np.exp(self.fit.priors[name].log_density(grid))
            density.plot(grid, prior, color=QUIET, ls="--", label="prior")
            trace.set_ylabel(name)
            density.set_xlabel(f"{name} / {self.fit.units[name]}")
            trace.set_xlabel("draw")
            density.set_yticks([])
            density.locator_params(axis="x", nbins=5)
        if chosen:
            axes[1].legend(loc="upper right")
        return axes

    def _require_draws(self) -> None:
        """Raise Refusal, with the text `outcome`, if the sampler gave no draws."""
        if not self.names:
            raise types.Refusal(self.outcome)

    def _table(self) -> Table:
        columns = ["mean", "sd", "q2.5", "q97.5", "ess_bulk", "rhat", "unit"]
        title = f"Posterior of {self.fit.model.name} on {self.fit.signal.name} by {self.sampler}"
        if self.names:
            title += f": {self.draws.shape[0]} chains of {self.draws.shape[1]} draws"
        return frame_table(self.summary(derived=False).filter(columns), title, outcome_notes(self.outcome))


def build_tree(post: Posterior, most: int) -> xr.DataTree:
    """Return all results as a data tree for ArviZ, as `Posterior.data` explains; raise Refusal if there are no draws.

    most: approximate largest number of values in each of the groups posterior_predictive and log_likelihood. If there
    would be more, these groups contain only every n-th draw, but at least one draw of each chain.
    """
    post._require_draws()
    import xarray as xr

    fit = post.fit
    law, signal = fit.law, fit.signal
    known = {n: ((), float(v)) for n, v in fit.known.items()}
    y = law.comparison.data.y if law else signal.y
    shape, dims = post.draws.shape[:2], ("chain", "draw")
    stats: dict[str, Any] = {n: (dims, np.asarray(v)) for n, v in post.stats.items() if np.shape(v) == shape}
    stats["log_likelihood"] = (dims, post.log_likelihood, {"units": "nat"})
    if law is None:
        target, _ = fit.engine
        z = target.prior_draws(shape[1], np.random.default_rng([post.seed, 1]))[None]
        prior = _parameters(post, np.stack(list(target.values(z).values()), axis=-1))
        own = _parameters(post, post.draws)
        stats["lp"] = (dims, post.log_prior + post.log_likelihood, {"units": "nat"})
    else:
        prior = _with_deviations(post, law, law.prior_draws(shape[1], post.seed)[None])
        own = _with_deviations(post, law, post.u)
    groups = {
        "posterior": own,
        "prior": prior,
        **_pointwise(post, most),
        "sample_stats": (stats, {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}),
        "observed_data": ({RECORD: (("time",), y, {"units": signal.y_unit})}, _times(post)),
        "constant_data": (known, _times(post)),
    }
    tree = xr.DataTree.from_dict({name: xr.Dataset(*group) for name, group in groups.items()})
    tree.attrs |= {
        "inference_library": "bayesdamp",
        "inference_library_version": __version__,
        "sampler": post.sampler,
        "model": fit.model.name,
        "noise": fit.noise,
        "signal": signal.name,
        "outcome": post.outcome,
    }
    return tree


def _parameters(post: Posterior, draws: np.ndarray) -> Group:
    """Convert draws, (chain, draw, parameter), to a group: a variable for each parameter, and coordinates.

    The parameters are in the order of `post.names`; their units are attributes.
    """
    coords = {"chain": np.arange(draws.shape[0]), "draw": np.arange(draws.shape[1])}
    variables: dict[str, Any] = {
        name: (("chain", "draw"), draws[..., i], {"units": post.fit.units[name]})
        for i, name in enumerate(post.names)
    }
    return variables, coords


def _with_deviations(post: Posterior, law: Single, u: np.ndarray) -> Group:
    """Convert draws with deviations from the laws to a group: parameters, deviations and their mean sizes.

    The deviations in the group are exp(g) − 1 and h, their sizes those of g and h (`Single.sizes`). `u`, (chain, draw,
    K), contains the draws: the parameters as standard normal scores, then the deviations g (log damping) and h
    (relative frequency) at the times `law.knots`.
    """
    chains, count, total = u.shape
    flat = u.reshape(-1, total)
    variables, coords = _parameters(post, law.values(u))
    coords["knot"] = ("knot", law.knots, {"units": "s"})
    g, h = law.deviations(flat)
    both = ((DAMPING, np.expm1(g)), (FREQUENCY, h))
    for (name, values), size in zip(both, law.sizes(flat), strict=True):
        variables[name] = (("chain", "draw", "knot"), values.reshape(chains, count, -1), {"units": "1"})
        variables[f"{name}_size"] = (("chain", "draw"), size.reshape(chains, count), {"units": "1"})
    return variables, coords


def _pointwise(post: Posterior, most: int) -> dict[str, Group]:
    """Return the groups log_likelihood and posterior_predictive, whose variable has the shape (chain, draw, time).

    They contain, for each draw, the log likelihood of each sample in nats, and a simulated record with noise.
    posterior_predictive is missing if the noise model cannot be simulated. Only every n-th draw is used, if a group
    would otherwise have more than about `most` values.
    """
    law, (chains, count, _) = post.fit.law, post.draws.shape
    n = post.fit.signal.t.size if law is None else law.comparison.data.t.size
    numbers = np.arange(0, count, max(1, -(-chains * count * n // most)))
    if law is None:
        likelihoods, replications = _pointwise_exactly(post, numbers)
    else:
        rng = np.random.default_rng([post.seed, 2])
        motions = law.motions(post.u[:, numbers].reshape(-1, post.u.shape[-1]))
        likelihoods = law.log_likelihoods(motions)
        noise = np.sqrt(law.comparison.variance) * rng.standard_normal((chains, numbers.size, n))
        replications = motions + noise.reshape(motions.shape)
    rows = {"log_likelihood": (likelihoods, "nat")}
    if replications is not None:
        rows = {"posterior_predictive": (replications, post.fit.signal.y_unit), **rows}
    coords = {"chain": np.arange(chains), "draw": numbers, **_times(post)}
    groups = {}
    for name, (values, unit) in rows.items():
        shaped = values.reshape(chains, numbers.size, -1)
        groups[name] = {RECORD: (("chain", "draw", "time"), shaped, {"units": unit})}, coords
    return groups


def _pointwise_exactly(post: Posterior, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Compute the log likelihood of each sample, and a simulated record, for draws of a fit that assumes exact laws.

    `numbers` are the indices of the draws of each chain that are used. Both results have the shape (m, n) for m draws,
    chain after chain, and n samples. The simulated records contain noise; instead of them the second result is None if
    the noise model cannot be simulated.
    """
    target, mode = post.fit.engine
    noise = NOISES.get(target.noise)
    draws = post.draws[:, numbers].reshape(-1, len(post.names))
    values = {k: np.full(len(draws), float(v)) for k, v in target.known.items()}
    values |= {name: draws[:, i] for i, name in enumerate(post.names)}
    gaps, rng = np.diff(post.fit.signal.t), np.random.default_rng([post.seed, 2])
    motions = mode.likelihood.motions.many(values)
    of_noise = {name: values[name] for name in (*noise.parameters, *noise.constants)}
    likelihoods = noise.log_likelihoods(post.fit.signal.y - motions, gaps, of_noise)
    try:
        for i, motion in enumerate(motions):
            motion += noise.draw(rng, gaps, {name: float(v[i]) for name, v in of_noise.items()})
    except types.Refusal:
        return likelihoods, None
    return likelihoods, motions


def _times(post: Posterior) -> dict[str, Any]:
    """Return the coordinate `time` in s, for the samples of the record.

    If the model allows deviations from its laws, the times are those of the fitted data, which may be averages.
    """
    law = post.fit.law
    t = post.fit.signal.t if law is None else law.comparison.data.times
    return {"time": ("time", t, {"units": "s"})}


KINDS["fit"] = ((Fit,), "a Fit, the result of fit(signal, model)")
KINDS["source"] = ((Posterior, Fit), "a Posterior or a Fit")


def sample(
    fit: Fit,
    sampler: str | None = None,
    *,
    chains: int = 4,
    warmup: int = 500,
    draws: int | None = None,
    seed: int = 0,
) -> Posterior:
    """Sample the posterior of a fit.

    If the model allows deviations of damping and restoring force from their laws, the default sampler is "smc"
    (sequential Monte Carlo). Each chain is then an independent run, which moves its draws in steps from a linear
    approximation of the motion to the full equation of motion; it needs no warmup. The other samplers assume that the
    motion is linear in the deviations. They integrate the deviations out, sample the parameters, and then draw
    deviations for each draw. Their results agree with those of "smc" if the deviations are small.

    Parameters
    ----------
    fit
        The fit.
    sampler
        A name in `bayesdamp.inference.samplers.SAMPLERS`: nuts (the default if the model assumes exact laws) or emcee.
        If the model allows deviations from its laws, also smc, which is then the default.
    chains, warmup
        Number of chains, 2 to 1000, and number of draws that each chain discards at its beginning, at least 10 (emcee
        discards half of it; smc none). With deviations from the laws nuts discards at most 50, emcee 25. For emcee the
        chains are walkers, of which it uses at least 8 times the requested number.
    draws
        Number of draws of each chain after the warmup, at least 10. By default 1,000; only then nuts adds draws if
        these are too few, and emcee makes as many as it needs instead.
    seed
        Seed of all random numbers.

    Returns
    -------
    Posterior
        The draws. If there is no fit, or the sampler cannot work on it, or there are too few independent draws, its
        outcome is a sentence with the reason.

    Raises
    ------
    InputError
        If an argument is invalid.
    """
    grows, draws = draws is None, DEFAULT_DRAWS if draws is None else draws
    read_section(PosteriorTable, {"chains": chains, "warmup": warmup, "draws": draws}, "sample")
    read_section(Header, {"version": 1, "seed": seed}, "sample")
    sampler = sampler or (TEMPERED if fit.model.approximate else EXACT_SAMPLER)
    blank = Posterior(sampler, (), *NO_DRAWS, fit=fit, seed=seed, outcome=fit.outcome)
    if fit.outcome != types.OK:
        return blank
    try:
        drawn, u = draw(fit, sampler, Settings(chains, warmup, draws, seed % 2**31, grows))
    except types.Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return Posterior(**vars(drawn), fit=fit, seed=seed, u=u)


def draw(fit: Fit, sampler: str, settings: Settings) -> tuple[types.Posterior, Array]:
    """Sample the posterior of a fit without checking the arguments.

    `sample`, which checks them, and the tasks of a study call this function. `settings` contains the numbers of chains
    and draws, the warmup, and the seed.

    Returns
    -------
    posterior
        The draws in natural units with their summaries.
    u
        The parameters as standard normal scores, and the deviations from the laws, of each draw, shape (chain, draw,
        K), as in `Posterior.u`; empty if the model assumes exact laws.

    Raises
    ------
    Refusal
        If there is no fit, or the sampler cannot work on it.
    """
    law = fit.law
    if law is not None and sampler == TEMPERED:
        drawn, u = sample_motions(law, settings.chains, settings.draws, settings.seed)
        return law.with_parts_of_sds(drawn), u
    drawn = SAMPLERS.get(sampler).sample_and_summarise(*fit.engine, settings)
    if law is None:
        return drawn, NO_DRAWS[0]
    return law.with_parts_of_sds(drawn), law.draw_deviations(drawn.draws, settings.seed)


EXACT_METHOD, LINEAR, LAPLACE = "bridge", "linear", "laplace"
"""Names of evidence methods. `EXACT_METHOD` is the default for a model that assumes exact laws. If a model allows
deviations from its laws, "linear" and "laplace" are two names of the same method, the linear approximation."""
FROM_DRAWS = "nuts"
"""The only sampler whose draws an evidence method (bridge) can use; draws of other samplers are thinned or weighted."""


@dataclass(frozen=True, repr=False)
class Evidence(Result, types.Evidence):
    """The log marginal likelihood of a model on a record, in nats.

    The evidence depends on the priors. Compare the evidence of two models only on the same record in the same unit.

    Attributes
    ----------
    model, method
        Names of the model and of the evidence method.
    log_evidence, stderr
        The log evidence and its standard error in nats; NaN if the method does not compute it.
    diagnostic
        Diagnostic numbers of the method, in words.
    evaluations, seconds
        Number of evaluations of the likelihood, and computing time in s.
    outcome
        "ok", or a sentence that says why the value is unreliable or missing.
    signal, noise
        Names of the record and of the noise model.
    """

    signal: str = ""
    noise: str = ""

    def summary(self) -> pd.DataFrame:
        """Return a table with one row, whose columns are the fields of this class; log_evidence and stderr are in nats.

        To compare several models, concatenate their tables.
        """
        return data_frame([vars(self)])

    def _table(self) -> Table:
        title = f"Log evidence in nats of {self.model} on {self.signal} by {self.method}"
        shown = self.summary()[["log_evidence", "stderr", "diagnostic"]].T.set_axis(["value"], axis=1)
        return frame_table(shown, title, outcome_notes(self.outcome))


def evidence(source: Posterior | Fit, method: str | None = None, *, seed: int = 0) -> Evidence:
    """Compute the evidence (marginal likelihood) of a model on a record, from its fit or its posterior.

    If the model allows deviations of damping and restoring force from their laws, the default method is "smc"
    (sequential Monte Carlo), which uses the full equation of motion. A posterior that "smc" sampled already contains
    this evidence. The method "linear" (or "laplace") linearises the motion about the best fit; it needs no sampling,
    and has no standard error. "importance", "bridge" and "nested" linearise the motion in the deviations only, and
    integrate these out. The noise variance is estimated under the model's restoring law. Therefore compare the evidence
    of models with different restoring laws only if the noise is known; otherwise use `compare`.

    Parameters
    ----------
    source
        A fit or a posterior. Only the methods bridge and smc need draws: bridge uses those of the sampler "nuts", smc
        those of the sampler "smc". If `source` does not contain such draws, they are sampled here.
    method
        A name in `bayesdamp.inference.evidence.EVIDENCES`: bridge (the default if the model assumes exact laws),
        importance, nested or laplace. If the model allows deviations from its laws, also smc (then the default) or
        linear.
    seed
        Seed of all random numbers.

    Returns
    -------
    Evidence
        The evidence. If it cannot be computed, its outcome is a sentence with the reason.

    Raises
    ------
    InputError
        If an argument is invalid.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> fit = bd.fit(signal, model)
    >>> bd.evidence(fit, "laplace").outcome
    'ok'
    """
    posterior = source if isinstance(source, Posterior) else None
    fit = source.fit if isinstance(source, Posterior) else source
    approximate = fit.model.approximate
    method = method or (TEMPERED if approximate else EXACT_METHOD)
    blank = Evidence(fit.model.name, method, signal=fit.signal.name, noise=fit.noise)
    if fit.outcome != types.OK:
        return replace(blank, outcome=fit.outcome)
    if approximate and method == TEMPERED:
        if posterior is None or posterior.sampler != TEMPERED:
            posterior = sample(fit, seed=seed)
        runs = posterior.stats["temperatures"][:, 0]
        return replace(
            blank,
            log_evidence=posterior.log_evidence,
            stderr=posterior.stderr,
            diagnostic=f"{runs.size} runs with at most {runs.max()} temperature{'s' if runs.max() > 1 else ''}",
            evaluations=posterior.evaluations,
            seconds=posterior.seconds,
            outcome=posterior.outcome,
        )
    own = LAPLACE if approximate and method == LINEAR else method
    draws, outcome = None, types.OK
    if posterior is not None and posterior.sampler == FROM_DRAWS and posterior.names:
        draws, outcome = posterior.draws, posterior.outcome
    try:
        result = run_evidence_method(fit, own, seed, draws, outcome)
    except types.Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return Evidence(**{**vars(result), "method": method}, signal=blank.signal, noise=blank.noise)


def run_evidence_method(
    fit: Fit, method: str, seed: int, draws: Array | None = None, outcome: str = types.OK
) -> types.Evidence:
    """Compute the evidence of a fitted model by one method in `EVIDENCES`.

    `evidence` and the tasks of a study call this function.

    Parameters
    ----------
    fit
        The fit.
    method
        A name in `EVIDENCES`.
    seed
        Seed of all random numbers.
    draws
        Draws of the sampler "nuts" in natural units, shape (chain, draw, parameter), for methods that need draws
        (bridge); other methods ignore them. If None, such a method samples its own draws.
    outcome
        Outcome of the sampler with these draws: "ok", or a sentence that says why they are unreliable. It has no effect
        without draws.

    Raises
    ------
    Refusal
        If nothing was fitted, or the method cannot be applied to this fit.
    """
    plugin, (target, mode) = EVIDENCES.get(method), fit.engine
    given = Draws.of(target, draws, outcome) if plugin.needs_draws and draws is not None else None
    return plugin.timed(fit.model.name, target, mode, seed, given)
