"""Read a measured file, and make signals (free decays, in base units) from its runs or from arrays."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp import types
from bayesdamp.formatting import Table, data_frame, digits
from bayesdamp.interface.result import FAINT, INK, Result, frame_table, get_axes
from bayesdamp.records.cleaning.clean import clean, decimate, known_unit, recording_step
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.files.contents import unit_by_name
from bayesdamp.records.read import FASTEST_RATE, SLOWEST_RATE, read_records
from bayesdamp.records.record import RawRecord, choose_unit, findings, unit_or_guess, unwrap, with_warnings
from bayesdamp.types import UNITS, InputError, Provenance, Unit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


LEAST_SAMPLES = 10
"""Smallest number of samples that the function `signal` accepts."""
_NOT_NUMBERS = "bcMmSU"
"""NumPy's codes of types that it would silently convert to real numbers: booleans, complex numbers, dates, durations
and text."""
_EMPTY = np.empty(0)
Column = str | int
"""A column of a file, by its name or its number from 1."""


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
        of y, without the sensor's zero offset, shape (N,); empty if the signal was not cut from a record.
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
        """The unit of displacement in the recorded file (of the values for rpm, g), which figures and tables use."""
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

        The parts that were cut away are grey; the title contains the signal's `notes`.
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
        """Convert a plain signal to this class, which can be plotted, printed and saved.

        A signal that is already of this class is returned unchanged, and `more` is ignored. `more`: values of the
        fields whole_t and whole_y.
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
        The recorded quantity, shape (n,), in the unit that follows from `unit` and `quantity`. With `rate`, it may be
        the first argument.
    rate
        Sampling rate in Hz, instead of the times: `signal(y, rate=500.0)`.
    unit
        Unit of the displacement, by its name in `bayesdamp.types.UNITS` or as in the header of a column (`°`,
        `degrees`). A velocity is in this unit per s, an acceleration in this unit per s². The units rpm, dps, g and mg
        are those of the velocity or acceleration itself.
    quantity
        "angle" (any displacement), "velocity" or "acceleration"; by default that of the unit (rpm, g), else "angle".
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
        If an argument is invalid, if the arrays are not a valid record, or if (only with `cleaned`) they do not contain
        two periods of an oscillation, or are for example clipped or rectified.

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


def numbers_of(given: ArrayLike, what: str, where: str) -> NDArray[np.float64]:
    """Convert an argument to a new array of floats.

    Parameters
    ----------
    given
        Real numbers of any shape.
    what
        Name of the argument, for errors.
    where
        Name of the signal or of the function, for errors.

    Raises
    ------
    InputError
        If elements are masked or are not real numbers; nan and infinite values are allowed.
    """
    try:
        array = np.asanyarray(given)
        each = map(np.asarray, array.flat) if array.dtype.kind == "O" else (array,)
        for dtype in (a.dtype for a in each if a.dtype.kind in _NOT_NUMBERS):
            right = "give real numbers, and times in s: (t - t[0]) / numpy.timedelta64(1, 's')"
            kind = {"S": "text", "U": "text", "m": "times", "M": "dates"}.get(dtype.kind, dtype.type.__name__)
            raise InputError(f"{what} contains {kind}; {right}", where)
        numbers = np.array(array, float)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be an array of numbers", where) from None
    if masked := np.count_nonzero(np.ma.getmaskarray(array)):
        raise InputError(f"{what} has {masked} masked values; remove these samples from t and y", where)
    return numbers


