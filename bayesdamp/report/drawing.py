"""Figures on disk as SVG and PNG, and inside the report."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from bayesdamp.report.style import RC
from bayesdamp.store import write_bytes

PHONE = 640
"""Width in CSS pixels up to which a page is a phone's, as in style.css."""
SVG = 80_000
"""Bytes up to which a figure stands in the page as SVG: beyond are those with thousands of samples."""
NARROW, LEGIBLE = 440, 0.8
"""Width in CSS pixels from which a figure scrolls sideways on a phone, and the share of its size below which letters
cannot be read."""
COLOURS = 64
"""A figure has few colours and their shades: a PNG with a palette is a quarter of one without."""


class Drawings:
    """Where a report's figures go: into the page, and into a folder where there is one."""

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self.names: list[str] = []

    def add(self, name: str, caption: str, draw: Callable[..., Figure], narrow: bool = False) -> Markup:
        """Draw under the common style, save `name`.svg and `name`.png, and give the HTML that shows it.

        narrow: whether `draw` takes narrow=True, for a phone, in the page only; else a phone scrolls a wide figure
        sideways.
        """
        name = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", name)
        with mpl.rc_context(RC):
            figure = draw()
            svg, png, webp = _saved(figure)
            small = _saved(draw(narrow=True)) if narrow else None
        if self.folder is not None:
            write_bytes(self.folder / f"{name}.svg", svg)
            write_bytes(self.folder / f"{name}.png", png)
        self.names.append(name)
        width = round(figure.get_figwidth() * 100)
        size = f"width:{width}px;--least:{round(LEGIBLE * width)}px"
        picture = f'<img src="{_embedded(svg, png, webp)}" alt="{escape(caption)}" style="{size}">'
        if small:
            source = f'<source media="screen and (max-width: {PHONE}px)" srcset="{_embedded(*small)}">'
            picture = f"<picture>{source}{picture}</picture>"
        scrolls = ' class="wide"' if width > NARROW and not small else ""
        caption = f"<figcaption>{escape(caption)}</figcaption>"
        return Markup(f"<figure{scrolls}><div>{picture}</div>{caption}</figure>")

    def show(self, name: str, caption: str, png: bytes, embed: bool) -> Markup:
        """Save a figure that was drawn before as `name`.png, and give the HTML that shows it.

        embed: whether the page holds it, and not only a link to the file.
        """
        source = f"figures/{name}.png"
        if self.folder is not None:
            write_bytes(self.folder / f"{name}.png", png)
        if embed or self.folder is None:
            source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
        self.names.append(name)
        picture = Markup('<img loading="lazy" src="{}" alt="{}">').format(source, caption)
        return Markup("<figure>{}<figcaption>{}</figcaption></figure>").format(picture, caption)


def _embedded(svg: bytes, png: bytes, webp: bytes) -> str:
    """SVG, sharp at every size; where that is long, the smallest, so that the page opens fast."""
    kinds = [("svg+xml", svg), ("png", png), ("webp", webp)]
    kind, data = kinds[0] if len(svg) <= SVG else min(kinds, key=lambda one: len(one[1]))
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _saved(figure: Figure) -> tuple[bytes, bytes, bytes]:
    """SVG, PNG and WebP. Laid out once and printed directly: `savefig` would draw and lay out anew for each."""
    figure.set_dpi(150)
    canvas = FigureCanvasAgg(figure)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    svg = io.BytesIO()
    FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None, "Creator": "bayesdamp"})
    return _short(_renamed(svg.getvalue().decode())).encode(), *_with_palette(drawn)


def _with_palette(drawn: Image.Image) -> tuple[bytes, bytes]:
    """PNG and WebP of a drawing, without loss but for the number of its colours."""
    # Maximum coverage keeps the colour of a thin line, which a median cut gives to the shades of a broad one.
    method, dither = Image.Quantize.MAXCOVERAGE, Image.Dither.NONE
    few = drawn.quantize(COLOURS, method=method, dither=dither)
    png, webp = io.BytesIO(), io.BytesIO()
    few.save(png, "PNG")
    few.convert("RGB").save(webp, "WEBP", lossless=True, quality=50, method=3)
    return png.getvalue(), webp.getvalue()


def _short(svg: str) -> str:
    """Paths to a hundredth of a point."""
    number = re.compile(r"-?\d+\.\d{3,}")
    return re.sub(
        r' d="[^"]*"',
        lambda d: number.sub(lambda found: f"{float(found[0]):.2f}".rstrip("0").rstrip("."), d[0]),
        svg,
    )


def _renamed(svg: str) -> str:
    """Number the marks that matplotlib names after memory addresses, so that a report is reproducible."""
    marks = dict.fromkeys(re.findall(r'id="([a-z][0-9a-f]{10})"', svg))
    names = {mark: f"mark{i}" for i, mark in enumerate(marks)}
    return re.sub(r"\b[a-z][0-9a-f]{10}\b", lambda found: names.get(found[0], found[0]), svg)
