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
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator

from bayesdamp.types import candidate_parts

INK = "#222222"
QUIET = "#8a8a8a"
FAINT = "#d9d9d9"

WIDTH = 9.6
"""Width of a full figure in inches; the report shows it at its natural size."""

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
RIGHT = 0.12
"""Space at the right of a figure, in inches."""
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


def fix_margins(
    figure: Figure, left: float = 0.8, top: float = 0.42, bottom: float = 0.5, down: float = 0.0
) -> None:
    """Place a figure's panels between fixed margins, which is faster than a layout that measures every label.

    Parameters
    ----------
    figure
        With panels in rows and columns of equal size, and layout="none".
    left, top, bottom
        Space beside, above and below the panels, in inches; `left` is also the space between columns.
    down
        Space between rows, in inches.
    """
    specification = figure.axes[0].get_subplotspec()
    assert specification is not None
    rows, columns = specification.get_gridspec().get_geometry()
    width, height = figure.get_size_inches()
    figure.subplots_adjust(
        left=left / width,
        right=1.0 - RIGHT / width,
        bottom=bottom / height,
        top=1.0 - top / height,
        wspace=left * columns / (width - RIGHT - left * columns),
        hspace=down * rows / (height - top - bottom - down * (rows - 1)),
    )
