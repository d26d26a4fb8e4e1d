"""Read the answers of a run, and compare them in one table at a common amplitude."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.run import RunFolder
from bayesdamp.store.contents import AnswerContent, EnvelopeContent, WeighedCandidate
from bayesdamp.table import Table
from bayesdamp.types import OK
from bayesdamp.verdict.parts import DampingRatio, number
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit, picture_in_unit

ANCHOR = "answer-"
"""Beginning of the identifier of a record's answer on the page; its name follows."""
Curve = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Amplitude, damping ratio and the ends of its interval, each (points,)."""


@dataclass(frozen=True)
class RecordAnswer:
    """A record's verdict, the candidates behind it, and the arrays of its figure; lengths in the record's unit."""

    signal: str
    verdict: Verdict
    candidates: tuple[WeighedCandidate, ...]
    arrays: Mapping[str, np.ndarray]
    envelope: EnvelopeContent | None = None


def answer_content(run: RunFolder, signal: str) -> AnswerContent | None:
    """Return the stored answer on a record before sampling; None if the answer contains no law."""
    cell = run.cell("answer", signal, run.repeats(signal)[0])
    content = AnswerContent.of(cell) if cell is not None and cell.outcome == OK else None
    return None if content is None or content.verdict.get("law_free") else content


def answer_of(
    run: RunFolder, signal: str, kinds: Sequence[str] = ("sampled", "answer")
) -> RecordAnswer | None:
    """Return the answer on a record's first repeat, after sampling if it was sampled; None if there is none.

    `kinds` contains the kinds of the tasks that have such an answer, the preferred one first.
    """
    cells = (run.cell(kind, signal, run.repeats(signal)[0]) for kind in kinds)
    cell = next((c for c in cells if c is not None and c.outcome == OK), None)
    if cell is None:
        return None
    unit, content = run.unit(signal), AnswerContent.of(cell)
    verdict = in_unit(Verdict.from_dict(content.verdict), unit)
    arrays = picture_in_unit(cell.arrays, unit)
    return RecordAnswer(signal, verdict, content.candidates, arrays, content.envelope)


def answers(run: RunFolder) -> list[RecordAnswer]:
    """Return the answer on every record's first repeat, in the study's order."""
    return [answer for signal in run.signals if (answer := answer_of(run, signal)) is not None]


def specimens(run: RunFolder) -> list[Verdict]:
    """Return the verdict of every specimen that has several records."""
    verdicts = [v for v in run.verdicts if v.record not in run.signals]
    units = {run.unit(signal) for signal in run.signals}
    return [in_unit(v, next(iter(units))) for v in verdicts] if len(units) == 1 else verdicts


def only_answered(run: RunFolder) -> bool:
    """Return whether a run has answers only, without fits or samples under exact laws."""
    answered = any(answer_of(run, signal) for signal in run.signals)
    return answered and not any(run.cells("mode", signal) for signal in run.signals)


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Return each name without the words with which all names begin."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names))
    common = "".join(letters[0] for letters in alike)
    cut = max(common.rfind(mark) + 1 for mark in "_-")
    return {name: name[cut:] if all(len(n) > cut for n in names) else name for name in names}


def curve_of(answer: RecordAnswer) -> Curve | None:
    """Return the finite part of an answer's damping curve; None if it has no such curve."""
    names = ("amplitude", "ratio", "low", "high")
    if not answer.verdict.damping_ratio or not set(names) <= set(answer.arrays):
        return None
    columns = np.array([answer.arrays[name] for name in names], float)
    columns = columns[:, np.isfinite(columns).all(axis=0) & (columns[0] > 0)]
    return (columns[0], columns[1], columns[2], columns[3]) if columns.shape[1] > 1 else None


def common_amplitude(records: Sequence[RecordAnswer]) -> float | None:
    """Return the geometric mean of the range of amplitudes that all records have in common.

    None if there is no such range, or if the records have different units.
    """
    curves = [curve for answer in records if (curve := curve_of(answer)) is not None]
    units = {a.verdict.damping_ratio[0].unit for a in records if a.verdict.damping_ratio}
    if not curves or len(units) != 1:
        return None
    low, high = max(float(c[0].min()) for c in curves), min(float(c[0].max()) for c in curves)
    return float(np.sqrt(low * high)) if low < high else None


def ratio_of(answer: RecordAnswer, amplitude: float | None) -> DampingRatio | None:
    """Return a record's damping ratio at an amplitude, from its curve.

    Without an amplitude or a curve it is the ratio in the middle of the record; None if the record has no ratio.
    """
    ratios = answer.verdict.damping_ratio
    if not ratios:
        return None
    curve = curve_of(answer)
    if amplitude is None or curve is None:
        return ratios[len(ratios) // 2]
    order = np.argsort(curve[0])
    value, low, high = (
        float(np.interp(np.log(amplitude), np.log(curve[0][order]), column[order])) for column in curve[1:]
    )
    return replace(ratios[0], amplitude=amplitude, value=value, low=low, high=high)


def overview_table(records: Sequence[RecordAnswer], brief: bool = False) -> Table:
    """Return a table with a line for each record.

    Damping ratios are at one amplitude if all records pass it.

    Parameters
    ----------
    records
        The answers.
    brief
        Whether to leave out the links, and the columns on how well the law holds, for the terminal.

    Returns
    -------
    Table
        The records in their order.
    """
    envelopes = [a for a in records if a.verdict.quantity == "envelope"]
    quality = any(a.verdict.quality_factor for a in envelopes)
    names, shared = short_names([a.signal for a in records]), common_amplitude(records)
    ratios = {a.signal: ratio_of(a, shared) for a in records}

    def name(a: RecordAnswer) -> str:
        link = Markup('<a href="#{}">{}</a>')
        return names[a.signal] if brief else link.format(ANCHOR + a.signal, names[a.signal])

    def damping(a: RecordAnswer) -> str:
        motion = f": {a.verdict.motion}" if a.verdict.motion else ""
        return words.model(a.verdict.damping) if a.verdict.damping else f"not a free decay{motion}"

    def size(a: RecordAnswer) -> str:
        ratio = ratios[a.signal]
        text = fmt.with_interval(ratio.value, ratio.low, ratio.high, " %", 100) if ratio else fmt.NONE
        return f"{text}, {ratio.amplitude:.2g} {ratio.unit}" if ratio and shared is None else text

    columns: dict[str, Callable[[RecordAnswer], str]] = {
        "record": name,
        "damping": damping,
        "probability": lambda a: fmt.probability(a.verdict.probability),
        "frequency / Hz": lambda a: (
            fmt.number(a.verdict.frequency.value, 4) if a.verdict.frequency else fmt.NONE
        ),
    }
    if len(envelopes) < len(records):
        unit = next((ratio.unit for ratio in ratios.values() if ratio), "")
        at = "(95 %), amplitude" if shared is None else f"at {shared:.3g} {unit} (95 %)"
        columns[f"damping ratio {at}"] = size
    if envelopes:
        columns["Q (95 %)" if quality else "rate / (1/s) (95 %)"] = lambda a: number(
            a.verdict.quality_factor if quality else a.verdict.rate
        )
        columns["power of the velocity (95 %)"] = lambda a: number(a.verdict.exponent)
    if not brief:
        columns["law holds within / %"] = lambda a: (
            fmt.number(100 * a.verdict.deviation.value, 2) if a.verdict.deviation else fmt.NONE
        )
        columns["unexplained / %"] = lambda a: fmt.number(a.verdict.unexplained_pct, 2)
    return Table.of(records, columns, (0, 1), kind=lambda a: "" if a.verdict.decided else "quiet")
