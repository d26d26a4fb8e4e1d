"""Predict the motion of a fit at times that were not recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp.formatting import compact
from bayesdamp.inference.checks.checks import laplace_draws
from bayesdamp.inference.deviation.single import Single
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.interface import axes
from bayesdamp.interface.arguments import numbers_of
from bayesdamp.interface.result import Result
from bayesdamp.interface.signal import Signal
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.plugins import nearest
from bayesdamp.records.oscillation.features import features
from bayesdamp.table import Table
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]
BAND = 200
"""Draws for the standard deviation of a prediction, which is then good to a twentieth of itself."""
PRECISION = 1e-6
"""Precision of a predicted motion, as a share of the record's range."""
SHOWN = 8
"""Largest number of times in a printed prediction."""
TWO_SIDED = 1.96
"""Half width of a 95 % band in standard deviations."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """A motion at given times.

    Attributes
    ----------
    t
        Times in s, shape (m,).
    value, sd
        Motion at the best fit, and its standard deviation from the parameters' uncertainty without the noise, each of
        shape (m,), in `unit`.
    quantity, unit
        What is predicted, and its unit.
    """

    t: Vector
    value: Vector
    sd: Vector
    quantity: str
    unit: str

    def summary(self) -> pd.DataFrame:
        """Return a row for each time: t in s, value and sd in `unit`."""
        import pandas as pd

        return pd.DataFrame({"t": self.t, "value": self.value, "sd": self.sd, "unit": self.unit})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the motion with its 95 % band, and return the axes."""
        ax = axes.get_axes(ax)[0]
        order = np.argsort(self.t)
        t, value, half = self.t[order], self.value[order], TWO_SIDED * self.sd[order]
        ax.fill_between(t, value - half, value + half, color=axes.FAINT, label="95 %")
        ax.plot(t, value, color=axes.BLUE, lw=1.0, label="best fit")
        ax.set_xlabel("time / s")
        ax.set_ylabel(f"{self.quantity} / {self.unit}")
        ax.legend(loc="upper right")
        return ax

    def _table(self) -> Table:
        some = np.unique(np.linspace(0, self.t.size - 1, min(SHOWN, self.t.size)).astype(int))
        columns = (self.t[some].tolist(), self.value[some].tolist(), self.sd[some].tolist())
        rows = tuple((compact(t), compact(v, 5), compact(sd, 2)) for t, v, sd in zip(*columns, strict=True))
        notes = (f"{some.size} of {self.t.size} times",) if some.size < self.t.size else ()
        heads = ("time / s", f"{self.quantity} / {self.unit}", "sd")
        return Table(heads, rows, caption="Predicted motion", notes=notes)


def check_times(t: ArrayLike, quantity: str) -> Vector:
    """Return times, (m,), from an array of any shape or a number. Raises InputError for wrong times or quantity."""
    if quantity not in QUANTITIES:
        raise InputError(f"predict: unknown quantity {quantity!r}{nearest(quantity, list(QUANTITIES))}")
    times = numbers_of(t, "t", "predict").ravel()
    if not np.all(np.isfinite(times)):
        raise InputError("predict: t must be finite times, in s from the first sample")
    return times


def predict_exact(target: Target, mode: Mode, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Predict where laws hold exactly: at times (m,) within the record, after it, or before it."""
    derivatives = QUANTITIES.index(wanted) - QUANTITIES.index(signal.quantity)
    precision = PRECISION * float(np.ptp(signal.y)) * features(signal).frequency ** derivatives
    osc, best = target.oscillator, target.all_values(mode.z)
    z = laplace_draws(target, mode, BAND, 0)
    drawn = {**{n: np.full(BAND, float(v)) for n, v in target.known.items()}, **target.values(z)}
    value, sd = np.empty(times.size), np.empty(times.size)
    for chosen, way in ((times >= 0, 1.0), (times < 0, -1.0)):
        if not chosen.any():
            continue
        # With reversed time, forces that are odd in the velocity change their sign, and so do velocities.
        signs = {n: way for n in (*osc.coefficients, "omega0")}
        single = {n: v * signs.get(n, 1.0) for n, v in best.items()}
        many = {n: v * signs.get(n, 1.0) for n, v in drawn.items()}
        grid, at = np.unique(np.concatenate([[0.0], way * times[chosen]]), return_inverse=True)
        motion = Trajectories(osc, grid, wanted, single, precision)
        value[chosen] = (way if wanted == "velocity" else 1.0) * motion.record(single)[at[1:]]
        sd[chosen] = motion.many(many).std(axis=0)[at[1:]]
    return Prediction(times, value, sd, wanted, UNITS[signal.unit].of(wanted))


def predict_approximate(law: Single, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Predict where laws hold approximately: in the part of the record that was fitted. Raises InputError outside."""
    end = float(law.knots[-1])
    if not times.size:
        return Prediction(times, times, times, wanted, UNITS[signal.unit].of(wanted))
    if times.min() < 0 or times.max() > end:
        raise InputError(
            f"predict: t goes from {times.min():.6g} to {times.max():.6g} s; the fit covers 0 to {end:.6g} s, and how "
            'the law deviates elsewhere is not known; use deviation="none" to extrapolate'
        )
    grid, at = np.unique(times, return_inverse=True)
    motions = law.motions(np.concatenate([law.best, law.scores[:: len(law.scores) // BAND]]), grid, wanted)
    band = np.nanstd(motions[1:], axis=0)
    return Prediction(times, motions[0][at], band[at], wanted, UNITS[signal.unit].of(wanted))
