"""Draw estimates against the posterior, and what methods found besides: forces and eigenvalues."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.figures._panels import ABREAST, NARROW, off_axis
from bayesdamp.report.results.estimates import CoefficientEstimates
from bayesdamp.report.style import FAINT, INK, QUIET, WIDTH, colour


def traces(found: Mapping[str, np.ndarray]) -> Figure:
    """found: title to curve, shape (n,). Logarithmic where all values are positive and span two decades."""
    columns = min(4, len(found))
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(WIDTH * max(0.3, columns / 4), 1.6 * rows + 0.1))
    for i, (title, curve) in enumerate(found.items()):
        ax = figure.add_subplot(rows, columns, i + 1)
        ax.plot(np.arange(len(curve)), curve, color=INK, lw=0.9)
        finite = curve[np.isfinite(curve)]
        if finite.size and finite.min() > 0 and finite.max() > 100 * finite.min():
            ax.set_yscale("log")
            ax.yaxis.set_minor_formatter(NullFormatter())
        ax.set_title(title, fontsize=8)
        ax.set_xlabel("iteration")
    return figure


REACH = 3.0
"""Half the axis, in half widths of the posterior's interval: it fills the middle third."""
ALONE = 0.06
"""The same without a posterior, as a share of the truth or of the middle estimate."""
ROW, ROW_PUBLISHED = 0.31, 0.40
"""Inches a method takes, with two and with three marks."""


def against(found: Sequence[CoefficientEstimates], abreast: int = ABREAST, narrow: bool = False) -> Figure:
    """Draw a panel a coefficient, `abreast` in a row, with a line a method; what is off the axis is an arrow.

    narrow: panels below each other, for a phone.
    """
    abreast = 1 if narrow else min(abreast, len(found))
    methods = list(dict.fromkeys(m for one in found for m in one.methods))
    published = any(one.published for one in found)
    height = (ROW_PUBLISHED if published else ROW) * len(methods) + 0.85
    rows = -(-len(found) // abreast)
    figure = Figure(figsize=(WIDTH if abreast > 1 else NARROW, rows * height + 0.45))
    axes = list(figure.subplots(rows, abreast, sharey=True, squeeze=False).flat)
    for spare in axes[len(found) :]:
        spare.set_visible(False)
    for ax, one in zip(axes, found):
        _panel(ax, one, methods)
    axes[0].set_yticks(range(len(methods)), [words.method(m) for m in methods])
    handles = _handles(found, published)
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles) if abreast > 1 else 2)
    return figure


def _panel(ax: Axes, one: CoefficientEstimates, methods: Sequence[str]) -> None:
    shade = colour(one.model)
    low, high = _window(one)
    if one.posterior is not None:
        ax.axvspan(*one.posterior, color=shade, alpha=0.18, lw=0, zorder=0.2)
    if np.isfinite(one.truth):
        ax.axvline(one.truth, color=INK, lw=0.9, ls=(0, (2, 2)))
    apart = 0.26 if one.published else 0.15
    for row, method in enumerate(methods):
        ax.axhline(row, color=FAINT, lw=0.5, zorder=0.1)
        own, refined = one.own.get(method, np.nan), one.refined.get(method, np.nan)
        marks = [(own, "white", -apart), (refined, shade, 0.0 if one.published else apart)]
        for value, face, shift in marks:
            if low <= value <= high:
                ax.plot(value, row + shift, "o", ms=4.4, mfc=face, mec=shade, mew=1.0)
            elif np.isfinite(value):
                off_axis(ax, fmt.number(value, 3), value < low, row + shift)
        error = one.published.get(method, np.nan)
        ends = [one.truth * (1 + sign * error / 100) for sign in (-1, 1)]
        if low <= ends[0] and ends[1] <= high:
            ax.plot(ends, [row + apart] * 2, "|", ms=7, mec=INK, mew=1.2)
        elif np.isfinite(error):
            off_axis(ax, f"published ± {error:g} %", False, row + apart)
    ax.set(
        xlim=(low, high),
        ylim=(len(methods) - 0.4, -0.6),
        title=f"{one.signal}, {words.model(one.model)}" if one.signal != one.model else one.signal,
        xlabel=words.axis(one.parameter, one.unit),
    )
    ax.locator_params(axis="x", nbins=4)
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)


def _window(one: CoefficientEstimates) -> tuple[float, float]:
    values = [*one.own.values(), *one.refined.values()]
    middle = one.truth if np.isfinite(one.truth) else float(np.median(values))
    if one.posterior is None:
        reach = ALONE * abs(middle) or 1.0
        return middle - reach, middle + reach
    low, high = one.posterior
    middle = 0.5 * (low + high)
    reach = REACH * 0.5 * (high - low) or ALONE * abs(middle) or 1.0
    if np.isfinite(one.truth):
        reach = max(reach, 1.2 * abs(one.truth - middle))
    return middle - reach, middle + reach


def _handles(found: Sequence[CoefficientEstimates], published: bool) -> list[Line2D | Patch]:
    shade = colour(found[0].model) if len({one.model for one in found}) == 1 else QUIET
    kinds: list[Line2D | Patch] = [
        Line2D([], [], ls="", marker="o", ms=4.5, mfc="white", mec=shade, label="own estimate"),
        Line2D([], [], ls="", marker="o", ms=4.5, mfc=shade, mec=shade, label=words.stage("refined")),
    ]
    if published:
        kinds.append(Line2D([], [], ls="", marker="|", ms=8, mec=INK, mew=1.2, label="published error"))
    if any(one.posterior for one in found):
        kinds.append(Patch(color=shade, alpha=0.25, lw=0, label="posterior, 95 %"))
    if any(np.isfinite(one.truth) for one in found):
        kinds.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth"))
    return kinds


def eigenvalues(real: Sequence[float], imaginary: Sequence[float], model: str) -> Figure:
    """Of the generator, 1/s: decay to the left, rad/s upwards."""
    figure = Figure(figsize=(4.6, 2.5))
    ax = figure.add_subplot()
    ax.axvline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.axhline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.plot(real, imaginary, "x", ms=6, mew=1.4, color=colour(model))
    ax.set(xlabel="real part / (1/s)", ylabel="imaginary part / (rad/s)")
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
    ax.set(xlabel=f"velocity / ({unit}/s)", ylabel=f"damping force / ({unit}/s²)")
    ax.legend(loc="upper left", labelcolor=QUIET)
    return figure
