"""Many records: repeats of one specimen together, and specimens beside each other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.figures.posteriors.intervals import Interval, Panel, intervals
from bayesdamp.report.html import Line, Table, fill
from bayesdamp.report.results.answers import specimens
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.specimens import (
    joint_cells,
    joint_sentence,
    over,
    population_cell,
    population_sentence,
    size,
)
from bayesdamp.report.sections._section import Section
from bayesdamp.report.style import colour
from bayesdamp.store import CellResult
from bayesdamp.store.contents.many import JointContent, PopulationContent
from bayesdamp.types import OK, summed

_SHARED = {
    "damping and law": "the damping and the restoring law's parameters but its angles",
    "damping": "the damping alone; each record has its own restoring parameters",
}
_OWN = {
    "none": "its noise. The joint interval is right if the records share what they are said to share, every law holds "
    "exactly and each record's noise is right; it is not widened for what differs from record to record.",
    "law": "by how much its damping and its restoring force deviate from their laws along it, which is integrated out. "
    "The joint interval is right if the records share what they are said to share; it is widened for how far the laws "
    "hold in each, not for coefficients that differ from record to record.",
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
        parts: list[object] = []
        for name, cell in joint_cells(run).items():
            parts += [Markup("<h3>{}</h3>").format(f"Repeats of {name}"), *_joint(run, name, cell)]
        cell = population_cell(run)
        if cell is not None:
            parts += [Markup("<h3>Over the specimens</h3>"), *_population(run, cell)]
        return fill("stack.html", parts=parts)


def _text(*said: str) -> Markup:
    return Markup("<p>{}</p>").format(" ".join(said))


def _interval(one: Mapping[str, float]) -> Interval:
    return one["q2.5"], one["median"], one["q97.5"]


def _joint(run: Run, name: str, cell: CellResult) -> list[object]:
    said = joint_sentence(run, cell)
    joint = JointContent.maybe(cell)
    if joint is None:
        return [_text(said[:1].upper() + said[1:])]
    best, row = joint.best, joint.candidates[joint.best]
    how = (
        f"Shared: {_SHARED[joint.sharing]}. Each record's own: its start, its angle at rest (an encoder "
        f"may be offset) and {_OWN[joint.deviation]}"
    )
    law = f"As to the law, {joint.said['law']}." if "law" in joint.said else ""
    parts: list[object] = [
        _text(said[:1].upper() + said[1:]),
        _text(how, law, words.SAME_COEFFICIENTS if specimens(run) else ""),
        *([_text(summed)] if (summed := _dampings(joint)) else ()),
        _candidates(joint),
        _sharings(joint),
    ]
    names = list(row.summary)
    panels = [
        Panel(
            words.axis(n, row.units[n]),
            [_interval(alone.summary[n]) for alone in joint.alone.values()],
            _interval(row.summary[n]),
        )
        for n in names
    ]
    caption = f"{name}, {words.model(best)}: each record's own median and 95 % interval; grey: that of the joint fit."
    labels = list(joint.alone)
    parts.append(run.drawings.add(f"joint-{name}", caption, lambda: intervals(labels, panels, colour(best))))
    spreads = [
        f"{words.symbol(n).text} {over(found.spread, row.units[n])}" for n, found in joint.repeats.items()
    ]
    warning = next((p.outcome for p in joint.repeats.values() if p.outcome != OK), "")
    text = "From repeat to repeat, beyond what each record's own interval allows, the coefficients spread (sd) by "
    parts.append(_text(f"{text}{words.listing(spreads)}{f' ({warning})' if warning else ''}."))
    return parts


def _dampings(joint: JointContent) -> str:
    """The probability of each damping, whatever the restoring law; empty where one law was compared."""
    found = summed({c: row.probability for c, row in joint.candidates.items()})
    if len(found) in (1, len(joint.candidates)):
        return ""
    shares = [f"{words.model(d)} {words.probability(p)}" for d, p in found.items()]
    return f"Summed over the restoring laws the probabilities are: {words.listing(shares)}."


def _candidates(joint: JointContent) -> Table:
    names = list(dict.fromkeys(n for r in joint.candidates.values() for n in r.summary))
    logs = {c: -np.inf if r.log_evidence is None else r.log_evidence for c, r in joint.candidates.items()}
    top = logs[joint.best]
    rows = sorted(joint.candidates.items(), key=lambda item: -logs[item[0]])
    lines = []
    for candidate, row in rows:
        sizes = [size(row, n) if n in row.summary else words.NONE for n in names]
        ratio = None if row.log_evidence is None else row.log_evidence - top
        shown = words.nats(ratio, np.nan if row.stderr is None else row.stderr)
        kind = "best" if candidate == joint.best else "" if row.outcome == OK else "quiet"
        share = words.probability(row.probability)
        drawn = words.number(row.effective, 3)
        lines.append(Line([words.model(candidate), share, shown, *sizes, drawn, row.outcome], kind))
    headers = ["damping model", "probability", "log Bayes factor", *(words.symbol(n).text for n in names)]
    caption = (
        "All records together: evidence of the joint posterior by importance sampling, and what is shared "
        "(mean ± sd)."
    )
    last = len(headers) + 1
    return Table([*headers, "effective draws", "outcome"], lines, frozenset({0, last}), caption)


def _sharings(joint: JointContent) -> Table:
    order = [s for s in ("damping and law", "damping", "law", "nothing") if s in joint.sharings]
    found = {s: joint.sharings[s] for s in order}
    logs = {s: np.nan if one.log_evidence is None else one.log_evidence for s, one in found.items()}
    top = np.nanmax(list(logs.values()))
    lines = [
        Line(
            [
                s,
                words.nats(logs[s] - top, found[s].stderr),
                found[s].outcome,
            ],
            "best" if logs[s] == top else "",
        )
        for s in order
    ]
    caption = (
        f"{words.model(joint.best)}: log evidence by what the records share, against the best. Where it has no "
        "error it is so far off that Laplace's evidence, or the distance of the records' own modes, will do."
    )
    return Table(["shared", "nats", "outcome"], lines, frozenset({0, 2}), caption)


def _population(run: Run, cell: CellResult) -> list[object]:
    parts: list[object] = [_text(population_sentence(cell))]
    content = PopulationContent.maybe(cell)
    if content is None:
        return parts
    best, labels = content.best, list(content.specimens)
    scales = [
        f"{words.number(p.scale, 2)} {words.unit(content.units[n])} for {words.symbol(n).text}"
        for n, p in content.populations.items()
    ]
    behind = [f"{label} ({words.nats(gap)} nats)" for label, gap in content.behind.items() if gap > 1]
    how = (
        "Specimens' coefficients are taken as normal, cut off at zero; the mean and the spread are of what is "
        "left. The normal's location has a half-normal prior with the scale of the coefficient's own, "
        f"{words.listing(scales)}, and its width one with the scale of the location: specimens of one kind hardly "
        "spread by more than their size. The model is the one with the greatest evidence over all specimens "
        "together."
    )
    if behind:
        how += f" Another model is ahead for {words.listing(behind)}."
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
            bounds = words.interval(one["q2.5"], one["q97.5"])
            lines.append(
                Line([f"{words.symbol(name).text}, {what}", words.number(one["median"], 3), bounds, unit])
            )
        for label, one in found.shrunk.items():
            cells = [f"{words.symbol(name).text} of {label}", words.number(one["median"], 4)]
            lines.append(Line([*cells, words.interval(one["q2.5"], one["q97.5"]), unit], "quiet"))
    caption = "The population's mean and spread (sd), and each specimen's value given all of them."
    return Table(["quantity", "median", "95 %", "unit"], lines, frozenset({0, 3}), caption)


PLUGIN = Specimens()
