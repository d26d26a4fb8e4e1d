"""Choose the records in files by the options of a command, and report what is doubtful about them."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bayesdamp.cli.options import bound, wrong
from bayesdamp.records.cleaning.clean import clean, decimated
from bayesdamp.records.files.names import SECONDS, by_name
from bayesdamp.records.findings import QUESTIONS, Finding, Kind, findings
from bayesdamp.records.opening import read_each
from bayesdamp.records.read import FASTEST, FROM_FIRST, SLOWEST, read_records
from bayesdamp.records.record import RawRecord, read_as, unwrapped
from bayesdamp.types import InputError, Signal
from bayesdamp.units import UNITS

if TYPE_CHECKING:
    from bayesdamp.config.compare import Asked

MAYBE_ENVELOPE = "If these values are the amplitudes of an envelope, use --quantity envelope."
_VALID = {
    "unit": tuple(UNITS),
    "quantity": ("angle", "velocity", "acceleration"),
    "clock": ("auto", "as_logged", "uniform"),
    "time_unit": ("s", "ms", "us", "ns", "ps", "min", "h", "d"),
}
"""Values of options that a file can be read by."""
LONGEST = 290
"""Characters of a refusal with its command."""
_OPTIONS = {"value": "angle", "rate": "rate"}
"""Arguments of `read_records` that a refusal may ask for, as options; a rate replaces a column of times."""
_UNKNOWN = {"rate": "HZ", "angle": "NAME"}
_INTRODUCTION = "in one command (check its values): "
ROUNDS = 3
"""Refusals of one file that are answered one after the other."""


@dataclass(frozen=True)
class ReadingOptions:
    """How to read files, as the command line gives it; see `compare`."""

    time: str | None = None
    angle: str | None = None
    rate: float | None = None
    time_unit: str | None = None
    unit: str | None = None
    quantity: str | None = None
    clock: str = "auto"
    start: float | str = "auto"
    stop: float | str = "auto"
    runs: str | None = None
    channels: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Raise InputError for values that no file can be read by."""
        for field, value in zip(("unit", "quantity"), by_name(self.unit, self.quantity), strict=True):
            object.__setattr__(self, field, value)
        for name, valid in _VALID.items():
            value = getattr(self, name)
            if value is None or value in valid or (name == "time_unit" and value.lower() in SECONDS):
                continue
            also = "; compare and look accept envelope too" if name == "quantity" else ""
            raise wrong(f"--{name.replace('_', '-')}", value, f"one of {', '.join(valid)}{also}")
        for name in ("start", "stop"):
            object.__setattr__(self, name, bound(getattr(self, name), f"--{name}"))
        if isinstance(self.start, float) and isinstance(self.stop, float) and self.start >= self.stop:
            raise wrong("--stop", self.stop, f"later than --start ({self.start:g})")
        if self.rate is not None and not SLOWEST <= self.rate <= FASTEST:
            raise wrong(
                "--rate", self.rate, f"a number of samples per second from {SLOWEST:g} to {FASTEST:g}"
            )
        if self.rate is not None and self.time is not None:
            raise InputError("--rate: replaces a column of times; remove --rate or --time")

    def read(self, path: Path) -> list[RawRecord]:
        """Read the records of a file. Raises InputError."""
        return read_records(
            path,
            time=self.time,
            value=self.angle,
            rate=self.rate,
            runs=self.runs,
            channels=self.channels,
            time_unit=self.time_unit,
        )

    def interpret(self, raw: RawRecord) -> tuple[str, str, tuple[Finding, ...]]:
        """Return the unit and quantity of a record, and what looks wrong with it."""
        unit, quantity = read_as(raw, self.unit, self.quantity)
        doubtful = findings(raw, unit, quantity, self.unit is not None) if unit in UNITS else ()
        return unit, quantity, doubtful

    def assumes_rad(self, raw: RawRecord, unit: str, quantity: str) -> bool:
        """Return whether rad is assumed, because neither the file nor the user gives a unit."""
        return self.unit is None and not raw.unit and (unit, quantity) == ("rad", "angle")


