"""Save figures as SVG and PNG, and embed them in the report."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from bayesdamp.report.style import RC
from bayesdamp.store import write_bytes

SVG = 80_000
"""Largest size in bytes of an SVG in the page; figures with thousands of points are larger, and embedded as PNG."""
NARROW, LEGIBLE = 440, 0.8
"""Width in CSS pixels above which a figure scrolls sideways on a phone, and the scale below which its letters
are too small to read."""
DPI = 150
"""Resolution of a PNG."""


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
