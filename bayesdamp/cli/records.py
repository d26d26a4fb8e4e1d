"""Read the records in files according to the options of a command, and report what looks wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from inspect import Parameter, Signature, signature
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from bayesdamp.cli.options import parse_time, reading
from bayesdamp.formatting import show
from bayesdamp.interface.signal import Signal, cut
from bayesdamp.pipeline.progress import map_with_bar
from bayesdamp.pipeline.workers import is_kill, restart
from bayesdamp.records.files.contents import unit_by_name
from bayesdamp.records.read import FROM_FIRST, read_each, read_records
from bayesdamp.records.record import QUESTIONS, Finding, RawRecord, findings, unit_or_guess
from bayesdamp.types import UNITS, InputError

if TYPE_CHECKING:
    from bayesdamp.config.load import RecordOptions

MAYBE_ENVELOPE = "If these values are the amplitudes of an envelope, use --quantity envelope."
"""Hint for a record without an oscillation and without negative values."""
_VALID = {
    "unit": tuple(UNITS),
    "quantity": ("angle", "velocity", "acceleration"),
    "clock": ("auto", "as_logged", "uniform"),
}
"""Valid values of the options for reading files, by option."""
_limit = partial(reading, parser=str, metavar="<str>")
"""Function that defines an option for the start or the end of the free decay, a number or "auto"."""


@dataclass(frozen=True)
class ReadingOptions:
    """The command-line options for reading files; the annotation of each field contains the option's help text.

    An option that is not given is None, or "auto" for clock, start and stop. start, stop: start and end of the free
    decay in s. An invalid unit, quantity, clock, start or stop raises InputError; the other options are only checked
    when a file is read.
    """

    angle: Annotated[str | None, reading("Column of the recorded quantity, by name or number from 1.")] = None
    time: Annotated[str | None, reading("Column of the times, by name or number.")] = None
    time_unit: Annotated[
        str | None, reading("Unit of the times: s, ms, us, ns, ps, min, h or d; by default from the file.")
    ] = None
    rate: Annotated[float | None, reading("Sampling rate in Hz, for a file without times.")] = None
    unit: Annotated[
        str | None,
        reading(
            "Unit of the displacement: rad, deg, m, mm, V and others (the error for an unknown unit lists them), or "
            "g, rpm, dps. By default from the file; otherwise rad, or deg or counts if the values are too large for "
            "rad."
        ),
    ] = None
    quantity: Annotated[
        str | None,
        reading(
            "angle (any displacement), velocity or acceleration; for compare and look also envelope (amplitude, power "
            "or level alone). By default from the file; otherwise angle."
        ),
    ] = None
    clock: Annotated[
        str,
        reading(
            "Times of the samples: as_logged (the time stamps), uniform (equal steps, fitted to the time stamps), or "
            "auto (uniform if stamps are rounded or come in bursts, else as_logged)."
        ),
    ] = "auto"
    start: Annotated[Any, _limit("Start of the free decay in s, or auto.")] = "auto"
    stop: Annotated[Any, _limit("End of the free decay in s, or auto.")] = "auto"
    runs: Annotated[
        str | None, reading("Runs to use of a file with several runs, such as 1,3-5; by default all.")
    ] = None
    channels: Annotated[
        list[str] | None,
        reading("A channel to use of a file with several channels; may be repeated.", "--channel"),
    ] = None

    def __post_init__(self) -> None:
        """Convert unit, quantity, start and stop, and check these and the clock.

        Raises InputError if one of them is invalid.
        """
        for field, value in zip(("unit", "quantity"), unit_by_name(self.unit, self.quantity), strict=True):
            object.__setattr__(self, field, value)
        for name, valid in _VALID.items():
            value = getattr(self, name)
            if value is None or value in valid:
                continue
            also = "; compare and look accept envelope too" if name == "quantity" else ""
            raise InputError(f"--{name}: is {show(value)}; it must be one of {', '.join(valid)}{also}")
        for name in ("start", "stop"):
            object.__setattr__(self, name, parse_time(getattr(self, name), f"--{name}"))


def with_reading_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command the options of `ReadingOptions`, which are passed to it as further keyword arguments.

    In the signature of the command, from which Typer builds the command line, the options replace the last parameter,
    **reading. Return the same function.
    """
    *own, _ = signature(command, eval_str=True).parameters.values()
    added = signature(ReadingOptions, eval_str=True).parameters.values()
    required_first = sorted([*added, *own], key=lambda parameter: parameter.default is not Parameter.empty)
    command.__signature__ = Signature(required_first)  # type: ignore[attr-defined]
    return command


