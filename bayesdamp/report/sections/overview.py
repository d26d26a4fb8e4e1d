"""Many records at a glance: what they say together, a small picture of each, a table to sort."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.html import paragraph, stack
from bayesdamp.report.results.answers import Answer, answers, specimens
from bayesdamp.report.results.overview import ANCHOR, curve_of, overview_table, short_names
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._section import Section
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import energy_of

FEWEST = 3
"""Records from which an overview stands before them."""
MOST = 60
"""Records that are drawn; the table has all."""
BOX = (200.0, 64.0)
"""Width and height of a small picture, in its own units."""


SORTS = "A line a record; a click on a header sorts. Damping ratio: equivalent viscous."


class Overview(Section):
    """The specimens' verdicts, small multiples of the damping curves, and a line a record with a link to it."""

    order = 4
    name = "overview"
    title = "All records"

    def applies(self, run: Run) -> bool:
        """Where so many records have an answer that one looks for one of them, and for envelopes of one specimen."""
        many = len(answers(run)) >= FEWEST or any(v.quantity == "envelope" for v in specimens(run))
        return many and not run.study.get("published")

    def render(self, run: Run) -> str:
        """Specimens, small multiples, and a line a record."""
        found = answers(run)
        together = specimens(run)
        cards = [_together(v, v.record if len(together) > 1 else "") for v in together]
        return stack(*cards, _pictures(found), replace(overview_table(found), caption=SORTS))


def _together(v: Verdict, name: str) -> Markup:
    head = Markup("<h3>{}</h3>").format(name) if name else ""
    lines = (*energy_of(v), *(v.remarks if v.quantity == "envelope" else ()))
    more = Markup("").join(map(paragraph, lines))
    return Markup('<div class="verdict">{}<p class="claim">{}</p>{}</div>').format(head, v.sentence, more)


def _pictures(found: Sequence[Answer]) -> Markup:
    """Each record's damping ratio against amplitude, all on the same axes."""
    shown = [a for a in found[:MOST] if curve_of(a) is not None]
    if not shown:
        return Markup("")
    curves = [c for a in shown if (c := curve_of(a)) is not None]
    amplitudes = np.concatenate([c[0] for c in curves])
    tops = [float(np.nanmax(c[1])) for c in curves]
    left, right, top = float(amplitudes.min()), float(amplitudes.max()), 1.15 * float(np.median(tops))
    top = max(top, 1.05 * float(np.nanquantile(np.concatenate([c[1] for c in curves]), 0.9)))
    names = short_names([a.signal for a in found])
    panels = [_panel(a, names[a.signal], left, right, top) for a in shown]
    unit = shown[0].verdict.damping_ratio[0].unit
    said = (
        f"Damping ratio against amplitude with its 95 % band, all on one scale: across {left:.2g} to {right:.2g} "
        f"{unit} (logarithmic), up from 0 to {100 * top:.2g} %. Level: viscous; falling to the right: "
        "friction; rising: drag."
    )
    more = f" The first {MOST} of {len(found)}." if len(found) > MOST else ""
    return Markup('<div class="panels">{}</div><p class="small">{}</p>').format(
        Markup("").join(panels), said + more
    )


def _panel(answer: Answer, name: str, left: float, right: float, top: float) -> Markup:
    curve = curve_of(answer)
    assert curve is not None
    width, height = BOX
    span = math.log(right / left) or 1.0
    x = width * np.log(curve[0] / left) / span
    ratio, low, high = (height * (1.0 - np.clip(v / top, 0.0, 1.0)) for v in curve[1:])
    band = _points(np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]]))
    drawing = (
        f'<svg viewBox="0 -2 {width:g} {height + 4:g}" aria-hidden="true"><path d="M0 {height:g}H{width:g}" '
        'stroke="currentColor" stroke-opacity=".35" stroke-width=".7"/>'
        f'<polygon points="{band}" fill="currentColor" fill-opacity=".2"/>'
        f'<polyline points="{_points(x, ratio)}" fill="none" stroke="currentColor" stroke-width="1.6"/></svg>'
    )
    v = answer.verdict
    said = f"{words.model(v.damping)} ({fmt.probability(v.probability)})"
    return Markup('<a href="#{}"><b>{}</b>{}<span>{}</span></a>').format(
        ANCHOR + answer.signal, name, Markup(drawing), said
    )


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y))


PLUGIN = Overview()
