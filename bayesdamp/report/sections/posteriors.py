"""Show the posteriors, the running estimates of the damping, and the starting points of searches and chains."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import draw_running_estimates, marginals, pairs
from bayesdamp.report.results.run import Row, RunFolder, coefficients, mode_of, models_by_rank, rows_of, truth
from bayesdamp.report.sections import SignalSection, by_model, collapsible, is_drawn, repeat_column
from bayesdamp.store.contents import ModeContent, PosteriorContent, SearchContent
from bayesdamp.types import OK, ChainStart, Seed

COLUMNS: dict[str, Callable[[Row], str]] = {
    "parameter": lambda r: words.symbol(r["parameter"]).text,
    "unit": lambda r: words.unit(r["unit"]),
    "sampler": lambda r: words.method(r["sampler"]),
    "mean ± sd": lambda r: fmt.with_error(r["mean"], r["sd"]),
    "95 % interval": lambda r: fmt.interval(r["q2.5"], r["q97.5"]),
}
"""Columns of the tables of parameters, each with a function that writes the cell of a row of posteriors.csv."""
MAX_CHAIN_SHIFT = 0.1
"""Largest difference of a chain's mean from the mean of all chains that is not marked, in posterior sds (conventional).
It only marks rows of a table; convergence is judged by R̂."""
LEAST_SHARE = 1e-3
"""A lower maximum is shown with its fraction of the posterior if this is larger."""
PASSES = ("restarted/mean", "restarted/sd", "online/mean")
"""Arrays of a Kalman filter's running estimates: mean and sd in the last pass, and mean in the first pass."""
TABLE = (
    "Parameters, and quantities derived from them: mean, standard deviation (sd) and 95 % interval of the posterior, "
    "with the diagnostics of the sampler. The draws are reliable if R̂ ≤ 1.01, the effective sample sizes (ESS) are at "
    "least 400, and no transition diverged; rows for which one of these fails are coloured. The equivalent damping "
    "ratio, the decrement, the damping capacity and the energy lost in a cycle are at the reference amplitude, from "
    "which the half-life starts. The reference amplitude is that of the record unless the study states another one. "
    "The logarithmic decrement is the decrease of ln A in a cycle, where A is the amplitude; if it is "
    "small, it is 2π times the damping ratio. Rows without R̂ are not from chains: they are from the answer's "
    "sequential Monte Carlo, or from an approximation, whose ESS is that of importance weights."
)
CHAINS = (
    "the starting point of each chain, its distance from the mode before and after it was moved, and the largest "
    "difference between the mean of a parameter in this chain and in all chains; all in posterior standard deviations "
    f"(sd). Rows with a difference of means above {MAX_CHAIN_SHIFT:g} are coloured."
)
REPEATS = (
    "Damping coefficients in each repeat: mean, standard deviation (sd) and 95 % interval of the posterior, whether "
    "this interval contains the true value, and whether the sampler's draws are reliable."
)
SEARCHES = (
    "Searches for the mode: how far the log posterior at the starting point and at the end of the search is below its "
    "maximum (nats), and how far the starting point is from the mode in posterior standard deviations (sds). Grey rows "
    "ended in another maximum, which the chains did not sample; coloured rows in none."
)
"""Captions, or parts of them, that do not depend on the run."""


class PosteriorsSection(SignalSection):
    """The section with every model's posterior and the samplers' diagnostics. Only the best model is expanded."""

    order = 50
    name = "posteriors"
    title = "The posteriors"
    draws_models = True
    lead = "If a record has several repeats, the figures and the first table of each model show repeat 1."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether posteriors were sampled on a signal."""
        return any(r["signal"] == signal for r in run.posteriors) or bool(
            run.task_results("posterior", signal)
        )

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return figures of the marginal posteriors, and tables of parameters and derived quantities, by model.

        All models with posteriors have tables; only the most probable ones (`is_drawn`) have figures. If there are
        several repeats, figures and tables are of the first one, and a further table lists the coefficients of all.
        """
        repeats = run.repeats(signal)

        def inside(r: Row) -> str:
            true = truth(run, signal, r["parameter"])
            if not (math.isfinite(true) and math.isfinite(r["q2.5"])):
                return fmt.NONE
            return "inside" if r["q2.5"] <= true <= r["q97.5"] else "outside"

        columns: dict[str, Callable[[Row], str]] = {
            **repeat_column(repeats),
            **COLUMNS,
            "truth": inside,
            "outcome": lambda r: r["outcome"],
        }
        models: dict[str, list[object]] = {}
        for place, model in enumerate(models_by_rank(run, signal, repeats[0])):
            content: list[object] = []
            if is_drawn(run, place):
                content += _figures(run, signal, repeats[0], model)
            content += _tables(run, signal, repeats[0], model)
            if content and len(repeats) > 1:
                rows, names = rows_of(run.posteriors, signal=signal, model=model), coefficients(run, model)
                rows = [r for r in rows if r["parameter"] in names]
                table = Table.of(rows, columns, (1, 2, 3, 6, 7), REPEATS)
                content.append(collapsible(f"All {len(repeats)} repeats", table))
            models[model] = content
        return by_model(models)


