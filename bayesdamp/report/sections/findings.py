"""What methods found besides the coefficients: terms, expressions, eigenvalues, forces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.estimators import eigenvalues, force
from bayesdamp.report.html import folded, stack
from bayesdamp.report.results.comparing import true_models
from bayesdamp.report.results.reading import models_by_rank
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.store.contents.estimates import EstimateContent
from bayesdamp.table import Line, Table

Details = Mapping[str, Any]
TOLD = {
    "selected", "coefficients", "chosen", "pareto_chosen", "pareto_length", "pareto_error", "pareto_expression",
    "path_threshold", "path_terms", "path_score",
}  # fmt: skip
"""Details that stand in tables of their own, or are steps on the way to them."""


class Findings(SignalSection):
    """For each signal, under the model that made it or else the best one."""

    order = 42
    name = "findings"
    title = "What the methods found besides"

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether a method left more than coefficients."""
        return bool(_found(run, signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return learnt forces, eigenvalues, selected terms and Pareto fronts."""
        return _one(run, signal)


def _model(run: Run, signal: str) -> str:
    ranked = models_by_rank(run, signal, run.repeats(signal)[0])
    return true_models(run).get(signal) or (ranked[0] if ranked else "")


def _found(run: Run, signal: str) -> dict[str, Details]:
    """Method to the details of its own estimate."""
    found = {}
    for cell in run.cells("estimate", signal, run.repeats(signal)[0], _model(run, signal)):
        for stage in EstimateContent.of(cell).stages:
            if stage.details:
                found[cell.place.method] = stage.details
    return found


def _one(run: Run, signal: str) -> Markup:
    model, found = _model(run, signal), _found(run, signal)
    unit = run.unit(signal).base
    parts: list[object] = []
    chosen = [Line([words.method(m), _terms(d)]) for m, d in found.items() if "selected" in d]
    chosen += [Line([words.method(m), str(d["chosen"])]) for m, d in found.items() if "chosen" in d]
    if chosen:
        said = "Structure by itself: the terms that a sparse regression kept, the expression that was bred."
        parts.append(Table(["method", "damping found"], chosen, frozenset({0, 1}), said))
    for method, details in found.items():
        if "pareto_expression" in details:
            parts.append(folded(f"The Pareto front of {words.method(method)}", _front(details)))
        drawing = _drawn(run, signal, model, method, details, unit)
        if drawing is not None:
            parts.append(drawing)
        rest = [Line([k.replace("_", " "), _plain(v)]) for k, v in details.items() if _is_plain(k, v)]
        if rest:
            parts.append(
                folded(f"Settings that {words.method(method)} took", Table(["", ""], rest, frozenset({0, 1})))
            )
    return stack(*parts)


def _terms(details: Details) -> str:
    pairs = zip(details["selected"], details.get("coefficients") or [math.nan] * len(details["selected"]))
    return " + ".join(f"{fmt.number(c, 4)}·{name}" for name, c in pairs) or "none"


def _front(details: Details) -> Table:
    front = zip(details["pareto_length"], details["pareto_error"], details["pareto_expression"])
    lines = [
        Line(
            [str(length), fmt.number(error, 3), text],
            "best" if i == details.get("pareto_chosen") else "",
        )
        for i, (length, error, text) in enumerate(front)
    ]
    return Table(["length", "relative error", "expression"], lines, frozenset({2}))


def _drawn(run: Run, signal: str, model: str, method: str, details: Details, unit: str) -> Markup | None:
    name = f"{method}-{signal}-{model}"
    if {"generator_eigenvalues_re", "generator_eigenvalues_im"} <= set(details):
        real, imaginary = details["generator_eigenvalues_re"], details["generator_eigenvalues_im"]
        said = f"{signal}: eigenvalues of the generator that {words.method(method)} found."
        return run.drawings.add(f"eigenvalues-{name}", said, lambda: eigenvalues(real, imaginary, model))
    if {"velocity", "force", "law"} <= set(details):
        velocity, learnt, law = (details[k] for k in ("velocity", "force", "law"))
        said = f"{signal}: the damping force that the {words.method(method)} learnt, and the law it is projected on."
        return run.drawings.add(f"force-{name}", said, lambda: force(velocity, learnt, law, model, unit))
    return None


def _is_plain(name: str, value: object) -> bool:
    short = isinstance(value, list) and len(value) <= 3
    return name not in TOLD and (isinstance(value, (str, int, float)) or short)


def _plain(value: object) -> str:
    if isinstance(value, list):
        return fmt.listing(_plain(v) for v in value)
    return fmt.number(value, 4) if isinstance(value, float) else str(value)


PLUGIN = Findings()
