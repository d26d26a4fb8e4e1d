"""Figures on disk as SVG and PNG, and inside the report."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bayesdamp.report.style import RC
from bayesdamp.store import write_bytes

_LARGEST_SVG = 600_000
"""Bytes above which the report holds the PNG instead, so that it opens fast."""


class Drawings:
    """Where a report's figures go."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: list[str] = []

    def add(self, name: str, caption: str, draw: Callable[[], Figure]) -> Markup:
        """Draw under the common style, save `name`.svg and `name`.png, and give the HTML that shows it."""
        name = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", name)
        with mpl.rc_context(RC):
            figure = draw()
            FigureCanvasAgg(figure)
            # lay out once, not at every save
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
            svg, png = _saved(figure, "svg"), _saved(figure, "png")
        write_bytes(self.folder / f"{name}.svg", svg)
        write_bytes(self.folder / f"{name}.png", png)
        self.names.append(name)
        kind, data = ("svg+xml", svg) if len(svg) <= _LARGEST_SVG else ("png", png)
        source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
        width = round(figure.get_figwidth() * 100)
        return Markup(
            f'<figure><img src="{source}" alt="{escape(caption)}" style="width:{width}px">'
            f"<figcaption>{escape(caption)}</figcaption></figure>"
        )


def _saved(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    metadata = {"Date": None, "Creator": "bayesdamp"} if kind == "svg" else {"Software": "bayesdamp"}
    figure.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()
