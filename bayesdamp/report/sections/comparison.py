"""Every estimator beside the others and beside what was published."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.comparing import STAGES, Comparison, category, compared, true_models
from bayesdamp.report.results.estimates import posterior_of
from bayesdamp.report.results.reading import damping_parameters, truth
from bayesdamp.report.results.run import Row, Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.table import Line, Table
from bayesdamp.types import OK

OWN, REFINED = STAGES
FIRST = 3
"""Place in the report of a study with published figures, which was made for this comparison."""


class ComparisonSection(Section):
    """Errors and times of all methods under the model that made each record."""

    order = 35
    title = "The estimators compared"

    def place(self, run: Run) -> int:
        """Return the first place where the study's numbers are published."""
        return FIRST if run.study.get("published") else self.order

    def applies(self, run: Run) -> bool:
        """Where several methods have an error, or the study's numbers are published."""
        found = compared(run)
        many = len(found.methods) > 1 and len(found.signals) > 1 and bool(found.errors)
        return many or bool(run.study.get("published"))

    def render(self, run: Run) -> str:
        """Show errors and times in tables."""
        found = compared(run)
        if not found.errors:
            return paragraph("No estimator has an error to compare in this study.")
        return stack(paragraph(lead(found)), _errors(run, found), _times(found))


def lead(found: Comparison) -> str:
    """Return what the table of the errors says, in a sentence or two."""
    own = {key: e for key, e in found.errors.items() if key[2] == OWN}
    refined = [e for key, e in found.errors.items() if key[2] == REFINED]
    said = []
    if refined:
        said.append(
            f"After the trajectory fit every method is within {fmt.short(max(refined))} % of the truth: that fit has "
            "one optimum, whatever starts it. Methods differ in their own estimates."
        )
    if own:
        worst = max(own, key=lambda key: own[key])
        said.append(
            f"The largest error of these is {fmt.short(own[worst])} % ({words.method(worst[0])}, {worst[1]})."
        )
    return " ".join(said)


def _errors(run: Run, found: Comparison) -> Table:
    """Return errors in per cent by method and signal, with what was published and the posteriors' intervals."""
    own = ["own", "fit", *(["published"] if found.published else [])]
    groups = [("", 2), *((signal, len(own)) for signal in found.signals), ("mean", len(own))]
    lines = []
    for method in found.methods:
        cells = [words.method(method), category(method)]
        for signal in found.signals:
            for stage in STAGES:
                error = found.errors.get((method, signal, stage), math.nan)
                doubted = found.outcomes.get((method, signal, stage), OK) != OK and math.isfinite(error)
                cells.append(fmt.short(error) + ("*" if doubted else ""))
            if found.published:
                cells.append(found.published.get((method, signal), fmt.NONE))
        cells += [fmt.short(found.mean(method, stage)) for stage in STAGES]
        lines.append(Line([*cells, fmt.short(found.mean_published(method))] if found.published else cells))
    said = "Errors in per cent of the truth: the method's own estimate, then the trajectory fit that starts there"
    said += ", then what was published." if found.published else "."
    posteriors = {signal: _posterior(run, signal) for signal in found.signals} if found.published else {}
    foot: list[tuple[str, int]] = []
    if any(posteriors.values()):
        about = [(_about(run, s, row), len(own)) for s, row in posteriors.items()]
        foot = [("posterior, 95 %", 2), *about, ("", len(own))]
        said += " Last line: the posterior's 95 % interval about the truth, in per cent, from a record with noise."
    if any(o != OK for o in found.outcomes.values()):
        said += " *: the method itself doubts this answer; its sentence stands below."
    return Table(
        ["method", "category", *own * (len(found.signals) + 1)],
        lines,
        {0, 1},
        said,
        groups,
        foot,
        _values(posteriors),
    )


def _times(found: Comparison) -> Table:
    """Return the seconds of each method."""
    columns: dict[str, Callable[[str], str]] = {
        "method": words.method,
        "own estimate": lambda m: fmt.duration(found.seconds.get((m, OWN), math.nan)),
        "trajectory fit": lambda m: fmt.duration(found.seconds.get((m, REFINED), math.nan)),
    }
    if found.times:
        columns["published"] = lambda m: found.times.get(m, fmt.NONE)
    many = f"{len(found.signals)} signals" if len(found.signals) > 1 else "the signal"
    said = f"Time for {many} together, compilation included where it fell due."
    return Table.of(found.methods, columns, (0,), said)


def _posterior(run: Run, signal: str) -> Row | None:
    model = true_models(run)[signal]
    parameter = damping_parameters(run).get(model)
    return posterior_of(run, signal, model, parameter) if parameter else None


def _about(run: Run, signal: str, row: Row | None) -> str:
    value = math.nan if row is None else truth(run, signal, row["parameter"])
    if row is None or not math.isfinite(value) or not value:
        return fmt.NONE
    return " to ".join(f"{100 * (row[q] / value - 1):+.2f}".replace("-", "−") for q in ("q2.5", "q97.5"))


def _values(posteriors: Mapping[str, Row | None]) -> list[str]:
    """Return a sentence with the intervals as values."""
    said = [
        f"{words.symbol(row['parameter']).text} {row['q2.5']:.5g} to {row['q97.5']:.5g} {row['unit']} ({row['signal']})"
        for row in posteriors.values()
        if row
    ]
    return [f"95 % intervals of the posteriors: {'; '.join(said)}."] if said else []


PLUGIN = ComparisonSection()