@dataclass(frozen=True)
class FileRecord:
    """One record of a file, with its free decay.

    Attributes
    ----------
    path
        The file.
    raw
        The record as it was read.
    unit, quantity
        Unit of the displacement, such as "deg" (or of the recorded quantity, such as "rpm"), and the recorded quantity.
    findings
        Doubts about the unit, the times and the sampling rate of the record.
    signal
        The part of the record that is used, as `cut` returns it, in the base unit (such as rad). It is the free
        decay, or the whole oscillation if this is not the free decay of one oscillator. None if the record does not
        contain an oscillation, or if it was not searched for a free decay.
    refusal
        Reason why `signal` is None; empty if there is a signal, or if the record was not searched.
    several
        Whether the file contains several records.
    """

    path: Path
    raw: RawRecord
    unit: str
    quantity: str
    findings: tuple[Finding, ...]
    signal: Signal | None = None
    refusal: str = ""
    several: bool = False

    @property
    def label(self) -> str:
        """The run and the channel of the record, such as "run 2, phi", as far as the file names them."""
        run = f"run {self.raw.run}" if self.raw.run else ""
        return ", ".join(filter(None, (run, self.raw.channel)))


def records_in(path: Path, options: ReadingOptions, *, cleaned: bool = True) -> list[FileRecord]:
    """Read all records in a file that the options select, and check them for what looks wrong.

    Parameters
    ----------
    path
        The file.
    options
        The options of the command for reading files.
    cleaned
        Whether to search each record for its free decay, which becomes its `signal`. A record without a free decay has
        the reason as its `refusal`. If False, both are empty.

    Raises
    ------
    InputError
        If the file cannot be read, or does not contain what the options select.
    """
    raws = read_records(
        path,
        time=options.time,
        value=options.angle,
        rate=options.rate,
        runs=options.runs,
        channels=options.channels or (),
        time_unit=options.time_unit,
    )
    records = []
    for raw in raws:
        unit, quantity = unit_or_guess(raw, options.unit, options.quantity)
        doubts = findings(raw, unit, quantity, options.unit is not None)
        records.append(FileRecord(path, raw, unit, quantity, doubts, several=len(raws) > 1))
    return [with_free_decay(record, options) for record in records] if cleaned else records


def with_free_decay(record: FileRecord, options: ReadingOptions) -> FileRecord:
    """Return a copy of a record with its free decay as `signal`, or with the reason why it has none as `refusal`."""
    try:
        window = {name: getattr(options, name) for name in ("clock", "start", "stop")}
        signal = cut(record.raw, record.path.name, record.unit, record.quantity, **window)
    except InputError as error:
        return replace(record, refusal=str(error))
    return replace(record, signal=signal)


@dataclass(frozen=True)
class SelectedRecords:
    """The records of several files that a command uses, and lines to print about them.

    Attributes
    ----------
    records
        The records that are used.
    doubted
        Lines on what looks wrong with these records.
    notes
        Lines on how these records were read, and on records that were left out.
    failed
        Errors of the files that could not be read or do not contain a usable record.
    """

    records: list[FileRecord]
    doubted: list[str]
    notes: list[str]
    failed: list[InputError]


def select_records(
    paths: Sequence[Path], options: ReadingOptions, pool: Executor | None = None, quiet: bool = True
) -> SelectedRecords:
    """Read several files, and return the records that a command uses.

    If a file contains several records and the user did not select any of them, records without a free decay are left
    out with a note. Otherwise a record without a free decay makes its file unusable. If there is only one path, a
    record that is alone in the file, or that the user selected, is not searched for its free decay here: its `signal`
    and `refusal` are then empty.

    Parameters
    ----------
    paths
        The files.
    options
        The options of the command for reading files.
    pool
        Executor that reads the files in parallel; None to read them in this process.
    quiet
        Whether to show no progress.

    Raises
    ------
    InputError
        The first error of a file, if no file is usable.
    """
    # The workers of a scheduler may run in another folder, to which relative paths do not refer.
    read = partial(_choose, folder=Path.cwd(), options=options, cleaned=len(paths) > 1)
    run = map if pool is None else pool.map
    if not quiet:
        run = partial(map_with_bar, run)
    try:
        chosen, failed = read_each(paths, read, run)
    except Exception as fault:
        if pool is None or not is_kill(fault):
            raise
        restart(pool)
        chosen, failed = read_each(paths, read)
    parts: list[Any] = [list(chain.from_iterable(part)) for part in zip(*chosen)]
    return SelectedRecords(*parts, failed=failed)


