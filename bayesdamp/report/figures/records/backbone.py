"""Damping ratio and frequency against amplitude: the record's own, and those of the candidates over it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report import words
from bayesdamp.report.style import INK, WIDTH, legend_above, looks

FEW = 4
"""Points of the record, below which its candidates say what is shown."""


def backbone(
    record: Mapping[str, np.ndarray],
    candidates: Mapping[str, Mapping[str, np.ndarray]],
    scale: float,
    unit: str,
) -> Figure:
    """record: amplitude, ratio, frequency and the sds ratio_sd and frequency_sd, each (k,); candidates: name to
    amplitude, ratio and frequency, each (m,). Amplitudes times `scale` are in `unit`."""
    figure = Figure(figsize=(WIDTH, 3.0))
    for ax, name, axis in zip(
        figure.subplots(1, 2), ("ratio", "frequency"), ("damping ratio", "frequency / (rad/s)"), strict=True
    ):
        x, y, sd = scale * record["amplitude"], record[name], record[f"{name}_sd"]
        ax.errorbar(x, y, 2 * sd, fmt="o", ms=3.5, lw=0.9, color=INK, label="record, ± 2 sd", zorder=3)
        for i, (model, (shade, dashes)) in enumerate(looks(candidates).items()):
            curve = candidates[model]
            ax.plot(
                scale * curve["amplitude"],
                curve[name],
                color=shade,
                ls=dashes,
                lw=1.2,
                zorder=2 - 0.01 * i,  # the most probable on top
                label=words.model(model),
            )
        shown = [y, *(c[name] for c in candidates.values())]
        seen = np.concatenate([v[np.isfinite(v)] for v in shown])
        good = y[np.isfinite(y) & (sd < 0.5 * np.abs(y))]
        # Few points do not say how far a picture should reach: the candidates do.
        low, high = (good.min(), good.max()) if good.size >= FEW else (seen.min(), seen.max())
        room = 0.35 * (high - low) + 0.01 * abs(high)
        ax.set_ylim(max(low - room, 0.0), high + room)
        ax.set_xlabel(f"amplitude / {unit}")
        ax.set_ylabel(axis)
    legend_above(figure)
    return figure
