"""Draw estimates against the posterior, errors against noise, sampling and length, and results of single methods."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.drawing import FAINT, INK, INKS, MUTED, WIDTH, colour
from bayesdamp.report.results.estimators import FACTORS, STAGES, CoefficientEstimates, ErrorSeries

SINGLE_WIDTH = 4.3
"""Width of a figure with a single panel in a row, in inches."""
MOST_IN_ROW = 4
"""Largest number of panels in a row; more would be too narrow for their labels."""
HALF_AXIS = 3.0
"""Half the length of the axis of a coefficient in `estimate_panels`, as a multiple of half the posterior's 95 %
interval; the interval then fills the middle third of the axis. The axis is longer if the true value is outside."""
HALF_AXIS_ALONE = 0.06
"""Half the length of the axis of a coefficient in `estimate_panels` if there is no posterior, as a fraction of the true
value or of the median estimate."""
ROW, APART = 0.31, 0.15
"""`ROW`: height in inches of the row of a method in `estimate_panels`. `APART`: distance of the method's two dots from
the middle of the row, as a fraction of this height."""
_MARKS = "osD^vP*Xph<>"
LOWEST_ERROR, HIGHEST_ERROR = 1e-7, 1e3
"""Range of errors, in per cent of the true value, that `sweep` draws; errors outside are drawn at its ends."""


def estimate_panels(estimates: Sequence[CoefficientEstimates]) -> Figure:
    """Draw the estimates of each coefficient in a panel with a row for each method.

    Open dots are own estimates, filled dots trajectory fits. The band is the 95 % interval of the posterior, the dashed
    line the true value. An arrow and a number replace the dot of an estimate that is off the axis.

    Parameters
    ----------
    estimates
        The estimates of each coefficient, at least one.
    """
    abreast = min(MOST_IN_ROW, len(estimates))
    methods = list(dict.fromkeys(m for e in estimates for m in e.methods))
    rows = -(-len(estimates) // abreast)
    height = rows * (ROW * len(methods) + 0.85) + 0.45
    figure = Figure(figsize=(WIDTH if abreast > 1 else SINGLE_WIDTH, height))
    axes = list(figure.subplots(rows, abreast, sharey=True, squeeze=False).flat)
    for spare in axes[len(estimates) :]:
        spare.set_visible(False)
    for ax, e in zip(axes, estimates):
        _panel(ax, e, methods)
    axes[0].set_yticks(range(len(methods)), [words.method(m) for m in methods])
    shade = colour(estimates[0].model) if len({e.model for e in estimates}) == 1 else MUTED
    handles: list[Line2D | Patch] = [
        Line2D([], [], ls="", marker="o", ms=4.5, mfc="white", mec=shade, label="own estimate"),
        Line2D([], [], ls="", marker="o", ms=4.5, mfc=shade, mec=shade, label=words.stage("refined")),
    ]
    if any(e.posterior for e in estimates):
        handles.append(Patch(color=shade, alpha=0.25, lw=0, label="posterior, 95 %"))
    if any(np.isfinite(e.truth) for e in estimates):
        handles.append(Line2D([], [], color=INK, lw=0.9, ls=(0, (2, 2)), label="truth"))
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles) if abreast > 1 else 2)
    return figure


def _panel(ax: Axes, e: CoefficientEstimates, methods: Sequence[str]) -> None:
    """Draw the estimates of one coefficient, with its posterior and true value, in a row for each of `methods`."""
    shade = colour(e.model)
    # The axis is centred on the posterior, or else on the true value or the median estimate.
    middle = e.truth if np.isfinite(e.truth) else float(np.median([*e.own.values(), *e.refined.values()]))
    reach = HALF_AXIS_ALONE * abs(middle) or 1.0
    if e.posterior is not None:
        middle = 0.5 * (e.posterior[0] + e.posterior[1])
        width = e.posterior[1] - e.posterior[0]
        reach = HALF_AXIS * 0.5 * width or HALF_AXIS_ALONE * abs(middle) or 1.0
        if np.isfinite(e.truth):
            reach = max(reach, 1.2 * abs(e.truth - middle))
    low, high = middle - reach, middle + reach
    if e.posterior is not None:
        ax.axvspan(*e.posterior, color=shade, alpha=0.18, lw=0, zorder=0.2)
    if np.isfinite(e.truth):
        ax.axvline(e.truth, color=INK, lw=0.9, ls=(0, (2, 2)))

    for row, method in enumerate(methods):
        ax.axhline(row, color=FAINT, lw=0.5, zorder=0.1)
        own, refined = e.own.get(method, np.nan), e.refined.get(method, np.nan)
        for value, face, y in ((own, "white", row - APART), (refined, shade, row + APART)):
            if low <= value <= high:
                ax.plot(value, y, "o", ms=4.4, mfc=face, mec=shade, mew=1.0)
            elif np.isfinite(value):
                left = value < low
                text = f"◂ {fmt.number(value, 3)}" if left else f"{fmt.number(value, 3)} ▸"
                look = {"fontsize": 7, "color": MUTED, "ha": "left" if left else "right", "va": "center"}
                ax.text(0.0 if left else 1.0, y, text, transform=ax.get_yaxis_transform(), **look)
    ax.set(xlim=(low, high), ylim=(len(methods) - 0.4, -0.6), xlabel=words.axis(e.parameter, e.unit))
    ax.set_title(f"record {e.signal},\nmodel {words.model(e.model)}", fontsize=8)
    ax.locator_params(axis="x", nbins=4)
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)


def force(
    velocity: Sequence[float], learnt: Sequence[float], law: Sequence[float], model: str, unit: str
) -> Figure:
    """Draw a learnt damping force per unit of inertia, and the damping law that was fitted to it.

    Parameters
    ----------
    velocity
        Velocities, (n,), in `unit` per s.
    learnt, law
        The learnt force and the force of the law at these velocities, (n,), in `unit` per s².
    model
        Name of the model, which determines the colour.
    unit
        Unit of the displacement.
    """
    figure = Figure(figsize=(4.6, 2.5))
    ax = figure.add_subplot()
    ax.axhline(0, color=FAINT, lw=0.8, zorder=0.5)
    ax.plot(velocity, np.asarray(law, float), color=INK, lw=1.0, ls=(0, (3, 2)), label="law")
    ax.plot(velocity, np.asarray(learnt, float), color=colour(model), lw=1.4, label="learnt")
    ax.set(xlabel=f"velocity / ({unit}/s)", ylabel=f"damping force / ({unit}/s²)")
    ax.legend(loc="upper left", labelcolor=MUTED)
    return figure


def sweep(along: ErrorSeries, methods: list[str]) -> Figure:
    """Draw the root mean square errors of estimators against noise, sampling or length, with the Cramér–Rao bound.

    Errors are in per cent of the true coefficient. The left panel has the errors of the initial estimates, the right
    panel those after a trajectory fit that starts there. Both axes are logarithmic. Errors are clipped to
    `LOWEST_ERROR` and `HIGHEST_ERROR`; a noise of 0 is drawn at the left edge.

    Parameters
    ----------
    along
        The errors against one factor.
    methods
        Names of the estimators to draw. An estimator without errors at a stage is left out of the panel of this stage.
    """
    figure = Figure(figsize=(WIDTH, 3.3))
    axes = np.atleast_1d(figure.subplots(1, 2, sharey=True))
    positive = [v for v in along.values if v > 0]
    x = np.array([v if v > 0 else 0.3 * min(positive) for v in along.values])
    for ax, stage in zip(axes, STAGES):
        for i, method in enumerate(methods):
            if (method, stage) not in along.errors.index:
                continue
            y = along.errors.loc[method, stage].clip(LOWEST_ERROR, HIGHEST_ERROR)
            look = {"color": INKS[i % len(INKS)], "marker": _MARKS[i % len(_MARKS)]}
            dash = "-" if i < len(INKS) else "--"
            label = f"{words.method(method)}, {along.repeats[method, stage].max()}"
            ax.plot(x, y, lw=0.9, ls=dash, ms=4, mfc="white", label=label, **look)
        ax.plot(x, along.bounds, color=INK, lw=1.4, ls=(0, (3, 2)), label="Cramér–Rao bound")
        ax.set(xscale="log", yscale="log", xlabel=FACTORS[along.factor])
        ax.set_xticks(x, [fmt.digits(v, n=6) for v in along.values])
        ax.minorticks_off()
        ax.set_title(words.stage(stage))
    axes[0].set_ylabel("rms error / %")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper", title="method, repeats")
    return figure
