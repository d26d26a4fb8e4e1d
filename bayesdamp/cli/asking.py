"""From files and options to the records that a command works on, with what looks wrong said first."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bayesdamp.cli.open_questions import all_at_once, read, unstated
from bayesdamp.cli.reading import Options
from bayesdamp.records.cleaning.decimate import decimated
from bayesdamp.records.findings import QUESTIONS, Finding, Kind, findings
from bayesdamp.records.opening import read_each
from bayesdamp.records.read import FROM_FIRST
from bayesdamp.records.record import RawRecord, read_as, unwrapped
from bayesdamp.types import InputError, Refusal, Signal
from bayesdamp.units import UNITS

if TYPE_CHECKING:
    from bayesdamp.config.compare import Asked

MAYBE_ENVELOPE = "If these are amplitudes, of an envelope: --quantity envelope"


@dataclass(frozen=True)
class Found:
    """One record: what the file holds, how it is read, the free decay in it (or why there is none), and what looks
    wrong. several: whether it is one of several of its file."""

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


def found_records(path: Path, options: Options, *, cleaned: bool = True) -> list[Found]:
    """The records in a file. cleaned: whether to look for the free decay in each. Raises InputError."""
    try:
        raws = read(path, options)
    except InputError as error:
        raise all_at_once(error, path, options) from None
    return [_found(path, raw, options, cleaned) for raw in raws]


def _found(path: Path, raw: RawRecord, options: Options, cleaned: bool) -> Found:
    unit, quantity = read_as(raw, options.unit, options.quantity)
    doubts = findings(raw, unit, quantity, options.unit is not None) if unit in UNITS else ()
    if not cleaned:
        return Found(path, raw, unit, quantity, doubts)
    from bayesdamp.records.cleaning.clean import clean  # imports slowly

    try:
        signal = clean(
            decimated(unwrapped(raw, unit, quantity)),
            name=path.name,
            unit=unit,
            quantity=quantity,
            clock=options.clock,
            start=options.start,
            stop=options.stop,
        )
    except InputError as error:
        return Found(path, raw, unit, quantity, doubts, None, str(error))
    return Found(path, raw, unit, quantity, doubts, signal)


def first_words_on(found: Sequence[Found], options: Options) -> list[str]:
    """A line on each record before anything is fitted: its frequency and damping without any law, or what it is if not
    the free decay of one oscillator; none where nothing swings. Then of each file whose unit nobody states, which is
    taken."""
    from bayesdamp.interface.no_free_decay import no_free_decay
    from bayesdamp.records.cleaning.window import other_decays
    from bayesdamp.records.oscillation.first_look import first_words  # imports slowly
    from bayesdamp.verdict.units import in_unit

    said = []
    unsaid: dict[str, None] = {}
    for one in found:
        seen = one if one.signal is not None else _found(one.path, one.raw, options, True)
        if seen.signal is not None:
            unsaid |= {one.path.name: None} if unstated(one.raw, one.unit, one.quantity, options) else {}
            other = no_free_decay(seen.signal)
            whose = ", ".join(filter(None, (one.path.name, _own_label(one, found) if one.several else "")))
            with suppress(Refusal):
                if other is not None:
                    said.append(f"{whose}: {in_unit(other, UNITS[one.unit]).sentence}")
                    continue
                first = first_words(seen.signal).in_unit(UNITS[one.unit])
                said.append(f"{whose}: {first.sentence()}")
                about = seen.signal.provenance
                others = other_decays(about.decays, about.start, about.start + float(seen.signal.t[-1]))
                said += [f"{whose}: {others}"] if others else []
        elif one.raw.y.min() >= 0:
            said.append(f"{one.path.name}: {MAYBE_ENVELOPE}")
    taken = "No unit is stated: an angle in rad is taken; --unit m (mm, deg) says another."
    return [*said, *(f"{name}: {taken}" for name in unsaid)]


def chosen_envelopes(
    paths: Sequence[Path], unit: str | None, **options: Any
) -> tuple[list[Asked], list[InputError]]:
    """Return the envelopes of files as a study's [[signal]] says them, and what is wrong with other files.

    Parameters
    ----------
    paths
        Of the files.
    unit
        Of the readings; None where the files are to say it.
    **options
        As in a [[signal]]: time, angle, rate, frequency, start, stop.

    Raises
    ------
    InputError
        Where none can be read.
    """
    from bayesdamp.config import Recording  # imports slowly
    from bayesdamp.pipeline.envelopes import read_recording

    def readable(path: Path) -> Asked:
        # Not checked as a study's table, whose keys nobody has written here.
        source = Recording.model_construct(file=path.name, path=path.resolve(), unit=unit or "", **options)
        read_recording(source, path.name)
        return {"file": str(path), "unit": unit, "quantity": "envelope", **options}

    return read_each(paths, readable)


@dataclass(frozen=True)
class Chosen:
    """The records of files, what is doubted about them, how they were read, and what is wrong with other files."""

    records: list[Found]
    doubted: list[str]
    said: list[str]
    failed: list[InputError]


def chosen_records(paths: Sequence[Path], options: Options, *, every: bool = False) -> Chosen:
    """Choose the records of files. every: whether every file must have one.

    Of several records in a file that were not asked for one by one, those without a free decay are left out, and said.
    Raises InputError where no file has a record, or one has none and every file must.
    """
    several = len(paths) > 1
    found, failed = read_each(paths, lambda path: _chosen(path, options, several))
    if every and failed:
        raise failed[0]
    return Chosen(
        [one for records, _, _ in found for one in records],
        [line for _, doubted, _ in found for line in doubted],
        [line for _, _, said in found for line in said],
        failed,
    )


def _chosen(path: Path, options: Options, cleaned: bool) -> tuple[list[Found], list[str], list[str]]:
    """(the records of a file, what is doubted, how they were read). cleaned: whether the free decay in it is looked for
    already now. Raises InputError."""
    said: list[str] = []
    all_of_it = options.runs is None and not options.channels and options.angle is None
    found = found_records(path, options, cleaned=cleaned)
    several = len(found) > 1
    if several and all_of_it:
        tried = found if cleaned else found_records(path, options)
        found = [one for one in tried if one.signal is not None]
        said += [
            f"{path.name}: {one.label} is left out: {one.refusal}" for one in tried if one.signal is None
        ]
        if not found:
            raise InputError(
                f"{path.name}: none of its {len(tried)} records is a free decay: {tried[0].refusal}"
            )
    for one in found:
        if one.refusal:
            raise InputError(one.refusal)
        for finding in one.findings:
            if finding.kind in QUESTIONS:
                raise InputError(f"{path.name}: {finding}")
    if several:
        names, more = [one.label for one in found[:4]], len(found) - 4
        said.append(
            f"{path.name}: {len(found)} records: {'; '.join(names)}{f' and {more} more' if more > 0 else ''}"
        )
    if found[0].raw.choice:
        said.append(f"{path.name}: {found[0].raw.choice}")
    if found[0].raw.began:
        said.append(f"{path.name}: {FROM_FIRST} ({found[0].raw.began:.15g} s).")
    said += doubts(path, found, (Kind.CONSTANT,))
    doubted = doubts(path, found, [kind for kind in Kind if kind is not Kind.CONSTANT])
    return [replace(one, several=several) for one in found], doubted, said


def doubts(path: Path, found: Sequence[Found], kinds: Iterable[Kind] = Kind) -> list[str]:
    """The findings of these kinds of all records of a file, each kind once."""
    first = {finding.kind: finding for one in reversed(found) for finding in one.findings}
    return [f"{path.name}: {finding}" for kind, finding in first.items() if kind in kinds]


def _own_label(one: Found, found: Sequence[Found]) -> str:
    """What tells a record from the others of its file: its run, or its channel, or both."""
    others = [other for other in found if other.path == one.path]
    if one.raw.run and len({other.raw.channel for other in others}) == 1:
        return f"run {one.raw.run}"
    return one.label


def _specimen(one: Found, found: Sequence[Found]) -> str:
    """A name for what runs of one channel are repeats of."""
    channels = {other.raw.channel for other in found if other.path == one.path}
    return one.path.stem if len(channels) == 1 else f"{one.path.stem} {one.raw.channel}"


def as_signals(found: Sequence[Found], options: Options) -> list[Asked]:
    """Records as a study's [[signal]] says them."""
    o = options
    reading = {"clock": o.clock, "start": o.start, "stop": o.stop, "time_unit": o.time_unit}
    return [
        {
            "file": str(one.path),
            **dict(zip(("time", "angle"), one.raw.columns, strict=True)),
            "rate": o.rate,
            "unit": one.unit,
            "quantity": one.quantity,
            **reading,
            "label": _own_label(one, found) if one.several else "",
            "specimen": _specimen(one, found) if one.several and one.raw.repeat else "",
        }
        for one in found
    ]
