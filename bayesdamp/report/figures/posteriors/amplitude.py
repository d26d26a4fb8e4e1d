"""How strong the damping is against the amplitude: logarithmic decrement and equivalent damping ratio."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import INK, WIDTH, colour


def amplitude(
    model: str, amplitudes: np.ndarray, curves: Mapping[str, np.ndarray], reference: float, unit: str
) -> Figure:
    """curves: name to its quantiles 2.5, 50 and 97.5 % at the amplitudes, shape (3, m); reference: amplitude of the
    tables, both in `unit`."""
    figure = Figure(figsize=(WIDTH * 0.42 * len(curves), 2.2))
    for ax, (name, (low, median, high)) in zip(
        figure.subplots(1, len(curves), squeeze=False)[0], curves.items()
    ):
        ax.fill_between(amplitudes, low, high, color=colour(model), alpha=0.22, lw=0)
        ax.plot(amplitudes, median, color=colour(model), lw=1.3)
        ax.axvline(reference, color=INK, lw=0.7, ls=(0, (1, 2)))
        ax.set_xlabel(f"amplitude / {unit}")
        ax.set_ylabel(words.axis(name, ""))
        ax.set_ylim(bottom=0)
    return figure
