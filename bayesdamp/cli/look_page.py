"""Write the HTML page of `bayesdamp look`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from bayesdamp.cli.files import GENERATOR
from bayesdamp.cli.looking import RecordView, columns_table
from bayesdamp.records.files.contents import Contents
from bayesdamp.report.drawing import MUTED, WIDTH, Drawings

_INSIDE = "#0072B2"
"""Colour of the free decay in the figures; the rest of the record is grey."""
_POINTS = 4000
"""A record of at least twice as many samples is thinned for its figure: only every k-th sample is drawn, with the
largest k that leaves at least this number of points."""
_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;display:block;overflow-x:auto}"
    "td,th{padding:.1em .8em;text-align:left;border-bottom:1px solid #ddd}"
    "figure{margin:0;overflow-x:auto}img{max-width:100%;height:auto}.doubt{color:#a04000}"
    "@media(max-width:640px){img{max-width:none;width:600px}}"
)


def page_of(file: Path, contents: Contents, views: Sequence[RecordView]) -> str:
    """Return a self-contained HTML page on the content of a file, and on how its records are read.

    `views` are of the records in the file; each gets a figure. Nothing is written.
    """

    def items(lines: Iterable[object], look: str = "") -> Markup:
        return Markup("").join(Markup('<li class="{}">{}</li>').format(look, str(line)) for line in lines)

    records = Markup("")
    for view in views:
        lines = items(view.lines) + items(view.doubts, "doubt")
        parts = (
            "No free decay is found in it" if view.window is None else "The used part is blue, the rest grey"
        )
        caption = f"The record over time: {view.reading}. {parts}."
        drawing = Drawings(None).add(view.name, caption, partial(_figure, view))
        records += Markup("<h2>{}</h2><ul>{}</ul>{}").format(view.name, lines, drawing)
    return Markup(
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        "{6}<title>{0}</title><style>{1}</style><h1>{0}</h1><p>{2}</p>{3}<ul>{4}</ul>{5}</html>\n"
    ).format(
        file.name,
        Markup(_STYLE),
        contents.format,
        columns_table(contents),
        items(f"{name}: {value}" for name, value in contents.facts.items()),
        records,
        Markup(GENERATOR),
    )


def _figure(view: RecordView) -> Figure:
    """Draw a record in grey, with its free decay, if there is one, in colour."""
    t, y, window = view.t, view.y, view.window
    every = max(1, t.size // _POINTS)
    figure = Figure(figsize=(WIDTH, 2.6))
    axes = figure.add_subplot()
    axes.plot(t[::every], y[::every], color=MUTED, linewidth=0.8)
    if window is not None:
        inside = (t >= window[0]) & (t <= window[1])
        axes.plot(np.where(inside, t, np.nan)[::every], y[::every], color=_INSIDE, linewidth=0.9)
    axes.set(xlabel="time in s", ylabel=view.name[:40].replace("$", r"\$"))
    return figure