def _figures(run: RunFolder, signal: str, repeat: int, model: str) -> list[Markup]:
    """Return figures of the marginal posteriors and of pairs of damping coefficients.

    Samplers with draws that are not finite are left out.
    """
    draws: dict[str, dict[str, np.ndarray]] = {}
    units = {r["parameter"]: r["unit"] for r in rows_of(run.posteriors, signal=signal, model=model)}
    for task_result in sorted(
        run.task_results("posterior", signal, repeat, model), key=lambda c: c.parts.method != "nuts"
    ):
        array = task_result.arrays.get("draws")
        content = PosteriorContent.of(task_result)
        names = content.posterior.names
        if array is None or array.ndim != 3 or array.shape[2] != len(names) or not np.isfinite(array).all():
            continue
        draws[task_result.parts.method] = {name: array[:, :, i] for i, name in enumerate(names)}
        units = {**content.units, **units}
    if not draws:
        return []
    true = {name: truth(run, signal, name) for own in draws.values() for name in own}
    samplers = fmt.listing(map(words.method, draws))
    caption = (
        f"Marginal posterior density of each parameter of {words.model(model)} damping, from the record {signal}, by "
        f"{samplers}. Each curve is scaled to a maximum of 1."
    )
    if any(math.isfinite(value) for value in true.values()):
        caption += " Dashed lines: the true values."
    damping = coefficients(run, model)
    draw = partial(marginals, model, draws, units, true, damping)
    figures = [run.drawings.add(f"marginals-{signal}-{model}", caption, draw)]
    names = [n for n in damping if all(n in own for own in draws.values())]
    if len(names) > 1:
        caption = (
            f"Joint posterior of each pair of coefficients of {words.model(model)} damping, from the record {signal}: "
            "the contours contain 50 % and 90 % of the probability. On the diagonal: the marginal density of each "
            "coefficient."
        )
        draw = partial(pairs, model, names, draws, units, {n: true[n] for n in names})
        figures.append(run.drawings.add(f"pairs-{signal}-{model}", caption, draw))
    return figures


def _tables(run: RunFolder, signal: str, repeat: int, model: str) -> list[Table | Markup]:
    """Return a table of the parameters by each sampler, and sentences on what is missing or unreliable."""
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    if not rows:
        return []
    sampled = [r for r in rows if math.isfinite(r["mean"])]
    parts: list[Table | Markup] = []

    def kind(r: Row) -> str:
        poor = r["rhat"] > 1.01 or r["ess_bulk"] < 400 or r["ess_tail"] < 400 or bool(r["divergences"])
        return "alert" if poor else ""

    if sampled:
        order = [r["parameter"] for r in sampled]
        columns = dict(COLUMNS)
        if any(math.isfinite(truth(run, signal, r["parameter"])) for r in sampled):
            columns["truth"] = lambda r: fmt.as_entered(truth(run, signal, r["parameter"]))
        columns |= {
            "R̂": lambda r: fmt.fixed_decimals(r["rhat"], 3),
            "ESS bulk": lambda r: fmt.fixed_decimals(r["ess_bulk"], 0),
            "ESS tail": lambda r: fmt.fixed_decimals(r["ess_tail"], 0),
            "divergences": lambda r: fmt.NONE if r["divergences"] is None else str(r["divergences"]),
        }
        sampled.sort(key=lambda r: order.index(r["parameter"]))
        caption = f"Record {signal}, {words.model(model)} damping. {TABLE}"
        parts.append(Table.of(sampled, columns, (0, 1, 2), caption, kind))
    sentences = {(r["sampler"], r["outcome"]) for r in rows if r["outcome"] != OK}
    for task_result in run.task_results("posterior", signal, repeat, model):
        without = PosteriorContent.of(task_result).without
        if without:
            names = fmt.listing(words.symbol(n).text for n in without)
            why = f"for {max(without.values())} draws they do not exist (no stable equilibrium, or unbounded motion)"
            sentences.add((task_result.parts.method, f"{names} are not shown, because {why}."))
    for sampler, sentence in sorted(sentences):
        parts.append(Markup('<p class="quiet">{}: {}</p>').format(words.method(sampler), sentence))
    return parts


