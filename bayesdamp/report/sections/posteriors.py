"""The posteriors: marginals, pairs of coefficients, and the samplers' diagnostics."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import marginals, pairs
from bayesdamp.report.markup import folded
from bayesdamp.report.results.reading import coefficients, models_by_rank, truth
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.report.sections import SignalSection, by_model, is_drawn
from bayesdamp.store.contents import PosteriorContent
from bayesdamp.table import Table
from bayesdamp.types import OK

COLUMNS: dict[str, Callable[[Row], str]] = {
    "parameter": lambda r: words.symbol(r["parameter"]).text,
    "unit": lambda r: words.unit(r["unit"]),
    "sampler": lambda r: words.method(r["sampler"]),
    "mean ± sd": lambda r: fmt.with_error(r["mean"], r["sd"]),
    "95 % interval": lambda r: fmt.interval(r["q2.5"], r["q97.5"]),
}


class PosteriorsSection(SignalSection):
    """Every model's posterior, the best model open, with the diagnostics of the samplers."""

    order = 50
    title = "The posteriors"
    nothing = "No posterior was sampled in this study."

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether posteriors were sampled on a signal."""
        return any(r["signal"] == signal for r in run.posteriors) or bool(run.cells("posterior", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return marginals, pairs and derived quantities of each model."""
        repeats = run.repeats(signal)
        models: list[tuple[str, list[object]]] = []
        for place, model in enumerate(models_by_rank(run, signal, repeats[0])):
            content: list[object] = []
            if is_drawn(run, place):
                content += _figures(run, signal, repeats[0], model)
            content += _tables(run, signal, repeats[0], model)
            if content and len(repeats) > 1:
                content.append(folded(f"All {len(repeats)} repeats", _repeats(run, signal, model)))
            models += [(model, content)] if content else []
        return by_model(models, behind=f" (repeat 1 of {len(repeats)})" if len(repeats) > 1 else "")


def _figures(run: RunFolder, signal: str, repeat: int, model: str) -> list[Markup]:
    """Return the marginals and the pairs of damping coefficients, of samplers whose draws are all finite."""
    draws: dict[str, dict[str, np.ndarray]] = {}
    units = {r["parameter"]: r["unit"] for r in rows_of(run.posteriors, signal=signal, model=model)}
    for cell in sorted(run.cells("posterior", signal, repeat, model), key=lambda c: c.place.method != "nuts"):
        array = cell.arrays.get("draws")
        content = PosteriorContent.of(cell)
        names = content.posterior.names
        if array is None or array.ndim != 3 or array.shape[2] != len(names) or not np.isfinite(array).all():
            continue
        draws[cell.place.method] = {name: array[:, :, i] for i, name in enumerate(names)}
        units = {**content.units, **units}
    if not draws:
        return []
    true = {name: truth(run, signal, name) for own in draws.values() for name in own}
    samplers = fmt.listing(map(words.method, draws))
    caption = f"{signal}, {words.model(model)}: marginal posterior of each parameter by {samplers}."
    damping = coefficients(run, model)
    draw = partial(marginals, model, draws, units, true, damping)
    figures = [run.drawings.add(f"marginals-{signal}-{model}", caption, draw)]
    names = [n for n in damping if all(n in own for own in draws.values())]
    if len(names) > 1:
        caption = f"{signal}, {words.model(model)}: pairs of damping coefficients; the contours contain 50 % and 90 %."
        draw = partial(pairs, model, names, draws, units, {n: true[n] for n in names})
        figures.append(run.drawings.add(f"pairs-{signal}-{model}", caption, draw))
    return figures


def _tables(run: RunFolder, signal: str, repeat: int, model: str) -> list[Table | Markup]:
    """Return the parameters by each sampler, and why others have none."""
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
            columns["truth"] = lambda r: fmt.given(truth(run, signal, r["parameter"]))
        columns |= {
            "R̂": lambda r: fmt.fixed(r["rhat"], 3),
            "ESS bulk": lambda r: fmt.fixed(r["ess_bulk"], 0),
            "ESS tail": lambda r: fmt.fixed(r["ess_tail"], 0),
            "divergences": lambda r: fmt.NONE if r["divergences"] is None else str(r["divergences"]),
        }
        caption = (
            "Reliable if R̂ ≤ 1.01 and the effective sample sizes (ESS) are at least 400. Equivalent damping ratio, "
            "decrement and capacity are at the reference amplitude. The decrement is the decrease of ln A in a cycle, "
            "which is 2π times the ratio if both are small."
        )
        if any(math.isnan(r["rhat"]) for r in sampled):
            caption += (
                " Without R̂: independent draws from an approximation, with the ESS of importance weights."
            )
        sampled.sort(key=lambda r: order.index(r["parameter"]))
        parts.append(Table.of(sampled, columns, (0, 1, 2), caption, kind))
    sentences = {(r["sampler"], r["outcome"]) for r in rows if r["outcome"] != OK}
    for cell in run.cells("posterior", signal, repeat, model):
        without = PosteriorContent.of(cell).without
        if without:
            names = fmt.listing(words.symbol(n).text for n in without)
            why = f"{max(without.values())} draws have no such motion (no stable equilibrium, or an escape)"
            sentences.add((cell.place.method, f"{names} not shown: {why}"))
    for sampler, sentence in sorted(sentences):
        parts.append(Markup('<p class="quiet">{}: {}</p>').format(words.method(sampler), sentence))
    return parts


def _repeats(run: RunFolder, signal: str, model: str) -> Table:
    """Return the damping coefficients in all repeats."""

    def inside(r: Row) -> str:
        true = truth(run, signal, r["parameter"])
        if not (math.isfinite(true) and math.isfinite(r["q2.5"])):
            return fmt.NONE
        return "inside" if r["q2.5"] <= true <= r["q97.5"] else "outside"

    columns: dict[str, Callable[[Row], str]] = {
        "repeat": lambda r: str(r["repeat"] + 1),
        **COLUMNS,
        "truth": inside,
        "outcome": lambda r: r["outcome"],
    }
    names = coefficients(run, model)
    rows = [r for r in rows_of(run.posteriors, signal=signal, model=model) if r["parameter"] in names]
    return Table.of(rows, columns, (1, 2, 3, 6, 7))


PLUGIN = PosteriorsSection()
