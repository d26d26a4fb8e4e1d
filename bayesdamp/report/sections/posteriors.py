"""The posteriors: marginals, pairs of coefficients, and the samplers' diagnostics."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import marginals, pairs
from bayesdamp.report.html import folded
from bayesdamp.report.results.reading import coefficients, models_by_rank, truth
from bayesdamp.report.results.run import Row, Run, rows_of
from bayesdamp.report.sections._layout import SignalSection, by_model, drawn
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


class Posteriors(SignalSection):
    """Every model's posterior, the best model open; a table says whether the samplers may be trusted."""

    order = 50
    title = "The posteriors"
    nothing = "No posterior was sampled in this study."

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether candidates were sampled on a signal."""
        return any(r["signal"] == signal for r in run.posteriors) or bool(run.cells("posterior", signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return marginals, pairs and what follows from them, candidate by candidate."""
        repeats = run.repeats(signal)
        models: list[tuple[str, list[object]]] = []
        for place, model in enumerate(models_by_rank(run, signal, repeats[0])):
            content: list[object] = [*_figures(run, signal, repeats[0], model)] if drawn(run, place) else []
            content += _tables(run, signal, repeats[0], model)
            if content and len(repeats) > 1:
                content.append(folded(f"All {len(repeats)} repeats", _repeats(run, signal, model)))
            models += [(model, content)] if content else []
        return by_model(models, behind=f" (repeat 1 of {len(repeats)})" if len(repeats) > 1 else "")


def _figures(run: Run, signal: str, repeat: int, model: str) -> list[Markup]:
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
    true = {name: truth(run, signal, name) for found in draws.values() for name in found}
    who = fmt.listing(map(words.method, draws))
    caption = f"{signal}, {words.model(model)}: marginal posterior of each parameter by {who}."
    damping = coefficients(run, model)
    figures = [
        run.drawings.add(
            f"marginals-{signal}-{model}", caption, lambda: marginals(model, draws, units, true, damping)
        )
    ]
    names = [n for n in damping if all(n in found for found in draws.values())]
    if len(names) > 1:
        caption = (
            f"{signal}, {words.model(model)}: damping coefficients in pairs; contours hold 50 % and 90 %."
        )
        chosen = {n: true[n] for n in names}
        figures.append(
            run.drawings.add(
                f"pairs-{signal}-{model}", caption, lambda: pairs(model, names, draws, units, chosen)
            )
        )
    return figures


def _tables(run: Run, signal: str, repeat: int, model: str) -> list[Table | Markup]:
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    if not rows:
        return []
    good = [r for r in rows if math.isfinite(r["mean"])]
    order = [r["parameter"] for r in good]
    sentences = {(r["sampler"], r["outcome"]) for r in rows if r["outcome"] != OK}
    parts: list[Table | Markup] = []
    if good:
        columns = dict(COLUMNS)
        if any(math.isfinite(truth(run, signal, r["parameter"])) for r in good):
            columns["truth"] = lambda r: fmt.given(truth(run, signal, r["parameter"]))
        columns |= {
            "R̂": lambda r: fmt.fixed(r["rhat"], 3),
            "ESS bulk": lambda r: fmt.fixed(r["ess_bulk"], 0),
            "ESS tail": lambda r: fmt.fixed(r["ess_tail"], 0),
            "divergences": lambda r: fmt.NONE if r["divergences"] is None else str(r["divergences"]),
        }
        caption = (
            "To be trusted: R̂ ≤ 1.01 and effective sample sizes (ESS) of 400 and more. Equivalent damping ratio, "
            "decrement and capacity are those at the reference amplitude; the decrement is the fall of ln A in a "
            "cycle, 2π times the ratio where both are small."
        )
        if any(math.isnan(r["rhat"]) for r in good):
            caption += " Without R̂: independent draws of an approximation, their ESS by importance weights."
        parts.append(
            Table.of(
                sorted(good, key=lambda r: order.index(r["parameter"])), columns, (0, 1, 2), caption, _kind
            )
        )
    sentences |= _left_out(run, signal, repeat, model)
    parts += [
        Markup('<p class="quiet">{}: {}</p>').format(words.method(sampler), outcome)
        for sampler, outcome in sorted(sentences)
    ]
    return parts


def _left_out(run: Run, signal: str, repeat: int, model: str) -> set[tuple[str, str]]:
    """By sampler, which derived quantities are not shown because some draws have none."""
    found = set()
    for cell in run.cells("posterior", signal, repeat, model):
        without = PosteriorContent.of(cell).without
        if without:
            names = fmt.listing(words.symbol(n).text for n in without)
            draws = max(without.values())
            said = f"no {names}: {draws} draws have no such motion (no stable equilibrium, or an escape)"
            found.add((cell.place.method, said))
    return found


def _kind(r: Row) -> str:
    """Mark what is not to be trusted by its diagnostics."""
    poor = r["rhat"] > 1.01 or r["ess_bulk"] < 400 or r["ess_tail"] < 400 or bool(r["divergences"])
    return "alert" if poor else ""


def _repeats(run: Run, signal: str, model: str) -> Table:
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
    wanted = coefficients(run, model)
    rows = [r for r in rows_of(run.posteriors, signal=signal, model=model) if r["parameter"] in wanted]
    return Table.of(rows, columns, (1, 2, 3, 6, 7))


PLUGIN = Posteriors()
