"""What a fit says of the motion at times that nobody recorded."""

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
from bayesdamp.interface.parts import axes
from bayesdamp.interface.parts.asked import numbers_of
from bayesdamp.interface.parts.result import Result
from bayesdamp.interface.records.signal import Signal
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
"""Draws behind a prediction's standard deviation, which they make good to a twentieth of itself."""
PRECISION = 1e-6
"""Of a predicted motion, as a share of the record's range."""


SHOWN = 8
"""Times that a printed prediction has at most."""
TWO_SIDED = 1.96
"""Standard deviations on either side of a band that holds 95 %."""


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Result):
    """A motion at times t (s, shape (m,)): value at the best fit, and the sd that the parameters' uncertainty gives it
    (noise not included), both (m,), in `unit`."""

    t: Vector
    value: Vector
    sd: Vector
    quantity: str
    unit: str

    def summary(self) -> pd.DataFrame:
        """A row a time: t in s, value and sd in `unit`."""
        import pandas as pd

        return pd.DataFrame({"t": self.t, "value": self.value, "sd": self.sd, "unit": self.unit})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the motion with its 95 % band; the axes drawn on."""
        ax = axes.one(ax)
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


def asked_motion(t: ArrayLike, quantity: str) -> tuple[Vector, str]:
    """Times, (m,), of an array of any shape or a number, and quantity. Raises InputError for what no motion has."""
    if quantity not in QUANTITIES:
        raise InputError(f"predict: unknown quantity {quantity!r}{nearest(quantity, list(QUANTITIES))}")
    times = numbers_of(t, "t", "predict").ravel()
    if not np.all(np.isfinite(times)):
        raise InputError("predict: t must be finite times, in s from the first sample")
    return times, quantity


def anywhere(target: Target, mode: Mode, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Where laws hold exactly: at times (m,) within the record, beyond it, or before it, where the motion is followed
    backwards."""
    derivatives = QUANTITIES.index(wanted) - QUANTITIES.index(signal.quantity)
    precision = PRECISION * float(np.ptp(signal.y)) * features(signal).frequency ** derivatives
    osc, best = target.oscillator, target.all_values(mode.z)
    z = laplace_draws(target, mode, BAND, 0)
    drawn = {**{n: np.full(BAND, float(v)) for n, v in target.known.items()}, **target.values(z)}
    value, sd = np.empty(times.size), np.empty(times.size)
    for chosen, way in ((times >= 0, 1.0), (times < 0, -1.0)):
        if not chosen.any():
            continue
        # Time reversed: forces that are odd in the velocity change their sign, and so do velocities.
        turned = {n: way for n in (*osc.coefficients, "omega0")}
        one = {n: v * turned.get(n, 1.0) for n, v in best.items()}
        many = {n: v * turned.get(n, 1.0) for n, v in drawn.items()}
        grid, at = np.unique(np.concatenate([[0.0], way * times[chosen]]), return_inverse=True)
        motion = Trajectories(osc, grid, wanted, one, precision)
        value[chosen] = (way if wanted == "velocity" else 1.0) * motion.record(one)[at[1:]]
        sd[chosen] = motion.many(many).std(axis=0)[at[1:]]
    return Prediction(times, value, sd, wanted, UNITS[signal.unit].of(wanted))


def within_record(law: Single, signal: Signal, times: Vector, wanted: str) -> Prediction:
    """Where laws hold approximately: within the part of the record that was read. Raises InputError outside it."""
    end = float(law.knots[-1])
    if not times.size:
        return Prediction(times, times, times, wanted, UNITS[signal.unit].of(wanted))
    if times.min() < 0 or times.max() > end:
        raise InputError(
            f"predict: t goes from {times.min():.6g} to {times.max():.6g} s; the record is read from 0 to {end:.6g} s, "
            'and how the law deviates elsewhere is not known; give deviation="none" to go on'
        )
    grid, at = np.unique(times, return_inverse=True)
    every = law.motions(np.concatenate([law.best, law.scores[:: len(law.scores) // BAND]]), grid, wanted)
    band = np.nanstd(every[1:], axis=0)
    return Prediction(times, every[0][at], band[at], wanted, UNITS[signal.unit].of(wanted))
