"""Several records in one table: short names, and damping ratios at one amplitude."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import takewhile

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.answers import Answer
from bayesdamp.table import Table
from bayesdamp.verdict.parts import DampingRatio
from bayesdamp.verdict.tables import number

ANCHOR = "answer-"
"""With a signal's name, where its answer stands on the page."""
Curve = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Names without the words that all begin with."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names))
    common = "".join(letters[0] for letters in alike)
    cut = max(common.rfind(mark) + 1 for mark in "_-")
    return {name: name[cut:] if all(len(n) > cut for n in names) else name for name in names}


def curve_of(answer: Answer) -> Curve | None:
    """Amplitude, damping ratio and the ends of its interval, each of shape (points,), without what is not finite; None
    where an answer has no such curve."""
    a = answer.arrays
    if not answer.verdict.damping_ratio or not {"amplitude", "ratio", "low", "high"} <= set(a):
        return None
    columns = np.array([a[name] for name in ("amplitude", "ratio", "low", "high")], float)
    columns = columns[:, np.isfinite(columns).all(axis=0) & (columns[0] > 0)]
    return (columns[0], columns[1], columns[2], columns[3]) if columns.shape[1] > 1 else None


def common_amplitude(answers: Sequence[Answer]) -> float | None:
    """The middle, geometrically, of the amplitudes that all records pass; None where there is none, or their units
    differ."""
    curves = [c for a in answers if (c := curve_of(a)) is not None]
    units = {a.verdict.damping_ratio[0].unit for a in answers if a.verdict.damping_ratio}
    if not curves or len(units) != 1:
        return None
    low, high = max(float(c[0].min()) for c in curves), min(float(c[0].max()) for c in curves)
    return float(np.sqrt(low * high)) if low < high else None


def ratio_of(answer: Answer, amplitude: float | None) -> DampingRatio | None:
    """A record's damping ratio at an amplitude, from its curve; without one, that in the middle of the record."""
    own = answer.verdict.damping_ratio
    if not own:
        return None
    curve = curve_of(answer)
    if amplitude is None or curve is None:
        return own[len(own) // 2]
    order = np.argsort(curve[0])
    at = [float(np.interp(np.log(amplitude), np.log(curve[0][order]), c[order])) for c in curve[1:]]
    return replace(own[0], amplitude=amplitude, value=at[0], low=at[1], high=at[2])


def overview_table(found: Sequence[Answer], brief: bool = False) -> Table:
    """Return a line a record, with the damping ratios at one amplitude where all records pass one.

    brief: for the terminal, without links and without how well the law holds.
    """
    envelopes = [a for a in found if a.verdict.quantity == "envelope"]
    quality = any(a.verdict.quality_factor for a in envelopes)
    names, shared = short_names([a.signal for a in found]), common_amplitude(found)
    ratios = {a.signal: ratio_of(a, shared) for a in found}
    unit = next((ratio.unit for ratio in ratios.values() if ratio), "")

    def name(a: Answer) -> str:
        return (
            names[a.signal]
            if brief
            else Markup('<a href="#{}">{}</a>').format(ANCHOR + a.signal, names[a.signal])
        )

    def size(a: Answer) -> str:
        ratio = ratios[a.signal]
        text = fmt.with_interval(ratio.value, ratio.low, ratio.high, " %", 100) if ratio else fmt.NONE
        return f"{text}, {ratio.amplitude:.2g} {ratio.unit}" if ratio and shared is None else text

    at = (
        f"damping ratio at {shared:.3g} {unit} (95 %)"
        if shared is not None
        else "damping ratio (95 %), amplitude"
    )
    columns: dict[str, Callable[[Answer], str]] = {
        "record": name,
        "damping": lambda a: (
            words.model(a.verdict.damping)
            if a.verdict.damping
            else f"no free decay: {a.verdict.motion}"
            if a.verdict.motion
            else "no free decay"
        ),
        "probability": lambda a: fmt.probability(a.verdict.probability),
        "frequency / Hz": lambda a: (
            fmt.number(a.verdict.frequency.value, 4) if a.verdict.frequency else fmt.NONE
        ),
    }
    if len(envelopes) < len(found):
        columns[at] = size
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
    return Table.of(found, columns, (0, 1), kind=lambda a: "" if a.verdict.decided else "quiet")
