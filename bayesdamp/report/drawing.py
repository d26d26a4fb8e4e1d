"""Draw figures in one style, save them as SVG or PNG, and embed them in the report.

The colours are Okabe and Ito's palette for colour-blind readers.
"""

import base64
import io
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator
from PIL import Image

from bayesdamp.store.files import write_bytes
from bayesdamp.types import candidate_parts

INK = "#222222"
MUTED = "#8a8a8a"
FAINT = "#d9d9d9"
"""`INK`, `MUTED` and `FAINT` are greys for lines and text, from the most to the least prominent."""

WIDTH = 9.6
"""Width in inches of a figure that fills the width of the page; an inch has 100 CSS pixels there."""

RC = mpl.rc_params_from_file(
    Path(__file__).parent / "templates" / "figures.mplstyle", use_default_template=False
)
"""Matplotlib settings of all figures, for `matplotlib.rc_context`."""

_MODELS = {
    frozenset({"viscous"}): ("#0072B2", "-"),
    frozenset({"coulomb"}): ("#D55E00", "--"),
    frozenset({"quadratic"}): ("#009E73", "-."),
    frozenset({"viscous", "coulomb"}): ("#CC79A7", "-"),
    frozenset({"viscous", "quadratic"}): ("#56B4E9", "--"),
    frozenset({"coulomb", "quadratic"}): ("#E69F00", "-."),
    frozenset({"viscous", "coulomb", "quadratic"}): ("#332288", "--"),
}
"""Colours and line styles of the seven sums of viscous, Coulomb and quadratic damping, by their sets of terms."""
_OTHERS = ("#7F3C8D", "#80BA5A", "#A5AA99", "#8C564B")
"""Colours of the sums of damping terms that are not in `_MODELS`; several of these sums may have the same colour."""
INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8C564B", "#7F3C8D", INK)
"""Colours that distinguish several records, oscillations or methods in one figure."""
DASHES = ("-", "--", "-.", ":")
"""Line styles that distinguish up to four lines in one figure."""
LOOKS = tuple(zip(INKS, DASHES))
"""Pairs of a colour and a line style that distinguish up to four samplers or oscillations in one figure."""
LETTERS_PER_INCH, MARK_LETTERS = 12.5, 7
"""Number of letters of a legend that fit in an inch; and the width, in letters, of the line and the gap that each entry
needs besides its text (both measured)."""
RIGHT_MARGIN = 0.2
"""Space to the right of the panels of a figure, in inches."""
LARGEST_SVG = 80_000
"""Largest size in bytes of an SVG that is embedded in the page; a larger figure is a PNG, in the page and as a file."""
NARROW_WIDTH, LEAST_ZOOM = 440, 0.8
"""A figure that is wider than `NARROW_WIDTH` CSS pixels scrolls sideways on a phone, so that it is never scaled below
`LEAST_ZOOM`, where its letters would be too small to read."""
DPI = 150
"""Resolution of a PNG in dots per inch."""


def colour(model: str) -> str:
    """Return the colour (#RRGGBB) of a model, such as `viscous+coulomb@pendulum`, by its damping sum alone.

    Neither the restoring law (after @) nor the order of the terms has an effect. Sums of viscous, Coulomb and quadratic
    damping have the colours of `_MODELS`. The colour of any other sum is one of `_OTHERS`, chosen by its name.
    """
    return _look(model)[0]


def dash(model: str) -> str:
    """Return Matplotlib's line style, such as "--", of a model; like the colour, it depends on its damping sum alone.

    The style is solid, dashed or dash-dotted for the sums in `_MODELS`, and dotted for all others. Several sums have
    the same style.
    """
    return _look(model)[1]


def _look(model: str) -> tuple[str, str]:
    """Return the colour (see `colour`) and the line style (see `dash`) of a model."""
    damping = candidate_parts(model)[0]
    known = _MODELS.get(frozenset(damping.split("+")))
    return known or (_OTHERS[sum(damping.encode()) % len(_OTHERS)], ":")


def legend_columns(labels: Sequence[str], width: float, most: int) -> int:
    """Return the number of columns of a legend: as many as fit a figure of this width in inches, from 1 to `most`.

    There are no more columns than labels. One column is returned even if it is too wide.
    """
    longest = max(map(len, labels), default=1)
    return max(1, min(len(labels), most, int(LETTERS_PER_INCH * width / (longest + MARK_LETTERS))))


def label_with_plain_numbers(axis: Axis) -> None:
    """Label an axis of amplitudes with plain numbers (format `g`) at powers of ten and at 2, 4 and 6 times these.

    axis: axis of a Matplotlib plot (`ax.xaxis` in the report's figures), which must already be logarithmic.
    """
    for set_formatter in (axis.set_major_formatter, axis.set_minor_formatter):
        set_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_locator(LogLocator(subs=(2, 4, 6)))