class RunningSection(SignalSection):
    """The section with a Kalman filter's running estimate of each damping coefficient against time."""

    order = 55
    name = "running"
    title = "The damping estimate during the record"
    draws_models = True
    lead = (
        "The damping coefficients as a Kalman filter estimates them after each sample. The first pass of the filter "
        "uses every sample once. Each further pass starts from the same priors and linearises the motion about the "
        "result of the pass before."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether a Kalman filter ran on the record."""
        return any("running/t" in task_result.arrays for task_result in run.task_results("posterior", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return figures of the estimated damping coefficients against time, with bands of ± 2 standard deviations."""
        repeat = run.repeats(signal)[0]
        models: dict[str, list[object]] = {}
        for place, model in enumerate(models_by_rank(run, signal, repeat)):
            results = run.task_results("posterior", signal, repeat, model) if is_drawn(run, place) else ()
            for task_result in results:
                if "running/t" not in task_result.arrays:
                    continue
                content = PosteriorContent.of(task_result)
                listed, arrays = content.posterior.running, task_result.arrays
                estimates = {
                    n: [arrays[f"running/{part}"][:, listed.index(n)] for part in PASSES]
                    for n in coefficients(run, model)
                    if n in listed
                }
                true = {n: truth(run, signal, n) for n in estimates}
                draw = partial(
                    draw_running_estimates, model, arrays["running/t"], estimates, content.units, true
                )
                caption = (
                    f"Coefficients of {words.model(model)} damping as estimated by "
                    f"{words.method(task_result.parts.method)} from the part of the record {signal} up to each time: "
                    "mean (solid line) ± 2 standard deviations (band) in the last pass, and mean in the first pass "
                    "(dashed line)."
                )
                models.setdefault(model, []).append(
                    run.drawings.add(f"running-{signal}-{model}", caption, draw)
                )
        return by_model(models)


class SeedsSection(SignalSection):
    """The section with the searches for the mode and the chains, by their starting points."""

    order = 57
    name = "seeds"
    title = "Starting points of the searches and chains"
    lead = (
        "To find the mode of the posterior, an optimisation (Levenberg–Marquardt) starts at every estimator's values, "
        "at each of their stages, and at a few draws from the prior. The chains start from the same points, with a "
        "scatter that is larger than the posterior's width. A starting point that is too far away for a chain is moved "
        "towards the mode."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether modes were searched for."""
        return any(c.outcome == OK and ModeContent.of(c).climbs for c in run.task_results("mode", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return tables of the searches and chains of each model, the most probable models first."""
        repeat = run.repeats(signal)[0]
        models: dict[str, list[object]] = {}

        def kind(s: tuple[int, ChainStart]) -> str:
            return "alert" if s[1].shift > MAX_CHAIN_SHIFT else ""

        columns: dict[str, Callable[[tuple[int, ChainStart]], str]] = {
            "chain": lambda s: str(s[0]),
            "starting point": lambda s: _listing([s[1].seed]),
            "distance from the mode / sd": lambda s: fmt.number(s[1].seed_distance, 3),
            "after moving it / sd": lambda s: fmt.number(s[1].distance, 2),
            "difference of the means / sd": lambda s: fmt.fixed_decimals(s[1].shift, 2),
        }
        for model in models_by_rank(run, signal, repeat):
            mode = mode_of(run, signal, repeat, model)
            if mode is None or not mode.climbs:
                continue
            models[model] = [_searches(mode)]
            for task_result in run.task_results("posterior", signal, repeat, model):
                starts = PosteriorContent.of(task_result).posterior.starts
                if starts:
                    caption = f"Chains of {words.method(task_result.parts.method)}: {CHAINS}"
                    models[model].append(Table.of(enumerate(starts, 1), columns, (0, 1), caption, kind))
        return by_model(models)


def _listing(seeds: Iterable[Seed]) -> str:
    """Return a list of starting points in words, such as "least squares (trajectory fit) and draw from the prior".

    Each is described by its source (for example an estimator), the stage of the estimator if it has one, and whether
    it was refined on a window that grew from the first cycles to the whole record.
    """
    names = []
    for seed in seeds:
        details = [words.stage(seed.stage)] if seed.stage else []
        details += ["over growing windows"] if seed.grown else []
        names.append(words.method(seed.source) + (f" ({', '.join(details)})" if details else ""))
    return fmt.listing(names)


def _searches(mode: ModeContent) -> Table:
    """Return a table of the searches: start and end relative to the mode (nats, sds), and likelihood evaluations."""

    def ended(c: SearchContent) -> str:
        if c.mode is None:
            return "no maximum"
        share = mode.modes[c.mode].share if c.mode < len(mode.modes) else math.nan
        shown = f" ({fmt.percentage(share)} % of the posterior)" if share > LEAST_SHARE else ""
        return f"maximum {c.mode + 1}{shown}" if c.mode else "the mode"

    def kind(c: SearchContent) -> str:
        return "alert" if c.mode is None else "quiet" if c.mode else ""

    columns: dict[str, Callable[[SearchContent], str]] = {
        "starting point": lambda c: _listing((c.seed, *c.same)),
        "start: nats below the mode": lambda c: fmt.number(mode.log_posterior - c.start, 3),
        "start: sds from the mode": lambda c: fmt.number(c.distance, 3),
        "likelihood evaluations": lambda c: str(c.evaluations),
        "ended in": ended,
        "end: nats below the mode": lambda c: fmt.nats(max(mode.log_posterior - c.end, 0.0)),
    }
    touching = fmt.listing(words.symbol(n).text for n in mode.touching_zero)
    notes = (
        [f"Coefficients less than one sd above zero at the mode, which may be zero: {touching}."]
        if touching
        else []
    )
    return replace(Table.of(mode.climbs, columns, (0, 4), SEARCHES, kind), notes=notes)


PLUGINS = (PosteriorsSection(), RunningSection(), SeedsSection())