def _choose(
    path: Path, folder: Path, options: ReadingOptions, cleaned: bool
) -> tuple[list[FileRecord], list[str], list[str]]:
    """Return the records of a file that are used, lines on what looks wrong, and lines on how they were read.

    `folder`: the folder that a relative path refers to. `cleaned`: whether to search for the free decay also in a
    record that is alone in the file or that the user selected. InputError is raised in these cases:

    - the file cannot be read;
    - the file contains several records, and none of them is a free decay;
    - a record that is alone or selected was searched and is not a free decay;
    - a doubt about a record is one of the `QUESTIONS`, which the user must answer first.
    """
    notes: list[str] = []
    all_of_it = options.runs is None and not options.channels and options.angle is None
    records = [replace(r, path=path) for r in records_in(folder / path, options, cleaned=cleaned)]
    several = len(records) > 1
    if several and all_of_it:
        every = records if cleaned else [with_free_decay(record, options) for record in records]
        records = [record for record in every if record.signal is not None]
        notes += [f"{path.name}: {r.label} is left out: {r.refusal}" for r in every if r.signal is None]
        if not records:
            none = f"{path.name}: none of its {len(every)} records is a free decay"
            raise InputError(f"{none}: {every[0].refusal}")
    for record in records:
        if record.refusal:
            raise InputError(record.refusal)
        for finding in record.findings:
            if finding.kind in QUESTIONS:
                raise InputError(f"{path.name}: {finding}")
    if several:
        names, more = [record.label for record in records[:4]], len(records) - 4
        further = f" and {more} more" if more > 0 else ""
        notes.append(f"{path.name}: {len(records)} records: {'; '.join(names)}{further}")
    raw = records[0].raw
    if raw.choice:
        notes.append(f"{path.name}: {raw.choice}")
    notes += [f"{path.name}: {note}" for note in raw.provenance.notes if note.startswith(FROM_FIRST)]
    return records, doubt_lines(path, records), notes


def doubt_lines(path: Path, records: Sequence[FileRecord]) -> list[str]:
    """Return lines on what looks wrong with the records of a file: for each kind of doubt, the first one.

    Each line begins with the name of the file.
    """
    first = {finding.kind: finding for record in reversed(records) for finding in record.findings}
    return [f"{path.name}: {finding}" for finding in first.values()]


def distinguishing_label(record: FileRecord, records: Sequence[FileRecord]) -> str:
    """Return the run or channel (or both) that distinguishes a record from the other records of its file.

    The text is empty if the file has only one record.
    """
    if not record.several:
        return ""
    channels = {other.raw.channel for other in records if other.path == record.path}
    return f"run {record.raw.run}" if record.raw.run and len(channels) == 1 else record.label


def study_signals(records: Sequence[FileRecord], options: ReadingOptions) -> list[RecordOptions]:
    """Convert records to the `RecordOptions` from which `comparison_tables` makes a study, in the same order.

    If a file contains numbered runs, the runs of one channel are repeats of one specimen. The name of the specimen is
    the name of the file without its ending, followed by the name of the channel if there are several. Other records
    have no specimen.
    """
    signals = []
    for record in records:
        time, angle = record.raw.columns
        specimen = ""
        if record.several and record.raw.run:
            channels = {other.raw.channel for other in records if other.path == record.path}
            specimen = record.path.stem if len(channels) == 1 else f"{record.path.stem} {record.raw.channel}"
        signals.append(
            {
                "file": str(record.path),
                "time": time if options.rate is None else None,
                "angle": angle,
                "rate": options.rate,
                "unit": record.unit,
                "quantity": record.quantity,
                "clock": options.clock,
                "start": options.start,
                "stop": options.stop,
                "time_unit": options.time_unit,
                "label": distinguishing_label(record, records),
                "specimen": specimen,
            }
        )
    return signals
