"""Make a signal, the free decay of a record in SI units, from arrays or from a record."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.formatting import Table, compact
from bayesdamp.interface.arguments import numbers_of
from bayesdamp.interface.result import FAINT, INK, Result, get_axes
from bayesdamp.records.cleaning.clean import clean, known_unit, recording_step
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.files.names import by_name
from bayesdamp.records.read import FASTEST, SLOWEST
from bayesdamp.records.record import RawRecord, resolved_unit, unwrapped
from bayesdamp.types import InputError, Provenance
from bayesdamp.units import UNITS, Unit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

LEAST = 10
"""Smallest number of samples of a signal."""
_EMPTY = np.empty(0)


@dataclass(frozen=True, eq=False, repr=False)
class Signal(Result, types.Signal):
    """A record's free decay in SI units; equal only to itself.

    Attributes
    ----------
    t
        Times in s, shape (n,), strictly increasing; t[0] = 0 at the first sample of the decay.
    y
        The recorded quantity, shape (n,): in `unit`, per s or per s² for a velocity or an acceleration.
    quantity
        "angle" (any displacement), "velocity" or "acceleration".
    unit
        Base unit of the displacement: "rad", "m", or a sensor's own.
    name
        Name of the record.
    step
        Recording step in the unit of y; 0 where there is none.
    provenance
        How the record was read, and what was done to it.
    whole_t, whole_y
        The whole record that the decay was cut out of, in s on the record's own clock and in the unit of y, shape (N,);
        empty where nothing was cut.
    """

    whole_t: NDArray[np.float64] = field(default_factory=lambda: _EMPTY)
    whole_y: NDArray[np.float64] = field(default_factory=lambda: _EMPTY)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the record and on what was done to it."""
        return self.provenance.sentences

    @property
    def y_unit(self) -> str:
        """Unit of y."""
        return UNITS[self.unit].of(self.quantity)

    @property
    def own_unit(self) -> Unit:
        """The unit that the record came in; pictures and tables use it."""
        return UNITS[self.provenance.unit or self.unit]

    def summary(self) -> pd.DataFrame:
        """Return one row: record, samples, length (s), mean rate (Hz), uniform, quantity, unit, low and high in it."""
        import pandas as pd

        unit, n = self.own_unit, self.t.size
        row = {
            "record": self.name,
            "samples": n,
            "length": float(self.t[-1]),
            "rate": (n - 1) / float(self.t[-1]),
            "uniform": self.uniform,
            "quantity": unit.called(self.quantity),
            "unit": unit.of(self.quantity),
            "low": float(self.y.min()) * unit.scale,
            "high": float(self.y.max()) * unit.scale,
        }
        return pd.DataFrame([row])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the record, with what was cut away faint and the reasons in the title, and return the axes."""
        ax = get_axes(ax)[0]
        begun = self.provenance.start if self.whole_t.size else 0.0
        unit = self.own_unit
        if self.whole_t.size:
            ax.plot(self.whole_t, self.whole_y * unit.scale, color=FAINT, lw=1.0, label="cut away")
        ax.plot(self.t + begun, self.y * unit.scale, color=INK, lw=0.8, label="kept")
        ax.set_xlabel("time / s")
        ax.set_ylabel(f"{unit.called(self.quantity)} / {unit.of(self.quantity)}")
        notes = textwrap.wrap(" ".join(self.notes), 110)
        ax.set_title("\n".join([self.name, *notes]), fontsize="x-small", loc="left")
        if self.whole_t.size:
            ax.legend(loc="upper right")
        return ax

    def _table(self) -> Table:
        unit, n, length = self.own_unit, self.t.size, float(self.t[-1])
        low, high = (float(end) * unit.scale for end in (self.y.min(), self.y.max()))
        rate = f"{compact((n - 1) / length, 5)} Hz"
        rows = (
            ("samples", str(n)),
            ("length", f"{compact(length, 5)} s"),
            ("sampling rate", rate if self.uniform else f"{rate}, uneven"),
            ("quantity", f"{unit.called(self.quantity)} in {unit.of(self.quantity)}"),
            ("range", f"{compact(low)} to {compact(high)}"),
        )
        return Table(("", "value"), rows, caption=f"Signal {self.name}", notes=self.notes)

    @classmethod
    def of(cls, signal: types.Signal, **more: Any) -> Self:
        """Return any signal of the package as one that can be drawn, printed and saved."""
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
    """Make a signal from arrays.

    Parameters
    ----------
    t
        Times in s, shape (n,).
    y
        The recorded quantity, shape (n,).
    rate
        Sampling rate in Hz in place of the times: `signal(y, rate=500.0)`.
    unit
        Unit of the displacement, by its name in `bayesdamp.units.UNITS` or as in the head of a column (`°`,
        `degrees`); y is per s or per s² where quantity is "velocity" or "acceleration".
    quantity
        "angle" (any displacement), "velocity" or "acceleration"; "angle" by default.
    name
        Name of the signal.
    cleaned
        Whether the free decay is cut out, as in `Record.signal`; otherwise the arrays are used as they are, with times
        from the first sample.
    clock, start, stop
        As in `Record.signal`.

    Raises
    ------
    InputError
        Where the arrays are not a record, or nothing oscillates.

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
        only = t if y is None else y
        y = numbers_of(() if only is None else only, "y", name)
        if not (np.isfinite(rate) and SLOWEST <= rate <= FASTEST):
            raise InputError(
                f"signal: rate is {rate!r}; it must be a number of Hz from {SLOWEST:g} to {FASTEST:g}"
            )
        t = np.arange(y.size) / rate
    if t is None or y is None:
        raise InputError(
            "signal: give times and values, signal(t, y), or values alone, signal(y, rate=HERTZ)"
        )
    times, values = numbers_of(t, "t", name), numbers_of(y, "y", name)
    if times.ndim != 1 or times.shape != values.shape:
        raise InputError(
            f"t and y must be vectors of one length, not of shapes {times.shape} and {values.shape}", name
        )
    if times.size < LEAST:
        raise InputError(f"{times.size} samples; a signal needs at least {LEAST}", name)
    for what, column in (("t", times), ("y", values)):
        if not np.all(np.isfinite(column)):
            at = int(np.flatnonzero(~np.isfinite(column))[0])
            raise InputError(f"{what}[{at}] is {column[at]}, not a finite number", name)
    if np.ptp(values) == 0:
        raise InputError(f"the values are constant ({values[0]:g}), nothing oscillates", name)
    unit, quantity = resolved_unit(*by_name(unit, quantity), "", "")
    scale, base = known_unit(unit, quantity, name)
    raw = RawRecord(times, values, rows=np.arange(times.size))
    if cleaned:
        return cut(raw, name, unit, quantity, clock=clock, start=start, stop=stop)
    if np.any(np.diff(times) <= 0):
        at = int(np.argmax(np.diff(times) <= 0)) + 1
        raise InputError(f"times must increase; sample {at} (from 0) is not later than the one before", name)
    provenance = Provenance(notes=("Used as it is.",), unit=unit, more={"quantity": quantity})
    step = recording_step(values) * scale
    return Signal(times - times[0], values * scale, quantity, base, name, step, provenance)


def cut(raw: RawRecord, name: str, unit: str, quantity: str, **window: Any) -> Signal:
    """Return the free decay in a raw record, with the whole record.

    Parameters
    ----------
    raw
        The record as it was read.
    name, unit, quantity
        Of the signal.
    **window
        Options clock, start and stop of `clean`.

    Raises
    ------
    InputError
        As `clean`.
    """
    raw = unwrapped(raw, unit, quantity)
    decay = clean(raw, name=name, unit=unit, quantity=quantity, **window)
    whole = np.asarray(clock_times(raw, window["clock"], name).t)
    return Signal.of(decay, whole_t=whole, whole_y=raw.y * UNITS[unit].factor - decay.provenance.offset)