def fix_margins(
    figure: Figure, left: float = 0.8, top: float = 0.42, bottom: float = 0.5, down: float = 0.0
) -> None:
    """Place a figure's panels between fixed margins, which is faster than a layout that measures every label.

    Parameters
    ----------
    figure
        The figure, which is changed; its panels are in rows and columns of equal size.
    left, top, bottom
        Space to the left of, above and below the panels, in inches; `left` is also the space between columns.
        The right margin is `RIGHT_MARGIN`.
    down
        Space between rows, in inches.
    """
    figure.set_layout_engine("none")
    width, height = figure.get_size_inches()
    for ax in figure.axes:
        place = ax.get_subplotspec()
        assert place is not None
        rows, columns = place.get_gridspec().get_geometry()
        wide = (width - RIGHT_MARGIN) / columns  # width of a column with the space at its left
        high = (height - top - bottom + down) / rows  # height of a row with the space below it
        first, last = place.colspan.start, place.colspan.stop
        ax.set_position((
            (left + first * wide) / width, (bottom + (rows - place.rowspan.stop) * high) / height,
            ((last - first) * wide - left) / width, (high - down) / height,
        ))  # fmt: skip


class Drawings:
    """Embed the figures of a report in its page, and save them in a folder if one is given.

    folder: where the figures are saved; None to save none. files: names of the files of all figures so far.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.files: list[str] = []
        self._draws = True

    @contextmanager
    def left_out(self, is_so: bool) -> Iterator[None]:
        """Draw no figures within this context if `is_so` is True."""
        self._draws = not is_so
        yield
        self._draws = True

    def add(self, name: str, caption: str, draw: Callable[[], Figure]) -> Markup:
        """Draw a figure in the common style, and return the HTML that shows it.

        If there is a folder, the figure is also saved there, in the same format. Within `left_out`, nothing is drawn,
        and the HTML is empty.

        Parameters
        ----------
        name
            Name of the file without its ending; characters that a file name should not contain are replaced.
        caption
            Plain text below the figure, which is also its alternative text.
        draw
            Function that draws the figure and returns it.

        Returns
        -------
        Markup
            The HTML, which contains the figure as SVG, or as PNG if the SVG is larger than `LARGEST_SVG`. A figure that
            is wider than `NARROW_WIDTH` scrolls sideways on a phone.
        """
        if not self._draws:
            return Markup()
        name = re.sub(r"[^\w.=+-]+", "-", name)
        with mpl.rc_context(RC):
            figure = draw()
            kind, content = "svg+xml", _svg(figure)
            if len(content) > LARGEST_SVG:
                kind, content = "png", _png(figure)
        self.files.append(f"{name}.{kind[:3]}")
        if self.folder is not None:
            write_bytes(self.folder / self.files[-1], content)
        width = round(figure.get_figwidth() * 100)
        return Markup(
            '<figure{}><div><img src="data:image/{};base64,{}" alt="{}" style="width:{}px;--least:{}px"></div>'
            "<figcaption>{}</figcaption></figure>"
        ).format(
            Markup(' class="wide"' if width > NARROW_WIDTH else ""), kind, base64.b64encode(content).decode(),
            caption, width, round(LEAST_ZOOM * width), caption,
        )  # fmt: skip


def _svg(figure: Figure) -> bytes:
    """Return the content of a figure's SVG file. The layout of the figure is then fixed."""
    svg = io.BytesIO()
    FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": "bayesdamp"})
    figure.set_layout_engine("none")
    # Formulas need further fonts.
    text = svg.getvalue().decode().replace("'DejaVu Sans';", "'DejaVu Sans', Verdana, sans-serif;")
    # Matplotlib derives the names of markers from memory addresses; numbers make the file reproducible.
    marks = dict.fromkeys(re.findall(r'id="([a-z][0-9a-f]{10})"', text))
    names = {mark: f"mark{i}" for i, mark in enumerate(marks)}
    text = re.sub(r"\b[a-z][0-9a-f]{10}\b", lambda match: names.get(match[0], match[0]), text)
    # Round coordinates to a hundredth of a point, which makes the file shorter.
    number = re.compile(r"-?\d+\.\d{3,}")
    return re.sub(
        r' d="[^"]*"',
        lambda path: number.sub(lambda x: f"{float(x[0]):.2f}".rstrip("0").rstrip("."), path[0]),
        text,
    ).encode()


def _png(figure: Figure) -> bytes:
    """Return the content of a figure's PNG file."""
    figure.set_dpi(DPI)
    canvas, png = FigureCanvasAgg(figure), io.BytesIO()
    canvas.draw()
    # A palette makes the file three times smaller, because a figure has few colours. The method "maximum coverage"
    # preserves the colour of thin lines; the default (median cut) would replace it by shades of broad lines.
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    pixels.quantize(method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(png, "PNG")
    return png.getvalue()
