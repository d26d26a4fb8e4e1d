"""Many records: repeats of one specimen together, and specimens beside each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Fitting, fitting_of
from bayesdamp.report import words
from bayesdamp.report.figures.posterior import Interval, Panel, intervals
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.sections._layout import Section
from bayesdamp.report.style import colour
from bayesdamp.store import CellResult
from bayesdamp.store.contents import JointCandidate, JointContent, PopulationContent, Weighing
from bayesdamp.table import Line, Table
from bayesdamp.types import OK
from bayesdamp.verdict.thresholds import CAP

WORTH = 0.01
"""Probability from which a form of damping is named that the study does not compare."""
HOW = (
    "The records share one damping model with one set of coefficients for the specimen. In each record all "
    "coefficients are larger or smaller by a common factor, whose spread from record to record is inferred. The start, "
    "the restoring law's parameters, the angle at rest (an encoder may be offset) and the noise belong to each record."
)
LAWS = {
    "none": "Every law is taken to hold exactly, so that the interval of a coefficient covers the noise and the "
    "spread between records, but no deviation from the laws.",
    "law": "How much the damping and the restoring force deviate from their laws along a record belongs to that record "
    "and is integrated out; the sizes of these deviations are common to all records.",
}
ASSUMED = {
    "none": "if every law held exactly",
    "law": "laws holding approximately, each record with deviations of its own",
}
"""Under which assumption a joint fit or a population is."""


class Specimens(Section):
    """Of each specimen with several records its joint fit; over several specimens their population."""

    order = 13
    title = "Many records"

    def applies(self, run: Run) -> bool:
        """Where a specimen has several records, or there are several specimens."""
        return bool(run.cells("joint") or run.cells("population"))

    def render(self, run: Run) -> str:
        """Show joint fits beside each record alone, and the population."""
        joint = run.cells("joint")
        parts: list[object] = [paragraph(HOW)] if joint else []
        for cell in joint:
            name = cell.place.record
            parts += [Markup("<h3>{}</h3>").format(f"Repeats of {name}"), *_joint(run, name, cell)]
        for cell in run.cells("population"):
            parts += [Markup("<h3>Over the specimens</h3>"), *_population(run, cell)]
        return stack(*parts)


def joint_sentence(run: Run, cell: CellResult) -> str:
    """Say how much records differ, and whether one damping fits all of them."""
    joint = JointContent.maybe(cell)
    if joint is None:
        return f"No joint fit: {cell.outcome}."
    agree = (
        "differ in the size of their damping, so that each has its own"
        if joint.differ
        else "agree with one damping"
        if joint.agree
        else "are compatible with one damping"
    )
    factor = fmt.nats(joint.no_spread)
    text = (
        f"{len(joint.records)} records together, {ASSUMED[joint.deviation]}: the records {agree}. The log Bayes factor "
        f"of one size in all records against sizes that differ is {factor} nats"
    )
    # Where laws may hold approximately each record's own deviation takes what an exact law does not fit.
    worse = [
        label
        for label, (signal, repeat) in zip(joint.records, joint.members, strict=True)
        for row in rows_of(run.fits, signal=signal, repeat=repeat, model=joint.best)[:1]
        if joint.deviation == "none" and fitting_of(row["verdict"]) is Fitting.DOES_NOT_FIT
    ]
    outcome = joint.candidates[joint.best].outcome
    said = [text, *([outcome.rstrip(".")] if outcome != OK else [])]
    said += [f"{words.model(joint.best)} does not fit {fmt.listing(worse)}"] if worse else []
    others = [f"{words.model(n)} {_capped(q)}" for n, q in joint.others.items() if q >= WORTH]
    said += [f"Also weighed: {fmt.listing(others)}"] if others else []
    return f"{'. '.join(said)}."


def _capped(probability: float) -> str:
    """Return a probability in words; of measured records no more is claimed than in the answers."""
    return f"> {CAP:g}" if probability > CAP else fmt.probability(probability)


def _size(row: Weighing, name: str) -> str:
    """Return a parameter of a candidate with its standard deviation and unit."""
    one = row.summary[name]
    return f"{fmt.with_error(one['mean'], one['sd'])} {words.unit(row.units[name])}"


def _over(one: Mapping[str, float], unit: str) -> str:
    """Return the population's mean or spread with its 95 % interval."""
    return f"{fmt.number(one['median'], 3)} {fmt.interval(one['q2.5'], one['q97.5'])} {words.unit(unit)}"


def population_sentence(cell: CellResult) -> str:
    """Return what the population over specimens says: mean and spread of each coefficient, and a warning with them."""
    found = PopulationContent.maybe(cell)
    if found is None:
        return f"Over the specimens: {cell.outcome}."
    parts = [
        f"{words.symbol(n).text} has the mean {_over(p.mean, found.units[n])} and the spread "
        f"{_over(p.spread, found.units[n])}"
        for n, p in found.populations.items()
    ]
    text = f"Over {len(found.specimens)} specimens, all taken as {words.model(found.best)}, "
    text += f"{ASSUMED[found.deviation]}: "
    text += fmt.listing(parts)
    return f"{text}; {cell.outcome}." if cell.outcome != OK else f"{text}."


def _interval(one: Mapping[str, float]) -> Interval:
    return one["q2.5"], one["median"], one["q97.5"]


def _joint(run: Run, name: str, cell: CellResult) -> list[object]:
    joint = JointContent.maybe(cell)
    parts: list[object] = [paragraph(joint_sentence(run, cell))]
    if joint is None:
        return parts
    best, row = joint.best, joint.candidates[joint.best]
    parts += [paragraph(LAWS[joint.deviation]), _candidates(joint)]
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
    draw = partial(intervals, list(joint.alone), panels, colour(best))
    return [*parts, run.drawings.add(f"joint-{name}", caption, draw)]


def _candidates(joint: JointContent) -> Table:
    logs = {c: -np.inf if r.log_evidence is None else r.log_evidence for c, r in joint.candidates.items()}
    ranked = sorted(joint.candidates.items(), key=lambda item: -logs[item[0]])
    columns: dict[str, Callable[[tuple[str, JointCandidate]], str]] = {
        "damping model": lambda item: words.model(item[0]),
        "probability": lambda item: _capped(item[1].probability),
        "log Bayes factor": lambda item: (
            fmt.NONE if item[1].log_evidence is None else fmt.nats(logs[item[0]] - logs[joint.best])
        ),
    }
    for name in dict.fromkeys(n for _, r in ranked for n in r.summary):
        columns[words.symbol(name).text] = lambda item, n=name: (
            _size(item[1], n) if n in item[1].summary else fmt.NONE
        )
    columns["outcome"] = lambda item: item[1].outcome
    caption = (
        "All records together: the probabilities are those of the answer on the specimen, and the coefficients are the "
        "specimen's (mean ± sd)."
    )

    def kind(item: tuple[str, JointCandidate]) -> str:
        return "best" if item[0] == joint.best else "" if item[1].outcome == OK else "quiet"

    return Table.of(ranked, columns, (0, len(columns) - 1), caption, kind)


def _population(run: Run, cell: CellResult) -> list[object]:
    parts: list[object] = [paragraph(population_sentence(cell))]
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
    parts += [paragraph(how), _values(content)]
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
