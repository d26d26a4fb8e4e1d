"""The page of `bayesdamp look`: one file that opens anywhere."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from bayesdamp.cli.looking.said import curve, described, kept, reading, sentences
from bayesdamp.cli.single_file import GENERATOR
from bayesdamp.report.style import QUIET, RC, WIDTH

if TYPE_CHECKING:
    from bayesdamp.cli.asking import Found
    from bayesdamp.records.files.contents import Contents

_KEPT = "#0072B2"
_POINTS = 4000
_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;display:block;overflow-x:auto}"
    "td,th{padding:.1em .8em;text-align:left;border-bottom:1px solid #ddd}"
    "svg{max-width:100%;height:auto}.doubt{color:#a04000}.drawn{overflow-x:auto}"
    "@media(max-width:640px){svg{max-width:none;width:600px}}"
)


def page_of(file: Path, held: Contents, found: Sequence[Found]) -> str:
    """What a file holds and what would be read of it, as HTML."""
    rows = Markup("").join(_row(row, "td") for row in described(held))
    facts = Markup("").join(Markup("<li>{}: {}</li>").format(k, v) for k, v in held.facts.items())
    records = Markup("").join(_record(one) for one in found)
    head = _row(("", "column", "unit", "samples", "from", "to"), "th")
    return Markup(
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        "{7}<title>{0}</title><style>{1}</style>"
        "<h1>{0}</h1><p>{2}</p><table>{3}{4}</table><ul>{5}</ul>{6}</html>\n"
    ).format(file.name, Markup(_STYLE), held.format, head, rows, facts, records, Markup(GENERATOR))


def _row(cells: Sequence[str], kind: str) -> Markup:
    inside = Markup("").join(Markup(f"<{kind}>{{}}</{kind}>").format(cell) for cell in cells)
    return Markup("<tr>{}</tr>").format(inside)


def _record(one: Found) -> Markup:
    lines = Markup("").join(Markup("<li>{}</li>").format(line) for line in sentences(one))
    doubts = Markup("").join(Markup('<li class="doubt">{}</li>').format(str(f)) for f in one.findings)
    title = one.label or one.raw.channel or "the record"
    return Markup("<h2>{}</h2><p>{}</p><ul>{}{}</ul>{}").format(
        title, reading(one), lines, doubts, _drawn(one)
    )


def _drawn(one: Found) -> Markup:
    t, y = curve(one)
    every = max(1, t.size // _POINTS)
    with mpl.rc_context(RC):
        figure = Figure(figsize=(WIDTH, 2.6))
        axes = figure.add_subplot()
        axes.plot(t[::every], y[::every], color=QUIET, linewidth=0.8)
        window = kept(one)
        if window is not None:
            inside = (t >= window[0]) & (t <= window[1])
            axes.plot(np.where(inside, t, np.nan)[::every], y[::every], color=_KEPT, linewidth=0.9)
        axes.set_xlabel("time in s")
        axes.set_ylabel(str(escape(one.raw.channel))[:40])
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    drawn = Markup(text[text.index("<svg") :])  # by matplotlib, which escapes what it is given
    return Markup('<div class="drawn">{}</div>').format(drawn)
