"""How strong the damping is against the amplitude: the equivalent damping ratio, per cent."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report.style import INK, WIDTH, colour


def amplitude(model: str, amplitudes: np.ndarray, ratio: np.ndarray, reference: float, unit: str) -> Figure:
    """ratio: its quantiles 2.5, 50 and 97.5 % at the amplitudes, shape (3, m); reference: amplitude of the tables, both
    in `unit`."""
    figure = Figure(figsize=(WIDTH * 0.5, 2.2))
    ax = figure.add_subplot()
    low, median, high = 100.0 * ratio
    ax.fill_between(amplitudes, low, high, color=colour(model), alpha=0.22, lw=0)
    ax.plot(amplitudes, median, color=colour(model), lw=1.3)
    ax.axvline(reference, color=INK, lw=0.7, ls=(0, (1, 2)))
    ax.set_xlabel(f"amplitude / {unit}")
    ax.set_ylabel("equivalent\ndamping ratio / %")
    ax.set_ylim(0, 1.25 * float(np.nanmax(high)) or 1.0)
    return figure