@dataclass(frozen=True)
class FileRecord:
    """One record of a file: how it is read, the free decay in it (or why there is none), and what looks wrong.

    several: whether it is one of several records of its file.
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
        """The record's run and channel, empty where its file has one record."""
        run = f"run {self.raw.run}" if self.raw.run else ""
        return ", ".join(filter(None, (run, self.raw.channel)))


def records_in(path: Path, options: ReadingOptions, *, cleaned: bool = True) -> list[FileRecord]:
    """Return the records in a file.

    Parameters
    ----------
    path
        The file.
    options
        How to read it.
    cleaned
        Whether to look for the free decay in each record.

    Raises
    ------
    InputError
        Where the file cannot be read; with the command that answers what it leaves open.
    """
    try:
        raws = options.read(path)
    except InputError as error:
        raise _with_command(error, path, options) from None
    records = [FileRecord(path, raw, *options.interpret(raw), several=len(raws) > 1) for raw in raws]
    return [with_free_decay(record, options) for record in records] if cleaned else records


def with_free_decay(record: FileRecord, options: ReadingOptions) -> FileRecord:
    """Return the record with the free decay in it, or with the reason why there is none."""
    try:
        signal = clean(
            decimated(unwrapped(record.raw, record.unit, record.quantity)),
            name=record.path.name,
            unit=record.unit,
            quantity=record.quantity,
            clock=options.clock,
            start=options.start,
            stop=options.stop,
        )
    except InputError as error:
        return replace(record, refusal=str(error))
    return replace(record, signal=signal)


@dataclass(frozen=True)
class Chosen:
    """The records of files, what is doubtful about them, how they were read, and what is wrong with other files."""

    records: list[FileRecord]
    doubted: list[str]
    notes: list[str]
    failed: list[InputError]


def chosen_records(paths: Sequence[Path], options: ReadingOptions, *, every: bool = False) -> Chosen:
    """Choose the records of files.

    Where a file has several records and none was selected, those without a free decay are left out, with a note.

    Parameters
    ----------
    paths
        The files.
    options
        How to read them.
    every
        Whether every file must have a record.

    Raises
    ------
    InputError
        Where no file has a record, or one has none and every file must.
    """
    several = len(paths) > 1
    chosen, failed = read_each(paths, lambda path: _choose(path, options, several))
    if every and failed:
        raise failed[0]
    return Chosen(
        [record for records, _, _ in chosen for record in records],
        [line for _, doubted, _ in chosen for line in doubted],
        [line for _, _, notes in chosen for line in notes],
        failed,
    )


def _choose(
    path: Path, options: ReadingOptions, cleaned: bool
) -> tuple[list[FileRecord], list[str], list[str]]:
    """Return the records of a file, what is doubtful, and how they were read. Raises InputError.

    cleaned: whether to look for the free decay even where the file has one record.
    """
    notes: list[str] = []
    all_of_it = options.runs is None and not options.channels and options.angle is None
    records = records_in(path, options, cleaned=cleaned)
    several = len(records) > 1
    if several and all_of_it:
        every = records if cleaned else [with_free_decay(record, options) for record in records]
        records = [record for record in every if record.signal is not None]
        notes += [f"{path.name}: {r.label} is left out: {r.refusal}" for r in every if r.signal is None]
        if not records:
            raise InputError(
                f"{path.name}: none of its {len(every)} records is a free decay: {every[0].refusal}"
            )
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
    if raw.began:
        notes.append(f"{path.name}: {FROM_FIRST} ({raw.began:.15g} s).")
    notes += doubts(path, records, (Kind.CONSTANT,))
    doubted = doubts(path, records, [kind for kind in Kind if kind is not Kind.CONSTANT])
    return records, doubted, notes


def doubts(path: Path, records: Sequence[FileRecord], kinds: Iterable[Kind] = Kind) -> list[str]:
    """Return the findings of these kinds in all records of a file, each kind once."""
    first = {finding.kind: finding for record in reversed(records) for finding in record.findings}
    return [f"{path.name}: {finding}" for kind, finding in first.items() if kind in kinds]


