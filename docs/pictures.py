"""Figures of the site, drawn by the program itself from simulated records and from what stands in reports/.

Written anew at each build.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.signal import find_peaks, hilbert, savgol_filter

import bayesdamp as bd
from bayesdamp.report.drawing import FAINT, INK, MUTED, RC, colour, dash
from bayesdamp.report.figures.estimators import estimate_panels, sweep
from bayesdamp.report.results.estimators import CATEGORIES, error_series, estimates_of, true_models
from bayesdamp.report.results.run import RunFolder

STIFFNESS, SEED = 20.0, 7
DAMPINGS = {"viscous": 0.12, "coulomb": 0.11, "quadratic": 0.55}
"""Coefficients with which three decays lose alike at first."""
WIDE = (7.4, 2.9)
WINDOW = 45
"""Samples over which a derivative is taken: a third of a period."""


def decay(damping: str, noise_sd: float = 0.0) -> bd.Signal:
    """A decay of 11 periods."""
    amount = {damping: DAMPINGS[damping]}
    return bd.simulate(amount, stiffness=STIFFNESS, duration=16.0, samples=1601, noise_sd=noise_sd, seed=SEED)


def three_dampings() -> Figure:
    """Amplitudes against time, and damping ratio against amplitude."""
    figure = Figure(figsize=WIDE)
    left, right = figure.subplots(1, 2)
    frequency = np.sqrt(STIFFNESS)
    a = np.linspace(0.03, 0.3, 200)
    ratios = {
        "viscous": np.full_like(a, DAMPINGS["viscous"] / frequency),
        "coulomb": 2 * DAMPINGS["coulomb"] / (np.pi * STIFFNESS * a),
        "quadratic": 4 * DAMPINGS["quadratic"] * a / (3 * np.pi),
    }
    for name in DAMPINGS:
        signal = decay(name)
        peaks = np.r_[0, find_peaks(signal.y)[0]]
        left.plot(
            signal.t[peaks], signal.y[peaks], "o", ms=3, ls=dash(name), lw=1.2, color=colour(name), label=name
        )
        right.plot(a, 100 * ratios[name], color=colour(name), ls=dash(name), lw=1.6, label=name)
    _finish(left, "Peaks of the record", "time / s", "amplitude / rad")
    _finish(right, "Equivalent damping ratio", "amplitude / rad", "%")
    left.set_ylim(bottom=0)
    right.set_ylim(0, 8)
    left.legend()
    return figure


def lifetimes() -> Figure:
    """What the topological method sees of a record: minima paired with maxima."""
    figure = Figure(figsize=WIDE)
    left, right = figure.subplots(1, 2)
    signal = decay("coulomb")
    left.plot(signal.t, signal.y, color=MUTED, lw=0.9)
    low, high = find_peaks(-signal.y)[0], find_peaks(signal.y)[0]
    sizes = []
    for valley in low[:9]:
        after = high[high > valley]
        if after.size:
            level = signal.y[after[0]]
            left.plot([signal.t[valley]] * 2, [signal.y[valley], level], color=colour("coulomb"), lw=1.6)
            left.plot(
                [signal.t[valley], signal.t[after[0]]],
                [level, level],
                color=colour("coulomb"),
                lw=0.7,
                ls=":",
            )
            sizes.append(level - signal.y[valley])
    right.plot(np.arange(1, len(sizes) + 1), sizes, "o-", color=colour("coulomb"), ms=4, lw=0.9)
    _finish(left, "Each minimum and the maximum that ends its basin", "time / s", "angle / rad")
    _finish(right, "Lifetimes: equal steps, so friction", "pair", "lifetime / rad")
    left.set_xlim(0, 13)
    right.set_ylim(bottom=0)
    return figure


def regression() -> Figure:
    """What least squares and sparse regression fit: the force that is left against the velocity."""
    figure = Figure(figsize=(WIDE[0], 2.6))
    for ax, name in zip(figure.subplots(1, 3, sharey=True), DAMPINGS, strict=True):
        signal = decay(name, noise_sd=0.0006)
        step = float(signal.t[1] - signal.t[0])
        y, velocity, acceleration = (
            np.asarray(savgol_filter(signal.y, WINDOW, 5, deriv=order, delta=step)) for order in range(3)
        )
        force = -(acceleration + STIFFNESS * y)
        ax.plot(velocity[WINDOW:-WINDOW:3], force[WINDOW:-WINDOW:3], ".", ms=1.6, color=MUTED)
        v = np.linspace(velocity.min(), velocity.max(), 300)
        c = DAMPINGS[name]
        law = {"viscous": 2 * c * v, "coulomb": c * np.sign(v), "quadratic": c * v * np.abs(v)}[name]
        ax.plot(v, law, color=colour(name), lw=1.6)
        ax.set_ylim(-0.75, 0.75)
        _finish(ax, name, "velocity / (rad/s)", "")
    figure.axes[0].set_ylabel("force that is left / (rad/s²)")
    return figure


def envelopes() -> Figure:
    """The modulus of the analytic signal, and its logarithm."""
    figure = Figure(figsize=WIDE)
    left, right = figure.subplots(1, 2)
    signal = decay("viscous", noise_sd=0.004)
    amplitude = np.abs(np.asarray(hilbert(signal.y)))
    left.plot(signal.t, signal.y, color=FAINT, lw=0.9)
    left.plot(signal.t[30:-30], amplitude[30:-30], color=colour("viscous"), lw=1.2)
    for name in DAMPINGS:
        own = decay(name)
        size = np.abs(np.asarray(hilbert(own.y)))
        right.plot(own.t[60:-60], np.log(size[60:-60]), color=colour(name), ls=dash(name), lw=1.2, label=name)
    _finish(left, "Record and its envelope", "time / s", "angle / rad")
    _finish(right, "Logarithm of the envelope", "time / s", "ln A")
    right.set_ylim(-5, -1)
    right.legend(loc="lower left")
    return figure


def in_noise(root: Path) -> Figure:
    """Errors of all methods against noise, from the report of studies/noise.toml."""
    found = next(s for s in error_series(RunFolder(root / "reports" / "noise")) if s.factor == "noise")
    methods = [m for members in CATEGORIES.values() for m in members if m in found.errors.index.unique(0)]
    return sweep(found, methods)


def beside_posterior(root: Path) -> Figure:
    """The eleven against the posteriors of the noisy records, from the report of studies/paper.toml."""
    run = RunFolder(root / "reports" / "paper")
    estimates = [e for simulated in true_models(run).items() for e in estimates_of(run, *simulated)]
    return estimate_panels([e for e in estimates if e.posterior], 3)


def write(root: Path) -> None:
    """All figures, as SVG, into docs/_generated."""
    folder = root / "docs" / "_generated"
    folder.mkdir(exist_ok=True)
    drawn: dict[str, Callable[[], Figure]] = {
        "three_dampings": three_dampings,
        "lifetimes": lifetimes,
        "regression": regression,
        "envelopes": envelopes,
        "in_noise": lambda: in_noise(root),
        "beside_posterior": lambda: beside_posterior(root),
    }
    for name, draw in drawn.items():
        with rc_context(RC):
            draw().savefig(folder / f"{name}.svg", metadata={"Date": None})


def _finish(ax: Axes, title: str, xlabel: str, ylabel: str) -> None:
    ax.set_title(title)
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.axhline(0, color=INK, lw=0.3, zorder=0.1)
