"""Show the joint fit of each specimen with several records, and the population of several specimens."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table, TableLine
from bayesdamp.outcomes import FitStatus, fitting_of
from bayesdamp.report import words
from bayesdamp.report.drawing import colour
from bayesdamp.report.figures.posterior import Interval, Panel, intervals
from bayesdamp.report.results.run import RunFolder, rows_of
from bayesdamp.report.sections import Section, heading, paragraph, stack
from bayesdamp.store import TaskResult
from bayesdamp.store.contents import JointContent, PopulationContent
from bayesdamp.types import OK
from bayesdamp.verdict.thresholds import CAP

LEAST_NAMED = 0.01
"""Smallest probability for which a form of damping outside the study's own models is named."""
JOINT_FIT = (
    "The records share one damping model with one set of coefficients for the specimen. In each record a common factor "
    "multiplies all coefficients; its spread from record to record is inferred. Each record has its own initial "
    "conditions, parameters of the restoring law, equilibrium (an encoder may have an offset) and noise."
)
LAWS = {
    "none": "Every law is assumed to hold exactly. The interval of a coefficient therefore includes the uncertainty "
    "from the noise and the spread between records, but not from deviations from the laws.",
    "law": "Each record has its own deviations of the damping and the restoring force from their laws, which are "
    "integrated out. The sizes of these deviations are common to all records.",
}
"""Explanation of a joint fit, by the study's setting `deviation`."""
ASSUMED = {
    "none": "if every law held exactly",
    "law": "with laws that hold approximately and separate deviations in each record",
}
"""Assumption of a joint fit or a population in words, by the study's setting `deviation`."""


class SpecimensSection(Section):
    """The section with the joint fit of each specimen with several records, and the population of the specimens."""

    order = 13
    name = "specimens"
    title = "Specimens with several records"

    def applies(self, run: RunFolder) -> bool:
        """Return whether a specimen has several records, or there are several specimens."""
        return bool(run.task_results("joint") or run.task_results("population"))

    def render(self, run: RunFolder) -> str:
        """Return each joint fit, compared with the fits of its single records, and the population."""
        parts: list[object] = []
        for task_result in run.task_results("joint"):
            parts += [] if parts else [paragraph(JOINT_FIT)]
            joint, name = JointContent.maybe(task_result), task_result.parts.record
            parts += [heading(f"Repeats of {name}"), paragraph(joint_sentence(run, task_result))]
            if joint is not None:
                parts += [paragraph(LAWS[joint.deviation]), _candidates(joint)]
            if joint is None or not joint.alone:
                continue
            best, row = joint.best, joint.candidates[joint.best]
            panels = [
                Panel(
                    words.axis(n, row.units[n]),
                    [_interval(alone.summary[n]) for alone in joint.alone.values()],
                    _interval(row.summary[n]),
                )
                for n in row.summary
            ]
            caption = (
                f"Coefficients of {words.model(best)} damping: median (dot) and 95 % interval (bar) from each record "
                f"of {name} alone. Grey: median and 95 % interval for the specimen, from the joint fit of all its "
                "records."
            )
            draw = partial(intervals, list(joint.alone), panels, colour(best))
            parts.append(run.drawings.add(f"joint-{name}", caption, draw))
        for task_result in run.task_results("population"):
            parts += [heading("All specimens"), *_population(run, task_result)]
        return stack(*parts)


def joint_sentence(run: RunFolder, task_result: TaskResult) -> str:
    """Return sentences on how much the records of a specimen differ, and whether one damping fits all of them.

    Without a joint fit, the sentence gives the reason.
    """
    joint = JointContent.maybe(task_result)
    if joint is None:
        return f"No joint fit: {task_result.outcome}."
    agree = "are compatible with one damping"
    if joint.differ:
        agree = "differ in the size of their damping, so the common factor is not the same in each record"
    elif joint.agree:
        agree = "agree with one damping"
    sentences = [
        f"Joint fit of {len(joint.records)} records, {ASSUMED[joint.deviation]}: the records {agree}. The log Bayes "
        "factor of damping of the same size in all records against different sizes is "
        f"{fmt.nats(joint.no_spread)} nats"
    ]
    outcome = joint.candidates[joint.best].outcome
    sentences += [outcome.rstrip(".")] if outcome != OK else []
    # If laws hold approximately, each record's own deviation explains what an exact law does not fit.
    misfits = [
        label
        for label, (signal, repeat) in zip(joint.records, joint.members, strict=True)
        for row in rows_of(run.fits, signal=signal, repeat=repeat, model=joint.best)[:1]
        if joint.deviation == "none" and fitting_of(row["verdict"]) is FitStatus.DOES_NOT_FIT
    ]
    sentences += [f"{words.model(joint.best)} does not fit {fmt.listing(misfits)}"] if misfits else []
    others = [f"{words.model(n)} {_capped_text(q)}" for n, q in joint.others.items() if q >= LEAST_NAMED]
    sentences += [f"Other forms that were considered: {fmt.listing(others)}"] if others else []
    return f"{'. '.join(sentences)}."


