"""Show the posteriors of the parameters of each model, with the diagnostics of the samplers."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import marginals, pairs
from bayesdamp.report.results.run import Row, RunFolder, coefficients, models_by_rank, rows_of, truth
from bayesdamp.report.sections import SignalSection, by_model, collapsible, is_drawn, repeat_column
from bayesdamp.store.results import PosteriorContent
from bayesdamp.types import OK

TABLE = (
    "Parameters, and quantities derived from them: mean, standard deviation (sd) and 95 % interval of the posterior, "
    "with the diagnostics of the sampler. The draws are reliable if R̂ ≤ 1.01, the effective sample sizes (ESS) are at "
    "least 400, and no transition diverged; rows for which one of these fails are coloured. The equivalent damping "
    "ratio, the decrement, the damping capacity and the energy lost in a cycle are given at the reference amplitude, "
    "and the half-life starts at it. This is the amplitude of the record, unless the study states another one. Rows "
    "without R̂ are from the answer's sequential Monte Carlo."
)


class PosteriorsSection(SignalSection):
    """The section with the posterior of each model. Only the first model is visible without a click."""

    order = 50
    title = "The posteriors"
    draws_models = True
    lead = "If a record has several repeats, the figures and the first table of each model show repeat 1."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether posteriors were sampled on a signal."""
        has_rows = any(r["signal"] == signal for r in run.posteriors)
        return has_rows or any(run.task_results("posterior", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return figures of the marginal posteriors, and tables of parameters and derived quantities, by model.

        All models with posteriors have tables; only the most probable ones (`is_drawn`) have figures. If there are
        several repeats, figures and tables are of the first one, and a further table lists the coefficients of all.
        """
        repeats = run.repeats(signal)
        models: dict[str, list[object]] = {}
        for place, model in enumerate(models_by_rank(run, signal, repeats[0])):
            content: list[object] = []
            if is_drawn(run, place):
                content += _figures(run, signal, repeats[0], model)
            content += _tables(run, signal, repeats[0], model)
            if content and len(repeats) > 1:
                rows, names = rows_of(run.posteriors, signal=signal, model=model), coefficients(run, model)
                rows = [r for r in rows if r["parameter"] in names]
                table = _table(run, signal, rows, "Damping coefficients in each repeat.", repeats)
                content.append(collapsible(f"All {len(repeats)} repeats", table))
            models[model] = content
        return by_model(models)


def _figures(run: RunFolder, signal: str, repeat: int, model: str) -> list[Markup]:
    """Return figures of the marginal posteriors and of pairs of damping coefficients.

    Samplers with draws that are not finite are left out.
    """
    draws: dict[str, dict[str, np.ndarray]] = {}
    units = {r["parameter"]: r["unit"] for r in rows_of(run.posteriors, signal=signal, model=model)}
    results = run.task_results("posterior", signal, repeat, model)
    for task_result in sorted(results, key=lambda c: c.parts.method != "nuts"):
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
        f"Histograms of the posterior draws of each inferred parameter of the model with {words.model(model)} damping "
        f"(also those of the motion and the noise), from the record “{signal}”, by {samplers}."
    )
    if any(np.isfinite(value) for value in true.values()):
        caption += " Vertical lines: the true values."
    draw = partial(marginals, model, draws, units, true)
    figures = [run.drawings.add(f"marginals-{signal}-{model}", caption, draw)]
    names = [n for n in coefficients(run, model) if all(n in own for own in draws.values())]
    if len(names) > 1:
        caption = (
            f"Posterior draws of each pair of coefficients of {words.model(model)} damping, from the record "
            f"“{signal}”. On the diagonal: a histogram of each coefficient."
        )
        draw = partial(pairs, model, names, draws, units, {n: true[n] for n in names})
        figures.append(run.drawings.add(f"pairs-{signal}-{model}", caption, draw))
    return figures


def _table(
    run: RunFolder, signal: str, rows: Sequence[Row], caption: str, repeats: Sequence[int] = ()
) -> fmt.Table:
    """Return a table of rows of posteriors.csv, with the true values if they are known.

    Rows of several `repeats` also have the number of the repeat and the outcome.
    """
    columns: dict[str, Callable[[Row], str]] = {
        **repeat_column(repeats),
        "parameter": lambda r: words.symbol(r["parameter"]).text,
        "unit": lambda r: words.unit(r["unit"]),
        "sampler": lambda r: words.method(r["sampler"]),
        "mean ± sd": lambda r: fmt.with_error(r["mean"], r["sd"]),
        "95 % interval": lambda r: fmt.interval(r["q2.5"], r["q97.5"]),
    }
    if any(np.isfinite(truth(run, signal, r["parameter"])) for r in rows):
        columns["truth"] = lambda r: fmt.digits(truth(run, signal, r["parameter"]), n=6)
    columns |= {
        "R̂": lambda r: fmt.fixed_decimals(r["rhat"], 3),
        "ESS bulk": lambda r: fmt.fixed_decimals(r["ess_bulk"], 0),
        "ESS tail": lambda r: fmt.fixed_decimals(r["ess_tail"], 0),
        "divergences": lambda r: fmt.NONE if r["divergences"] is None else str(r["divergences"]),
    }
    if len(repeats) > 1:
        columns["outcome"] = lambda r: r["outcome"]
    left = [i for i, name in enumerate(columns) if name in ("parameter", "unit", "sampler", "outcome")]

    def kind(r: Row) -> str:
        poor = r["rhat"] > 1.01 or r["ess_bulk"] < 400 or r["ess_tail"] < 400 or bool(r["divergences"])
        return "alert" if poor else ""

    return fmt.Table.of(rows, columns, left, caption, kind)


def _tables(run: RunFolder, signal: str, repeat: int, model: str) -> list[fmt.Table | Markup]:
    """Return a table of a model's parameters by sampler, and sentences on what is missing or unreliable; [] if none."""
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    if not rows:
        return []
    sampled = [r for r in rows if np.isfinite(r["mean"])]
    parts: list[fmt.Table | Markup] = []

    if sampled:
        order = [r["parameter"] for r in sampled]
        sampled.sort(key=lambda r: order.index(r["parameter"]))
        caption = f"Record “{signal}”, {words.model(model)} damping. {TABLE}"
        parts.append(_table(run, signal, sampled, caption))
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


PLUGIN = PosteriorsSection()
