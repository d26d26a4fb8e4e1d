"""The page of `bayesdamp look`: one file that opens anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from bayesdamp.cli.looking.said import Shown, described
from bayesdamp.cli.single_file import GENERATOR
from bayesdamp.report.drawing import Drawings
from bayesdamp.report.style import QUIET, WIDTH

if TYPE_CHECKING:
    from bayesdamp.records.files.contents import Contents

_KEPT = "#0072B2"
_POINTS = 4000
_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;display:block;overflow-x:auto}"
    "td,th{padding:.1em .8em;text-align:left;border-bottom:1px solid #ddd}"
    "figure{margin:0;overflow-x:auto}img{max-width:100%;height:auto}.doubt{color:#a04000}"
    "@media(max-width:640px){img{max-width:none;width:600px}}"
)


def page_of(file: Path, held: Contents, shown: Sequence[Shown]) -> str:
    """What a file holds and what would be read of it, as HTML."""
    facts = _listed(f"{name}: {value}" for name, value in held.facts.items())
    return Markup(
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        "{6}<title>{0}</title><style>{1}</style><h1>{0}</h1><p>{2}</p>{3}<ul>{4}</ul>{5}</html>\n"
    ).format(
        file.name,
        Markup(_STYLE),
        held.format,
        described(held),
        facts,
        Markup("").join(map(_record, shown)),
        Markup(GENERATOR),
    )


def _listed(lines: Iterable[object], look: str = "") -> Markup:
    """Lines as entries of a list. look: their class in the style sheet."""
    return Markup("").join(Markup('<li class="{}">{}</li>').format(look, str(line)) for line in lines)


def _record(one: Shown) -> Markup:
    lines = _listed(one.lines) + _listed(one.doubts, "doubt")
    drawing = Drawings(None).add(one.name, one.reading, partial(_drawn, one))
    return Markup("<h2>{}</h2><ul>{}</ul>{}").format(one.name, lines, drawing)


def _drawn(one: Shown) -> Figure:
    t, y, window = one.t, one.y, one.kept
    every = max(1, t.size // _POINTS)
    figure = Figure(figsize=(WIDTH, 2.6))
    axes = figure.add_subplot()
    axes.plot(t[::every], y[::every], color=QUIET, linewidth=0.8)
    if window is not None:
        inside = (t >= window[0]) & (t <= window[1])
        axes.plot(np.where(inside, t, np.nan)[::every], y[::every], color=_KEPT, linewidth=0.9)
    axes.set(xlabel="time in s", ylabel=one.name[:40].replace("$", r"\$"))
    return figure
