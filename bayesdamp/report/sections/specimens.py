"""Many records: repeats of one specimen together, and specimens beside each other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import Interval, Panel, intervals
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.specimens import (
    capped,
    joint_cells,
    joint_sentence,
    population_cell,
    population_sentence,
    size,
)
from bayesdamp.report.sections._section import Section
from bayesdamp.report.style import colour
from bayesdamp.store import CellResult
from bayesdamp.store.contents.many import JointContent, PopulationContent
from bayesdamp.table import Line, Table
from bayesdamp.types import OK, summed

_HOW = (
    "The records share one damping model with one set of coefficients for the specimen. In each record all "
    "coefficients are larger or smaller by a common factor, whose spread from record to record is inferred. The start, "
    "the restoring law's parameters, the angle at rest (an encoder may be offset) and the noise belong to each record."
)
_LAWS = {
    "none": "Every law is taken to hold exactly, so that the interval of a coefficient covers the noise and the "
    "spread between records, but no deviation from the laws.",
    "law": "How much the damping and the restoring force deviate from their laws along a record belongs to that record "
    "and is integrated out; the sizes of these deviations are common to all records.",
}


class Specimens(Section):
    """Of each specimen with several records its joint fit; over several specimens their population."""

    order = 13
    name = "specimens"
    title = "Many records"

    def applies(self, run: Run) -> bool:
        """Where a specimen has several records, or there are several specimens."""
        return bool(joint_cells(run)) or population_cell(run) is not None

    def render(self, run: Run) -> str:
        """Joint fits beside each record alone, and the population."""
        parts: list[object] = [_text(_HOW)] if joint_cells(run) else []
        for name, cell in joint_cells(run).items():
            parts += [Markup("<h3>{}</h3>").format(f"Repeats of {name}"), *_joint(run, name, cell)]
        cell = population_cell(run)
        if cell is not None:
            parts += [Markup("<h3>Over the specimens</h3>"), *_population(run, cell)]
        return stack(*parts)


def _text(*said: str) -> Markup:
    return paragraph(" ".join(said))


def _interval(one: Mapping[str, float]) -> Interval:
    return one["q2.5"], one["median"], one["q97.5"]


def _joint(run: Run, name: str, cell: CellResult) -> list[object]:
    said = joint_sentence(run, cell)
    joint = JointContent.maybe(cell)
    if joint is None:
        return [_text(said[:1].upper() + said[1:])]
    best, row = joint.best, joint.candidates[joint.best]
    parts: list[object] = [
        _text(said[:1].upper() + said[1:]),
        _text(_LAWS[joint.deviation]),
        *([_text(summed)] if (summed := _dampings(joint)) else ()),
        _candidates(joint),
    ]
    if not joint.alone:
        return parts
    panels = [
        Panel(
            words.axis(n, row.units[n]),
            [_interval(alone.summary[n]) for alone in joint.alone.values()],
            _interval(row.summary[n]),
        )
        for n in row.summary
    ]
    caption = (
        f"{name}, {words.model(best)}: median and 95 % interval of each record by itself; grey: of the specimen, from "
        "the joint fit."
    )
    labels = list(joint.alone)
    parts.append(run.drawings.add(f"joint-{name}", caption, lambda: intervals(labels, panels, colour(best))))
    factor = fmt.nats(joint.no_spread)
    parts.append(
        _text(f"The log Bayes factor of one size in all records against sizes that differ is {factor} nats.")
    )
    return parts


def _dampings(joint: JointContent) -> str:
    """The probability of each damping, whatever the restoring law; empty where one law was compared."""
    found = summed({c: row.probability for c, row in joint.candidates.items()})
    if len(found) in (1, len(joint.candidates)):
        return ""
    shares = [f"{words.model(d)} {capped(p)}" for d, p in found.items()]
    return f"Summed over the restoring laws the probabilities are: {fmt.listing(shares)}."


def _candidates(joint: JointContent) -> Table:
    names = list(dict.fromkeys(n for r in joint.candidates.values() for n in r.summary))
    logs = {c: -np.inf if r.log_evidence is None else r.log_evidence for c, r in joint.candidates.items()}
    top = logs[joint.best]
    lines = []
    for candidate, row in sorted(joint.candidates.items(), key=lambda item: -logs[item[0]]):
        sizes = [size(row, n) if n in row.summary else fmt.NONE for n in names]
        ratio = None if row.log_evidence is None else row.log_evidence - top
        kind = "best" if candidate == joint.best else "" if row.outcome == OK else "quiet"
        share = capped(row.probability)
        lines.append(Line([words.model(candidate), share, fmt.nats(ratio), *sizes, row.outcome], kind))
    headers = ["damping model", "probability", "log Bayes factor", *(words.symbol(n).text for n in names)]
    caption = (
        "All records together: the probabilities are those of the answer on the specimen, and the coefficients are the "
        "specimen's (mean ± sd)."
    )
    return Table([*headers, "outcome"], lines, frozenset({0, len(headers)}), caption)


def _population(run: Run, cell: CellResult) -> list[object]:
    parts: list[object] = [_text(population_sentence(cell))]
    content = PopulationContent.maybe(cell)
    if content is None:
        return parts
    best, labels = content.best, list(content.specimens)
    scales = [
        f"{fmt.number(p.scale, 2)} {words.unit(content.units[n])} for {words.symbol(n).text}"
        for n, p in content.populations.items()
    ]
    behind = [f"{label} ({fmt.nats(gap)} nats)" for label, gap in content.behind.items() if gap > 1]
    how = (
        "Specimens' coefficients are taken as normal, cut off at zero; the mean and the spread are of what is "
        "left. The normal's location has a half-normal prior with the scale "
        f"{fmt.listing(scales)}, which is that of the prior which the study states, or else three times the largest "
        "coefficient of a specimen. Its width has one with the scale of the location: specimens of one kind hardly "
        "spread by more than their size. The model is the one with the greatest evidence over all specimens "
        "together."
    )
    if behind:
        how += f" Another model is ahead for {fmt.listing(behind)}."
    parts += [_text(how), _values(content)]
    panels = [
        Panel(
            words.axis(n, content.units[n]),
            [_interval(content.specimens[label].summary[n]) for label in labels],
            _interval(found.mean),
            [_interval(found.shrunk[label]) for label in labels],
        )
        for n, found in content.populations.items()
    ]
    caption = (
        "Each specimen's own median and 95 % interval (dots) and once the others have had their say (open); grey: the "
        "population's mean."
    )
    parts.append(run.drawings.add("population", caption, lambda: intervals(labels, panels, colour(best))))
    return parts


def _values(content: PopulationContent) -> Table:
    lines = []
    for name, found in content.populations.items():
        unit = words.unit(content.units[name])
        for what, one in (("mean", found.mean), ("spread", found.spread)):
            bounds = fmt.interval(one["q2.5"], one["q97.5"])
            lines.append(
                Line([f"{words.symbol(name).text}, {what}", fmt.number(one["median"], 3), bounds, unit])
            )
        for label, one in found.shrunk.items():
            cells = [f"{words.symbol(name).text} of {label}", fmt.number(one["median"], 4)]
            lines.append(Line([*cells, fmt.interval(one["q2.5"], one["q97.5"]), unit], "quiet"))
    caption = "The population's mean and spread (sd), and each specimen's value given all of them."
    return Table(["quantity", "median", "95 %", "unit"], lines, frozenset({0, 3}), caption)


PLUGIN = Specimens()
