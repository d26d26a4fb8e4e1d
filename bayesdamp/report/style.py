"""The style of every figure, one colour for each model, and what several figures draw in the same way.

The colours are Okabe and Ito's palette for colour-blind readers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.ticker import FuncFormatter, LogLocator

from bayesdamp.types import candidate_parts

INK = "#222222"
QUIET = "#8a8a8a"
FAINT = "#d9d9d9"

WIDTH, NARROW = 9.6, 4.3
"""Width of a full figure and of a figure for a phone, in inches; the report shows them at their natural size."""

RC = rc_params_from_file(Path(__file__).parent / "templates" / "figures.mplstyle", use_default_template=False)
"""The style sheet of all figures."""

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
"""Colours of models with damping terms that are not part of the package."""
PALER = 0.45
"""Share of the way to white by which each further candidate of one damping sum is paler."""
LETTERS, MARK = 12.5, 7
"""Letters per inch of a legend, and the length of an entry's line and gap in letters."""
HOLE = 20.0
"""Sampling intervals (medians) above which a gap is drawn as a hole."""


def colour(model: str) -> str:
    """Return the colour of a model; models with terms of a user share four further colours."""
    return _look(model)[0]


def dash(model: str) -> str:
    """Return the line style of a model, for readers who do not see its colour."""
    return _look(model)[1]


def _look(model: str) -> tuple[str, str]:
    known = _MODELS.get(frozenset(candidate_parts(model)[0].split("+")))
    return known or (_OTHERS[sum(model.encode()) % len(_OTHERS)], ":")


def looks(models: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the colour and line style of each candidate in one figure.

    Candidates with the same damping sum under several restoring laws have one colour, each paler than the last.
    """
    styles: dict[str, tuple[str, str]] = {}
    before: Counter[frozenset[str]] = Counter()
    for model in models:
        terms = frozenset(candidate_parts(model)[0].split("+"))
        ink = (1.0 - PALER) ** before[terms]
        red, green, blue = (1.0 - ink * (1.0 - part) for part in to_rgb(colour(model)))
        styles[model] = to_hex((red, green, blue)), dash(model)
        before[terms] += 1
    return styles


def legend_columns(labels: Sequence[str], width: float, most: int) -> int:
    """Return how many columns, at most `most`, a legend has in a figure of this width in inches."""
    longest = max(map(len, labels), default=1)
    return max(1, min(len(labels), most, int(LETTERS * width / (longest + MARK))))


def broken(t: np.ndarray, y: np.ndarray, sampled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the line through t and y, each (n,), with a nan at each hole between the times `sampled`, (m,)."""
    gaps = np.diff(sampled)
    begins = sampled[:-1][gaps > HOLE * np.median(gaps)] if gaps.size else sampled[:0]
    places = np.searchsorted(t, begins, side="right")
    return np.insert(t, places, begins), np.insert(np.asarray(y, float), places, np.nan)


def plain(ax: Axes) -> None:
    """Label a logarithmic axis of amplitudes with plain numbers instead of powers of ten."""
    for set_formatter in (ax.xaxis.set_major_formatter, ax.xaxis.set_minor_formatter):
        set_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    ax.xaxis.set_minor_locator(LogLocator(subs=(2, 4, 6)))