def _capped_text(probability: float) -> str:
    """Return a probability as text; "> 0.99" if it is above 0.99 (`CAP`), the largest probability that is stated."""
    return f"> {CAP:g}" if probability > CAP else fmt.probability(probability)


def _interval(quantiles: Mapping[str, float]) -> Interval:
    """Return the quantiles at 2.5, 50 and 97.5 %, which have the names q2.5, median and q97.5."""
    return quantiles["q2.5"], quantiles["median"], quantiles["q97.5"]


def _candidates(joint: JointContent) -> Table:
    """Return a table of the damping models of a joint fit, the most probable first.

    It has their probability, log Bayes factor in nats, and coefficients as mean ± standard deviation.
    """
    rows = joint.candidates
    logs = {c: -np.inf if r.log_evidence is None else r.log_evidence for c, r in rows.items()}
    ranked = sorted(rows, key=lambda model: -logs[model])

    def size(model: str, name: str) -> str:
        if name not in rows[model].summary:
            return fmt.NONE
        own = rows[model].summary[name]
        return f"{fmt.with_error(own['mean'], own['sd'])} {words.unit(rows[model].units[name])}"

    def factor(model: str) -> str:
        unknown = rows[model].log_evidence is None
        return fmt.NONE if unknown else fmt.nats(logs[model] - logs[joint.best])

    def kind(model: str) -> str:
        return "best" if model == joint.best else "" if rows[model].outcome == OK else "quiet"

    columns: dict[str, Callable[[str], str]] = {
        "damping model": words.model,
        "probability": lambda model: _capped_text(rows[model].probability),
        "log Bayes factor": factor,
    }
    for name in dict.fromkeys(n for model in ranked for n in rows[model].summary):
        columns[words.symbol(name).text] = partial(size, name=name)
    columns["outcome"] = lambda model: rows[model].outcome
    caption = (
        "Damping models in the joint fit of all records of the specimen, the most probable first (bold): posterior "
        "probability, as in the verdict on the specimen; log Bayes factor (nats) relative to the best model; and "
        "coefficients of the specimen, mean ± standard deviation."
    )
    return Table.of(ranked, columns, (0, len(columns) - 1), caption, kind)


def _population(run: RunFolder, task_result: TaskResult) -> list[object]:
    """Return sentences, a table and a figure on the population of the specimens."""
    content = PopulationContent.maybe(task_result)
    if content is None:
        return [paragraph(f"No population: {task_result.outcome}.")]
    model = f"{len(content.specimens)} specimens, all with {words.model(content.best)} damping"
    warning = f"; {task_result.outcome}" if task_result.outcome != OK else ""
    parts: list[object] = [paragraph(f"{model}, {ASSUMED[content.deviation]}{warning}.")]
    scales = fmt.listing(
        f"{fmt.number(p.scale, 2)} {words.unit(content.units[n])} for {words.symbol(n).text}"
        for n, p in content.populations.items()
    )
    how = (
        "The specimens' coefficients have a normal distribution, truncated at zero; mean and spread are those of the "
        f"truncated distribution. The normal's location has a half-normal prior with the scale {scales}, which is the "
        "scale of the study's prior, or three times the largest coefficient of a specimen if the study specifies none. "
        "The normal's width has a half-normal prior with the location as its scale, because the spread of similar "
        "specimens is rarely larger than their mean. The model is the one with the greatest evidence over all "
        "specimens together."
    )
    behind = [f"{label} ({fmt.nats(gap)} nats)" for label, gap in content.behind.items() if gap > 1]
    how += f" Another model has greater evidence for {fmt.listing(behind)}." if behind else ""
    lines = []
    for name, population in content.populations.items():
        symbol, unit = words.symbol(name).text, words.unit(content.units[name])
        rows = [(f"{symbol}, mean", population.mean, 3, ""), (f"{symbol}, spread", population.spread, 3, "")]
        rows += [(f"{symbol} of {label}", own, 4, "quiet") for label, own in population.shrunk.items()]
        for label, own, digits, kind in rows:
            bounds = fmt.interval(own["q2.5"], own["q97.5"])
            lines.append(TableLine([label, fmt.number(own["median"], digits), bounds, unit], kind))
    caption = (
        "Mean and spread (standard deviation) of each damping coefficient in the population of specimens, and the "
        "value of each specimen given all specimens: posterior median and 95 % interval."
    )
    parts += [paragraph(how), Table(["quantity", "median", "95 %", "unit"], lines, (0, 3), caption)]
    labels = list(content.specimens)
    panels = [
        Panel(
            words.axis(n, content.units[n]),
            [_interval(content.specimens[label].summary[n]) for label in labels],
            _interval(population.mean),
            [_interval(population.shrunk[label]) for label in labels],
        )
        for n, population in content.populations.items()
    ]
    caption = (
        "Damping coefficients of each specimen, median and 95 % interval: from its own records alone (filled) and "
        "given all specimens (open). Grey: median and 95 % interval of the population's mean."
    )
    draw = partial(intervals, labels, panels, colour(content.best))
    return [*parts, run.drawings.add("population", caption, draw)]


PLUGINS = (SpecimensSection(),)