def own_label(record: FileRecord, records: Sequence[FileRecord]) -> str:
    """Return what distinguishes a record from the others of its file: its run, its channel, or both; else nothing."""
    if not record.several:
        return ""
    channels = {other.raw.channel for other in records if other.path == record.path}
    return f"run {record.raw.run}" if record.raw.run and len(channels) == 1 else record.label


def as_signals(records: Sequence[FileRecord], options: ReadingOptions) -> list[Asked]:
    """Return records as entries of a study's [[signal]]; runs of one channel are repeats of one specimen."""
    o = options
    signals = []
    for record in records:
        time, angle = record.raw.columns
        specimen = ""
        if record.several and record.raw.repeat:
            channels = {other.raw.channel for other in records if other.path == record.path}
            specimen = record.path.stem if len(channels) == 1 else f"{record.path.stem} {record.raw.channel}"
        signals.append(
            {
                "file": str(record.path),
                "time": time,
                "angle": angle,
                "rate": o.rate,
                "unit": record.unit,
                "quantity": record.quantity,
                "clock": o.clock,
                "start": o.start,
                "stop": o.stop,
                "time_unit": o.time_unit,
                "label": own_label(record, records),
                "specimen": specimen,
            }
        )
    return signals


def _with_command(error: InputError, path: Path, options: ReadingOptions) -> InputError:
    """Return a refusal of a file with the command that answers it and whatever else the file leaves open."""
    answers: dict[str, str] = {}
    refused, trial = error, options
    for _ in range(ROUNDS):
        needed = {_OPTIONS[name]: name for name in refused.arguments if name in _OPTIONS}
        if not needed:
            break
        answers |= {option: refused.likely.get(name, _UNKNOWN[option]) for option, name in needed.items()}
        trial = replace(trial, angle=answers.get("angle", options.angle))
        if rate := answers.get("rate", ""):
            trial = replace(trial, rate=1.0 if rate == _UNKNOWN["rate"] else float(rate), time=None)
        try:
            raws = trial.read(path)
        except InputError as another:
            refused = another
            continue
        answers = _answers(raws[0], trial) | answers
        break
    if not answers:
        return error
    command = f"; {_INTRODUCTION}{_command(path, options, answers)}"
    room = max(LONGEST - len(str(InputError("", error.where, error.at))) - len(command), 60)
    what = error.what if len(error.what) <= room else f"{error.what[: room - 3]}..."
    return InputError(what + command, error.where, error.at)


def one_command(records: Sequence[FileRecord], options: ReadingOptions) -> list[str]:
    """Return a line for each file with several doubts: the command that answers all of them."""
    by_path: dict[Path, dict[str, str]] = {}
    for record in records:
        by_path[record.path] = _answers(record.raw, options) | by_path.get(record.path, {})
    return [
        f"{path.name}: {_INTRODUCTION}{_command(path, options, answers)}"
        for path, answers in by_path.items()
        if len(answers) > 1
    ]


def _answers(raw: RawRecord, options: ReadingOptions) -> dict[str, str]:
    """Return the likeliest values of the options that settle what a record leaves open."""
    unit, quantity, doubtful = options.interpret(raw)
    answers = {"unit": unit} if options.assumes_rad(raw, unit, quantity) else {}
    return answers | dict(doubt.answer for doubt in doubtful if doubt.answer is not None)


def _command(path: Path, options: ReadingOptions, answers: Mapping[str, str]) -> str:
    """Return `bayesdamp compare` of a file with the options that were given and those that answer."""
    names = ("time", "angle", "rate", "time_unit", "unit", "quantity", "clock", "start", "stop", "runs")
    given = {name.replace("_", "-"): getattr(options, name) for name in names}
    if "rate" in answers:
        del given["time"]
    values = {name: str(value) for name, value in given.items() if value not in (None, "auto")}
    words = [word for name, value in (values | dict(answers)).items() for word in (f"--{name}", value)]
    words += [word for channel in options.channels for word in ("--channel", channel)]
    return shlex.join(["bayesdamp", "compare", str(path), *words])
