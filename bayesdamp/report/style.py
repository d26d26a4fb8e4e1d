"""The look of every figure, and one colour a model (Okabe and Ito's palette for colour-blind readers)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from bayesdamp.types import candidate_parts

INK = "#222222"
QUIET = "#8a8a8a"
FAINT = "#d9d9d9"

WIDTH = 9.6
"""Width of a full figure in inches; the report shows it at its natural size."""

RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": QUIET,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "lines.linewidth": 1.2,
    "lines.solid_capstyle": "round",
    "svg.fonttype": "path",
    "svg.hashsalt": "bayesdamp",
}

_MODELS = {
    frozenset({"viscous"}): ("#0072B2", "-"),
    frozenset({"coulomb"}): ("#D55E00", "--"),
    frozenset({"quadratic"}): ("#009E73", "-."),
    frozenset({"viscous", "coulomb"}): ("#CC79A7", "-"),
    frozenset({"viscous", "quadratic"}): ("#56B4E9", "--"),
    frozenset({"coulomb", "quadratic"}): ("#E69F00", "-."),
    frozenset({"viscous", "coulomb", "quadratic"}): ("#000000", "-"),
}
_OTHERS = ("#7F3C8D", "#80BA5A", "#A5AA99", "#8C564B")


def colour(model: str) -> str:
    """The colour of a model; models with terms that do not ship share four further colours."""
    return _look(model)[0]


def dash(model: str) -> str:
    """The line style of a model, for readers without colour."""
    return _look(model)[1]


def _look(model: str) -> tuple[str, str]:
    known = _MODELS.get(frozenset(candidate_parts(model)[0].split("+")))
    return known or (_OTHERS[sum(model.encode()) % len(_OTHERS)], ":")


PALER = 0.45
"""By which share of the way to white a sum's next candidate is paler than the one before."""


def looks(models: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Colour and line style of each of the candidates in one figure: those of one damping sum under several restoring
    laws have its colour, ever paler."""
    found: dict[str, tuple[str, str]] = {}
    before: Counter[frozenset[str]] = Counter()
    for model in models:
        terms = frozenset(candidate_parts(model)[0].split("+"))
        ink = (1.0 - PALER) ** before[terms]
        red, green, blue = (1.0 - ink * (1.0 - part) for part in to_rgb(colour(model)))
        found[model] = to_hex((red, green, blue)), dash(model)
        before[terms] += 1
    return found


LETTERS, MARK = 12.5, 7
"""Letters to an inch of a legend, and for how many an entry's line and gap stand."""


ROW = 0.17
"""Inches that a legend's row takes."""


def legend_above(figure: Figure, most: int = 3) -> None:
    """The first axes' legend above the figure, which grows by its rows beyond two."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    columns = legend_columns(labels, figure.get_figwidth(), most)
    more = math.ceil(len(labels) / columns) - 2
    if more > 0:
        figure.set_figheight(figure.get_figheight() + more * ROW)
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def legend_columns(labels: Sequence[str], width: float, most: int) -> int:
    """How many columns of a legend a figure has room for. width: of the figure, in inches."""
    longest = max(map(len, labels), default=1)
    return max(1, min(len(labels), most, int(LETTERS * width / (longest + MARK))))
