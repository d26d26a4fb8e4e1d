"""Make a signal (the free decay of a record, in base units) from arrays or from a record."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.formatting import Table, data_frame
from bayesdamp.interface.arguments import numbers_of
from bayesdamp.interface.result import FAINT, INK, Result, frame_table, get_axes
from bayesdamp.records.cleaning.clean import clean, decimate, known_unit, recording_step
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.files.names import unit_by_name
from bayesdamp.records.read import FASTEST_RATE, SLOWEST_RATE
from bayesdamp.records.record import RawRecord, choose_unit, unwrap
from bayesdamp.types import InputError, Provenance
from bayesdamp.units import UNITS, Unit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

LEAST_SAMPLES = 10
"""Smallest number of samples of a signal."""
_EMPTY = np.empty(0)


@dataclass(frozen=True, eq=False, repr=False)
class Signal(Result, types.Signal):
    """The free decay of a record, or a simulated record, in base units (rad or m, or a sensor's own, and s).

    Two signals are equal only if they are the same object.

    Attributes
    ----------
    t
        Times in s, shape (n,), strictly increasing; t[0] = 0 at the first sample of the signal.
    y
        The recorded quantity, shape (n,): in `unit` for a displacement, in `unit`/s for a velocity, in `unit`/s² for
        an acceleration.
    quantity
        "angle" (any displacement), "velocity" or "acceleration".
    unit
        Base unit of the displacement: "rad", "m", or a sensor's own.
    name
        Name of the record.
    step
        Step to which values are rounded, in the unit of y; 0 if they are not rounded.
    provenance
        Information on how the record was read and cleaned.
    whole_t, whole_y
        The whole record from which the decay was cut: times in s on the record's own time axis, and values in the unit
        of y, shape (N,); empty if the signal was not cut from a record.
    """

    whole_t: NDArray[np.float64] = field(default_factory=lambda: _EMPTY)
    whole_y: NDArray[np.float64] = field(default_factory=lambda: _EMPTY)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on how the record was read and cleaned."""
        return self.provenance.sentences

    @property
    def y_unit(self) -> str:
        """Unit of y, such as "rad" or "m/s²"."""
        return UNITS[self.unit].of(self.quantity)

    @property
    def own_unit(self) -> Unit:
        """The unit of the recorded file, which figures and tables use."""
        return UNITS[self.provenance.unit or self.unit]

    def summary(self) -> pd.DataFrame:
        """Return a table with one row.

        Its columns are record, samples, length in s, rate (mean sampling rate in Hz), uniform (whether sampling is),
        quantity, unit (of the values in the file), and low and high (smallest and largest value in this unit).
        """
        unit, n = self.own_unit, self.t.size
        row = {
            "record": self.name,
            "samples": n,
            "length": float(self.t[-1]),
            "rate": (n - 1) / float(self.t[-1]),
            "uniform": self.uniform,
            "quantity": unit.quantity_name(self.quantity),
            "unit": unit.of(self.quantity),
            "low": float(self.y.min()) * unit.scale,
            "high": float(self.y.max()) * unit.scale,
        }
        return data_frame([row])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the record in the unit of its file, and return the axes.

        The parts that were cut away are grey; the title gives the reasons.
        """
        ax = get_axes(ax)[0]
        begun = self.provenance.start if self.whole_t.size else 0.0
        unit = self.own_unit
        if self.whole_t.size:
            ax.plot(self.whole_t, self.whole_y * unit.scale, color=FAINT, lw=1.0, label="cut away")
        ax.plot(self.t + begun, self.y * unit.scale, color=INK, lw=0.8, label="kept")
        notes = textwrap.wrap(" ".join(self.notes), 90)
        ax.set_xlabel("time / s")
        ax.set_ylabel(f"{unit.quantity_name(self.quantity)} / {unit.of(self.quantity)}")
        ax.set_title("\n".join([self.name, *notes]), fontsize="small", loc="left")
        if self.whole_t.size:
            ax.legend(loc="upper right")
        return ax

    def _table(self) -> Table:
        shown = self.summary().drop(columns="record").T.set_axis(["value"], axis=1)
        return frame_table(shown, f"Signal {self.name}, with length in s and rate in Hz", self.notes)

    @classmethod
    def of(cls, signal: types.Signal, **more: Any) -> Self:
        """Convert a signal to one that can be plotted, printed and saved; one of this class is returned as it is.

        `more`: further fields, such as whole_t and whole_y.
        """
        if isinstance(signal, cls):
            return signal
        names = ("t", "y", "quantity", "unit", "name", "step", "provenance")
        return cls(**{n: getattr(signal, n) for n in names}, **more)


def signal(
    t: ArrayLike | None = None,
    y: ArrayLike | None = None,
    *,
    rate: float | None = None,
    unit: str = "rad",
    quantity: str | None = None,
    name: str = "signal",
    cleaned: bool = True,
    clock: str = "auto",
    start: str | float = "auto",
    stop: str | float = "auto",
) -> Signal:
    """Make a signal from arrays, and convert it to base units (rad, m or the sensor's unit).

    Parameters
    ----------
    t
        Times in s, shape (n,).
    y
        The recorded quantity, shape (n,), in the unit that follows from `unit` and `quantity`.
    rate
        Sampling rate in Hz, instead of the times: `signal(y, rate=500.0)`.
    unit
        Unit of the displacement, by its name in `bayesdamp.units.UNITS` or as in the header of a column (`°`,
        `degrees`). A velocity is in this unit per s, an acceleration in this unit per s².
    quantity
        "angle" (any displacement), "velocity" or "acceleration"; by default "angle".
    name
        Name of the signal.
    cleaned
        Whether to find and cut out the free decay, as `Record.signal` does; otherwise the arrays are used as they are,
        with times from the first sample.
    clock
        "as_logged": use the times as they are; "uniform": replace them by equally spaced times; "auto": do this only if
        the times are rounded or repeat in bursts. Without effect if not `cleaned`.
    start, stop
        Start and end of the free decay in s, on the time axis of `t`; or "auto" to find the decay. Without effect if
        not `cleaned`.

    Raises
    ------
    InputError
        If the arrays are not a valid record, or do not contain an oscillation.

    Examples
    --------
    >>> import numpy as np
    >>> import bayesdamp as bd
    >>> t = np.linspace(0.0, 6.0, 150)
    >>> noise = 0.001 * np.random.default_rng(0).standard_normal(t.size)
    >>> signal = bd.signal(t, 0.3 * np.exp(-0.05 * t) * np.cos(4.47 * t) + noise)
    >>> signal.t.size, signal.y_unit
    (150, 'rad')
    """
    if rate is not None:
        if t is not None and y is not None:
            raise InputError("signal: give times or rate, not both")
        given = t if y is None else y
        y = None if given is None else numbers_of(given, "y", name)
        if not (np.isfinite(rate) and SLOWEST_RATE <= rate <= FASTEST_RATE):
            raise InputError(
                f"signal: rate is {rate!r}; it must be a number of Hz from {SLOWEST_RATE:g} to {FASTEST_RATE:g}"
            )
        t = None if y is None else np.arange(y.size) / rate
    if t is None or y is None:
        raise InputError("signal: give times and values as signal(t, y), or signal(y, rate=HERTZ)")
    times, values = numbers_of(t, "t", name), numbers_of(y, "y", name)
    if times.ndim != 1 or times.shape != values.shape:
        raise InputError(
            f"t and y must be vectors of equal length, but their shapes are {times.shape} and {values.shape}",
            name,
        )
    if times.size < LEAST_SAMPLES:
        raise InputError(f"t and y have {times.size} samples; a signal needs at least {LEAST_SAMPLES}", name)
    for what, column in (("t", times), ("y", values)):
        if not np.all(np.isfinite(column)):
            at = int(np.flatnonzero(~np.isfinite(column))[0])
            raise InputError(f"{what}[{at}] is {column[at]}, not a finite number; remove such samples", name)
    if np.ptp(values) == 0:
        raise InputError(f"y is constant ({values[0]:g}); give a record that oscillates", name)
    unit, quantity = choose_unit(*unit_by_name(unit, quantity), "", "")
    scale, base = known_unit(unit, quantity, name)
    raw = RawRecord(times, values, rows=np.arange(times.size))
    if cleaned:
        return cut(raw, name, unit, quantity, clock=clock, start=start, stop=stop)
    if np.any(np.diff(times) <= 0):
        at = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(f"times must increase, but t[{at}] is not after t[{at - 1}]; sort the samples", name)
    provenance = Provenance(notes=("Used as given, without cleaning.",), unit=unit)
    step = recording_step(values) * scale
    return Signal(times - times[0], values * scale, quantity, base, name, step, provenance)


def cut(raw: RawRecord, name: str, unit: str, quantity: str, **window: Any) -> Signal:
    """Find the free decay in a raw record, and return it as a signal.

    If the record is not the free decay of one oscillator (beats, growth), and start and stop are "auto", the signal is
    the whole oscillation up to the end of the record.

    Parameters
    ----------
    raw
        The record as it was read.
    name, unit, quantity
        Name of the signal, unit of the displacement as in `signal`, and recorded quantity.
    **window
        Options `clock` ("as_logged", "uniform" or "auto"), `start` and `stop` (in s, or "auto"), as in `Record.signal`.

    Returns
    -------
    Signal
        The decay, in base units (rad, m or that of the sensor). Its `whole_t` and `whole_y` contain the whole record.

    Raises
    ------
    InputError
        If the record does not contain two periods of an oscillation, or cannot be used for another reason.
    """
    raw = decimate(unwrap(raw, unit, quantity))  # `clean` finds nothing left to do
    decay = clean(raw, name=name, unit=unit, quantity=quantity, **window)
    whole, _ = clock_times(raw, window["clock"], name)
    return Signal.of(decay, whole_t=whole, whole_y=raw.y * UNITS[unit].factor - decay.provenance.offset)
