"""Eigenvalues of a lifted linear model, and a learnt damping force beside the law's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bayesdamp.report.style import FAINT, INK, QUIET, colour


def eigenvalues(real: Sequence[float], imaginary: Sequence[float], model: str) -> Figure:
    """Of the generator, 1/s: decay to the left, rad/s upwards."""
    figure = Figure(figsize=(4.6, 2.5))
    ax = figure.add_subplot()
    ax.axvline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.axhline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.plot(real, imaginary, "x", ms=6, mew=1.4, color=colour(model))
    ax.set_xlabel("real part / (1/s)")
    ax.set_ylabel("imaginary part / (rad/s)")
    reach = 1.15 * max((abs(x) for x in real), default=1.0) or 1.0
    ax.set_xlim(-reach, reach)
    return figure


def force(
    velocity: Sequence[float], learnt: Sequence[float], law: Sequence[float], model: str, unit: str
) -> Figure:
    """The learnt force over the velocities of the record, and the law with the coefficient read from it."""
    figure = Figure(figsize=(4.6, 2.5))
    ax = figure.add_subplot()
    ax.axhline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.plot(velocity, np.asarray(law, float), color=INK, lw=1.0, ls=(0, (3, 2)), label="law")
    ax.plot(velocity, np.asarray(learnt, float), color=colour(model), lw=1.4, label="learnt")
    ax.set_xlabel(f"velocity / ({unit}/s)")
    ax.set_ylabel(f"damping force / ({unit}/s²)")
    ax.legend(loc="upper left", labelcolor=QUIET)
    return figure
