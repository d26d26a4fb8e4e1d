"""Errors of all methods on all signals as a map of colours."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures._panels import ABREAST
from bayesdamp.report.results.comparing import STAGES, Comparison
from bayesdamp.report.style import INK, QUIET, WIDTH

LOW, HIGH = 1e-6, 1e2
"""Ends of the scale, per cent."""


def heatmap(found: Comparison) -> Figure:
    """One map a stage, logarithmic; a dash where a method has no answer."""
    stages = [s for s in STAGES if any(key[2] == s for key in found.errors)]
    stacked = len(found.signals) > ABREAST
    rows = len(stages) if stacked else 1
    height = 0.32 * len(found.methods) + (0.4 if stacked else 0.9)
    figure = Figure(figsize=(WIDTH, rows * height + (0.8 if stacked else 0.0)))
    grid = figure.subplots(rows, 1 if stacked else len(stages), sharex=stacked, sharey=True, squeeze=False)
    axes = list(grid.flat)
    norm = LogNorm(LOW, HIGH)
    image = None
    for ax, stage in zip(axes, stages):
        errors = np.array([
            [found.errors.get((m, s, stage), np.nan) for s in found.signals] for m in found.methods
        ])  # fmt: skip
        image = ax.imshow(np.clip(errors, LOW, HIGH), norm=norm, cmap="RdYlBu_r", aspect="auto")
        for (i, j), error in np.ndenumerate(errors):
            # Dark on the pale middle of the scale, white on its ends.
            place = float(norm(np.clip(error, LOW, HIGH))) if np.isfinite(error) else 0.5
            shade = "white" if abs(place - 0.5) > 0.36 else INK if np.isfinite(error) else QUIET
            text = fmt.short(error) if np.isfinite(error) else fmt.NONE
            ax.text(j, i, text, ha="center", va="center", fontsize=7.5, color=shade)
        slanted = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"} if stacked else {}
        ax.set_xticks(range(len(found.signals)), found.signals, **slanted)
        ax.set_title(words.stage(stage))
        ax.tick_params(length=0)
        for spine in ax.spines.values():
            spine.set_visible(False)
    for ax in grid[:, 0]:
        ax.set_yticks(range(len(found.methods)), [words.method(m) for m in found.methods])
    if image is not None:
        figure.colorbar(image, ax=axes, label="error / %", fraction=0.03, pad=0.015)
    return figure
