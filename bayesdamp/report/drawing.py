"""Draw figures in one style, save them as SVG and PNG, and embed them in the report.

The colours are Okabe and Ito's palette for colour-blind readers.
"""

from __future__ import annotations

import base64
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib import rc_params_from_file
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator
from PIL import Image

from bayesdamp.store import write_bytes
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
INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8C564B", "#7F3C8D", INK)
"""Colours of records, oscillations or methods that are drawn together."""
LOOKS = tuple(zip(INKS, ("-", "--", "-.", ":")))
"""Colour and line style of each sampler or oscillation of a few."""
PALER = 0.45
"""Share of the way to white by which each further candidate of one damping sum is paler."""
LETTERS, MARK = 12.5, 7
"""Letters per inch of a legend, and the length of an entry's line and gap in letters."""
RIGHT = 0.2
"""Space at the right of a figure, in inches."""
HOLE = 20.0
"""Sampling intervals (medians) above which a gap is drawn as a hole."""
SVG = 80_000
"""Largest size in bytes of an SVG in the page; figures with thousands of points are larger, and embedded as PNG."""
NARROW, LEGIBLE = 440, 0.8
"""Width in CSS pixels above which a figure scrolls sideways on a phone, and the scale below which its letters
are too small to read."""
DPI = 150
"""Resolution of a PNG."""


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


def plain(axis: Axis, decades: bool = True) -> None:
    """Label a logarithmic axis of amplitudes with plain numbers instead of powers of ten.

    `decades` says whether the axis is so long that only a few numbers between two powers of ten have room.
    """
    for set_formatter in (axis.set_major_formatter, axis.set_minor_formatter):
        set_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(LogLocator(subs=(2, 4, 6) if decades else range(2, 10)))


def fix_margins(
    figure: Figure, left: float = 0.8, top: float = 0.42, bottom: float = 0.5, down: float = 0.0
) -> None:
    """Place a figure's panels between fixed margins, which is faster than a layout that measures every label.

    Parameters
    ----------
    figure
        With panels in rows and columns of equal size.
    left, top, bottom
        Space beside, above and below the panels, in inches; `left` is also the space between columns.
    down
        Space between rows, in inches.
    """
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    for ax in figure.axes:
        place = ax.get_subplotspec()
        assert place is not None
        rows, columns = place.get_gridspec().get_geometry()
        wide = (width - RIGHT) / columns  # of a column, with the space at its left
        high = (height - top - bottom + down) / rows  # of a row, with the space below it
        first, last = place.colspan.start, place.colspan.stop
        ax.set_position((
            (left + first * wide) / width, (bottom + (rows - place.rowspan.stop) * high) / height,
            ((last - first) * wide - left) / width, (high - down) / height,
        ))  # fmt: skip


class Drawings:
    """Put a report's figures into the page, and into a folder if there is one."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.names: list[str] = []

    def add(self, name: str, caption: str, draw: Callable[[], Figure]) -> Markup:
        """Draw a figure in the common style, save it as SVG and PNG, and return the HTML that shows it.

        Parameters
        ----------
        name
            Name of the files; characters that a file name should not contain are replaced.
        caption
            Text below the figure.
        draw
            Returns the figure.

        Returns
        -------
        Markup
            The HTML, with the figure embedded. A wide figure scrolls sideways on a phone.
        """
        name = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", name)
        with mpl.rc_context(RC):
            figure = draw()
            svg, png = _encode(figure)
        if self.folder is not None:
            write_bytes(self.folder / f"{name}.svg", svg)
            write_bytes(self.folder / f"{name}.png", png)
        self.names.append(name)
        kind, content = ("svg+xml", svg) if len(svg) <= SVG else ("png", png)
        width = round(figure.get_figwidth() * 100)
        return Markup(
            '<figure{}><div><img src="data:image/{};base64,{}" alt="{}" style="width:{}px;--least:{}px"></div>'
            "<figcaption>{}</figcaption></figure>"
        ).format(
            Markup(' class="wide"' if width > NARROW else ""), kind, base64.b64encode(content).decode(),
            caption, width, round(LEGIBLE * width), caption,
        )  # fmt: skip

    def show(self, name: str, caption: str, png: bytes, embed: bool) -> Markup:
        """Save a figure that is already a PNG, and return the HTML that shows it.

        `embed` says whether the page contains the figure; otherwise it links to the file.
        """
        source = f"figures/{name}.png"
        if self.folder is not None:
            write_bytes(self.folder / f"{name}.png", png)
        if embed or self.folder is None:
            source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
        self.names.append(name)
        picture = Markup('<img loading="lazy" src="{}" alt="{}">').format(source, caption)
        return Markup("<figure>{}<figcaption>{}</figcaption></figure>").format(picture, caption)


def _encode(figure: Figure) -> tuple[bytes, bytes]:
    """Return a figure as SVG and PNG.

    It is laid out once and printed directly, because `savefig` would lay it out and draw it for each format.
    """
    figure.set_dpi(DPI)
    canvas = FigureCanvasAgg(figure)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    canvas.draw()
    svg, png = io.BytesIO(), io.BytesIO()
    # A figure has few colours and their shades, and a palette makes the file three times smaller. Maximum coverage
    # keeps the colour of a thin line, which a median cut would give to the shades of a broad one.
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    pixels.quantize(method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(png, "PNG")
    FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": "bayesdamp"})
    # Matplotlib names marks after memory addresses; numbers make the file reproducible.
    text = svg.getvalue().decode()
    marks = dict.fromkeys(re.findall(r'id="([a-z][0-9a-f]{10})"', text))
    names = {mark: f"mark{i}" for i, mark in enumerate(marks)}
    text = re.sub(r"\b[a-z][0-9a-f]{10}\b", lambda match: names.get(match[0], match[0]), text)
    # Coordinates to a hundredth of a point make it shorter.
    number = re.compile(r"-?\d+\.\d{3,}")
    text = re.sub(
        r' d="[^"]*"',
        lambda path: number.sub(lambda x: f"{float(x[0]):.2f}".rstrip("0").rstrip("."), path[0]),
        text,
    )
    return text.encode(), png.getvalue()
