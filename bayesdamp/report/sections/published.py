"""What a study with published figures was made for: method by damping, beside what was printed."""

from __future__ import annotations

import math
from collections.abc import Mapping

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.comparing import STAGES, Comparison, compared, true_models
from bayesdamp.report.results.estimates import coefficient_estimates, posterior_of
from bayesdamp.report.results.reading import damping_parameters, truth
from bayesdamp.report.results.run import Row, Run
from bayesdamp.report.sections._section import Section
from bayesdamp.report.sections.against import inside, picture
from bayesdamp.table import Line, Table, symbols
from bayesdamp.types import OK

OWN, REFINED = STAGES


class PublishedSection(Section):
    """The two tables of the publication, errors and times, measured: the first thing that its study shows."""

    order = 3
    name = "published"
    title = "Method by damping"

    def applies(self, run: Run) -> bool:
        """Where a study has published numbers and errors to set beside them."""
        return bool(run.study.get("published")) and bool(compared(run).errors)

    def render(self, run: Run) -> str:
        """Measured beside published, method by method."""
        found = compared(run)
        posteriors = {s: _posterior(run, s) for s in found.signals}
        parts = [paragraph(lead(found)), errors(run, found, posteriors), times(found)]
        side_by_side = coefficient_estimates(run)
        if side_by_side:
            parts.append(picture(run, side_by_side))
            parts += [paragraph(said) for said in (inside(side_by_side),) if said]
        parts += [paragraph(symbols(line)) for line in _intervals(run, posteriors)]
        return stack(*parts)


def lead(found: Comparison) -> str:
    """What the first table says, in a sentence or two."""
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


def errors(run: Run, found: Comparison, posteriors: Mapping[str, Row | None]) -> Table:
    """Return errors in per cent by method and signal, with what was published and the posteriors' intervals.

    posteriors: of each signal the row whose interval about the truth stands in the last line.
    """
    own = ["own", "fit", *(["published"] if found.published else [])]
    groups = [("", 1), *((signal, len(own)) for signal in found.signals)]
    lines = []
    for method in found.methods:
        cells = [words.method(method)]
        for signal in found.signals:
            for stage in STAGES:
                error = found.errors.get((method, signal, stage), math.nan)
                doubted = found.outcomes.get((method, signal, stage), OK) != OK and math.isfinite(error)
                cells.append(fmt.short(error) + ("*" if doubted else ""))
            if found.published:
                cells.append(found.published.get((method, signal), fmt.NONE))
        lines.append(Line(cells))
    foot: list[tuple[str, int]] = []
    said = "Errors in per cent of the truth: the method's own estimate, then the trajectory fit that starts there"
    said += ", then what was published." if found.published else "."
    if any(posteriors.values()):
        about = ((_about(run, signal, row), len(own)) for signal, row in posteriors.items())
        foot = [("posterior, 95 %", 1), *about]
        said += " Last line: the posterior's 95 % interval about the truth, in per cent, from a record with noise."
    if any(o != OK for o in found.outcomes.values()):
        said += " *: the method itself doubts this answer; its sentence stands below."
    return Table(["method", *own * len(found.signals)], lines, {0}, said, groups, foot)


def times(found: Comparison) -> Table:
    """Seconds by method."""
    lines = []
    for method in found.methods:
        seconds = [found.seconds.get((method, stage), math.nan) for stage in STAGES]
        printed = [found.times.get(method, fmt.NONE)] if found.times else []
        lines.append(Line([words.method(method), *map(fmt.duration, seconds), *printed]))
    headers = ["method", "own estimate", "trajectory fit", *(["published"] if found.times else [])]
    many = f"{len(found.signals)} signals" if len(found.signals) > 1 else "the signal"
    said = f"Time for {many} together, compilation included where it fell due."
    return Table(headers, lines, frozenset({0}), said)


def _posterior(run: Run, signal: str) -> Row | None:
    model = true_models(run)[signal]
    parameter = damping_parameters(run).get(model)
    return posterior_of(run, signal, model, parameter) if parameter else None


def _about(run: Run, signal: str, row: Row | None) -> str:
    if row is None:
        return fmt.NONE
    value = truth(run, signal, row["parameter"])
    if not math.isfinite(value) or not value:
        return fmt.NONE
    return " to ".join(f"{100 * (row[q] / value - 1):+.2f}".replace("-", "−") for q in ("q2.5", "q97.5"))


def _intervals(run: Run, posteriors: dict[str, Row | None]) -> list[str]:
    """The intervals as values."""
    said = [_interval(row, truth(run, signal, row["parameter"])) for signal, row in posteriors.items() if row]
    return [f"95 % intervals of the posteriors: {'; '.join(said)}."] if said else []


def _interval(row: Row, value: float) -> str:
    symbol = words.symbol(row["parameter"]).text
    low, high = (f"{row[q]:.5g}" for q in ("q2.5", "q97.5"))
    return f"{symbol} {low} to {high} {row['unit']} ({row['signal']}), truth {value:g}"


PLUGIN = PublishedSection()
