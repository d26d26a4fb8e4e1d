"""How a fit's coefficients move with the part of the record that it sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import WIDTH, colour
from bayesdamp.store.contents.candidates import Part


def windows(model: str, names: Sequence[str], found: Sequence[Part], units: Mapping[str, str]) -> Figure:
    """found: windows with label, values and sd by parameter; the first, the whole record, is a band too."""
    figure = Figure(figsize=(WIDTH, 0.27 * len(found) + 0.85))
    axes = np.atleast_1d(figure.subplots(1, len(names), sharey=True))
    for ax, name in zip(axes, names):
        values = [_number(w.values.get(name)) for w in found]
        errors = [_number(w.sd.get(name)) for w in found]
        if np.isfinite(values[0]) and np.isfinite(errors[0]):
            ax.axvspan(values[0] - errors[0], values[0] + errors[0], color=colour(model), alpha=0.18, lw=0)
        ax.errorbar(
            values,
            range(len(found)),
            xerr=np.nan_to_num(errors),
            fmt="o",
            ms=4,
            color=colour(model),
            lw=1.0,
        )
        ax.set_xlabel(words.axis(name, units.get(name, "")))
        ax.locator_params(axis="x", nbins=5)
        ax.margins(x=0.12)
        ax.tick_params(axis="y", length=0)
    axes[0].set_yticks(range(len(found)), [w.label for w in found])
    axes[0].set_ylim(len(found) - 0.4, -0.6)
    return figure


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else np.nan