def cut(raw: RawRecord, name: str, unit: str, quantity: str, **window: Any) -> Signal:
    """Find the free decay in a raw record, and return it as a signal.

    If the record is not the free decay of one oscillator (beats, growth), and start and stop are "auto", the signal is
    the record from its largest value, or from its start, to its end.

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
    raw = decimate(unwrap(raw, unit, quantity))  # done here, because `raw` is also used after `clean`
    decay = clean(raw, name=name, unit=unit, quantity=quantity, **window)
    whole, _ = clock_times(raw, window["clock"], name)
    zero = decay.provenance.offset + decay.provenance.drift * (whole - decay.provenance.start)
    return Signal.of(decay, whole_t=whole, whole_y=raw.y * UNITS[unit].factor - zero)


@dataclass(frozen=True, eq=False, repr=False)
class Record(Result):
    """The runs of a measured file before cleaning. Two records are equal only if they are the same object.

    Attributes
    ----------
    path
        The file.
    columns
        For each run, the names of its columns of times and values. The first is empty if times follow from a rate.
    unit, quantity
        Unit of the displacement (or of the values, for units such as rpm or g), and the recorded quantity: "angle" (any
        displacement), "velocity" or "acceleration". The unit of the values, such as "mm/s", is in `units`.
    raw
        The runs as they were read, with values in the unit of the file.
    """

    path: Path
    columns: tuple[tuple[str, str], ...]
    unit: str
    quantity: str
    raw: tuple[RawRecord, ...] = field(repr=False)

    @property
    def runs(self) -> tuple[int, ...]:
        """Numbers of the runs in the record, from 1."""
        return tuple(range(1, len(self.raw) + 1))

    @property
    def units(self) -> dict[str, str]:
        """Unit of each of the `columns`, by the column's name. Times have been converted to s."""
        value = UNITS[self.unit].of(self.quantity)
        return {n: u for pair in self.columns for n, u in zip(pair, ("s", value), strict=True) if n}

    @property
    def releases(self) -> dict[int, tuple[tuple[float, float], ...]]:
        """Start and end in s of all free decays in each run, by the run's number; empty for a run without a decay.

        They are on the time axis of the file (from the first sample if it contains dates). Use `signal(run, start=...,
        stop=...)` to select one of them.
        """
        decays: dict[int, tuple[tuple[float, float], ...]] = dict.fromkeys(self.runs, ())
        for run in self.runs:
            with suppress(InputError):
                decays[run] = tuple((d.start, d.stop) for d in self.signal(run).provenance.decays)
        return decays

    def signal(
        self,
        run: int = 1,
        *,
        clock: str = "auto",
        start: str | float = "auto",
        stop: str | float = "auto",
        name: str | None = None,
    ) -> Signal:
        """Return the free decay of one run, in base units (rad, m or the sensor's unit).

        If the run is not the free decay of one oscillator (beats, growth), and `start` and `stop` are "auto", the
        signal is the run from its largest value, or from its start, to its end.

        Parameters
        ----------
        run
            Number of the run, from 1.
        clock
            "as_logged": use the times as they are; "uniform": replace them by equally spaced times; "auto": do this
            only if the times are rounded or repeat in bursts.
        start, stop
            Start and end of the free decay in s, on the time axis of the file (from the first sample if the file
            contains dates); or "auto" to find the decay after the release and before the oscillation vanishes.
        name
            Name of the signal; by default the name of the file, with the number of the run if there are several.

        Raises
        ------
        InputError
            If the run does not exist, another argument is invalid, or the run does not contain two periods of an
            oscillation, or cannot be used for another reason (for example because it is clipped or rectified).
        """
        if run not in self.runs:
            raise InputError(
                f"{self.path.name}: has no run {run!r}; its runs are {', '.join(map(str, self.runs))}"
            )
        own = self.path.stem if len(self.raw) == 1 else f"{self.path.stem}-{run}"
        window = {"clock": clock, "start": start, "stop": stop}
        return cut(self.raw[run - 1], name or own, self.unit, self.quantity, **window)

    def signals(self) -> tuple[Signal, ...]:
        """Return the free decay of each run, as the method `signal` with its default arguments.

        Raises InputError if `signal` does so for any run.
        """
        return tuple(self.signal(run) for run in self.runs)

    def _table(self) -> Table:
        rows = [
            (str(run), time or f"{raw.rate:g} Hz", value, str(raw.y.size), digits(float(np.ptp(raw.y))))
            for run, raw, (time, value) in zip(self.runs, self.raw, self.columns, strict=True)
        ]
        unit = UNITS[self.unit]
        title = f"Record {self.path.name}: {unit.quantity_name(self.quantity)} in {unit.of(self.quantity)}"
        return Table(("run", "time", "values", "samples", "range"), rows, caption=title)


def read(
    path: str | Path,
    *,
    time: Column | None = None,
    value: Column | None = None,
    rate: float | None = None,
    unit: str | None = None,
    quantity: str | None = None,
    runs: str | int | None = None,
    channels: Sequence[str] = (),
    time_unit: str | None = None,
) -> Record:
    """Read a file in any of the supported formats, with all its runs and all channels that oscillate.

    Parameters
    ----------
    path
        The file.
    time, value
        Columns of times and values, by name or by number from 1; in MATLAB and .npz files by a path with dots, such as
        "run.phi". They can be left out if only one choice is possible.
    rate
        Sampling rate in Hz; it replaces times and rate of the file, and cannot be given with `time`.
    unit, quantity
        Unit and quantity of the values, as in `signal`; by default from the file (`Angle(deg)`, `acc (g)`). If the file
        has no unit, an angle in rad is assumed, or degrees or counts (with a warning) if the values are too large for
        rad.
    runs
        Runs to read, such as `2` or `"1,3-5"`; by default all. In the record they are numbered from 1.
    channels
        Columns to read in addition to `value`; without both, all that oscillate. Each run of each channel is a run of
        the record.
    time_unit
        Unit of the times (`"ms"`, `"us"`, `"h"` ...); by default from the file, otherwise s.

    Returns
    -------
    Record
        The runs as they were read; `Record.signal` returns the free decay of one of them.

    Raises
    ------
    InputError
        If the file or an argument is invalid, if the records are in several units, or if the unit of the values or of
        the times is so doubtful that it must be specified.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> import bayesdamp as bd
    >>> t = np.linspace(0.0, 6.0, 150)
    >>> path = Path(tempfile.mkdtemp()) / "rig.csv"
    >>> np.savetxt(path, np.c_[t, 17 * np.exp(-0.05 * t) * np.cos(4.47 * t)], header="t,phi (deg)", delimiter=",")
    >>> signal = bd.read(path).signal()
    >>> round(abs(signal.y).max().item(), 2)  # rad
    0.3
    """
    path = Path(path)
    unit, quantity = unit_by_name(unit, quantity)
    wanted = None if runs is None else str(runs)
    raw = read_records(
        path, time=time, value=value, rate=rate, runs=wanted, channels=tuple(channels), time_unit=time_unit
    )
    units = {unit_or_guess(record, unit, quantity): record.channel for record in raw}
    if len(units) > 1:
        each = ", ".join(f"{channel!r} ({u})" for (u, _), channel in units.items())
        raise InputError(f"{path.name}: has records in several units: {each}; choose with channels=[...]")
    given = unit is not None
    unit, quantity = next(iter(units))
    known_unit(unit, quantity, path.name)
    raw = tuple(with_warnings(r, findings(r, unit, quantity, given), path.name) for r in raw)
    columns = tuple((r.provenance.time_column, r.provenance.value_column) for r in raw)
    return Record(path, columns, unit, quantity, raw)
