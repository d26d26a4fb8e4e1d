"""Read a measured file, and find the free decay in each of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bayesdamp.formatting import Table, digits
from bayesdamp.interface.result import Result
from bayesdamp.interface.signal import Signal, cut
from bayesdamp.records.cleaning.clean import known_unit
from bayesdamp.records.files.names import unit_by_name
from bayesdamp.records.findings import Kind, findings, refuse_questions
from bayesdamp.records.read import read_records
from bayesdamp.records.record import RawRecord, unit_or_guess
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

Column = str | int
"""A column of a file, by its name or its number from 1."""


@dataclass(frozen=True, eq=False, repr=False)
class Record(Result):
    """The content of a file before cleaning. Two records are equal only if they are the same object.

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
        signal is the whole oscillation up to the end of the run.

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
            If the run does not exist, or does not contain two periods of an oscillation.
        """
        if run not in self.runs:
            raise InputError(
                f"{self.path.name}: has no run {run!r}; its runs are {', '.join(map(str, self.runs))}"
            )
        own = self.path.stem if len(self.raw) == 1 else f"{self.path.stem}-{run}"
        window = {"clock": clock, "start": start, "stop": stop}
        return cut(self.raw[run - 1], name or own, self.unit, self.quantity, **window)

    def signals(self) -> tuple[Signal, ...]:
        """Return the free decay of each run, as `signal` does with its defaults. Raises InputError if one has none."""
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
        Columns of times and values, by name or by number from 1 (in MATLAB and .npz files a path with dots). They can
        be left out if only one choice is possible.
    rate
        Sampling rate in Hz, for a file without times.
    unit, quantity
        Unit and quantity of the values, as in `signal`; by default from the file (`Angle(deg)`, `acc (g)`). If the file
        has no unit, an angle in rad is assumed, or in another unit (with a warning) if the values are too large for
        rad.
    runs
        Runs to read, such as `2` or `"1,3-5"`; by default all. In the record they are numbered from 1.
    channels
        Names of the channels to read; by default all that oscillate. Each run of each channel is a run of the record.
    time_unit
        Unit of the times (`"ms"`, `"us"`, `"h"` ...); by default from the file, otherwise s.

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
    raw = tuple(
        read_records(
            path,
            time=time,
            value=value,
            rate=rate,
            runs=None if runs is None else str(runs),
            channels=tuple(channels),
            time_unit=time_unit,
        )
    )
    units = {unit_or_guess(record, unit, quantity): record.channel for record in raw}
    if len(units) > 1:
        each = ", ".join(f"{channel!r} ({u})" for (u, _), channel in units.items())
        raise InputError(f"{path.name}: has records in several units: {each}; choose with channels=[...]")
    given = unit is not None
    unit, quantity = next(iter(units))
    known_unit(unit, quantity, path.name)
    warned = []
    for record in raw:
        doubts = findings(record, unit, quantity, given)
        refuse_questions(doubts, path.name)
        new = [f"{f.sentence}; give unit= if that is wrong." for f in doubts if f.kind is Kind.DEGREES]
        before = record.provenance
        warned.append(replace(record, provenance=replace(before, warnings=(*before.warnings, *new))))
    raw = tuple(warned)
    columns = tuple((r.provenance.time_column, r.provenance.value_column) for r in raw)
    return Record(path, columns, unit, quantity, raw)
