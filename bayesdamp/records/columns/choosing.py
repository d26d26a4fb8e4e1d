"""Which columns of a file are a record: the times, and what swings and dies down, a displacement before its
derivatives."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.records.columns.names import (
    asked_for,
    listed,
    names_index,
    names_time,
    parted,
    runs_asked,
    seconds_of_unit,
    shown,
    unit_said,
)
from bayesdamp.records.columns.swings import LARGEST, Swing, proportional, swing
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import sampling_rate
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

LEAST = 10
"""Samples that a record must have."""
LEVELS = 3
"""A column with no more values than these is a switch or a sensor at rest."""
_ORDER = {"angle": 0, "": 0, "velocity": 1, "acceleration": 2}
_DERIVED = re.compile(r"\b(abs|absolute|magnitude|total|norm|resultant|rms|energ\w*)\b", re.IGNORECASE)
DIFFER = 0.01
"""Share by which a given rate may differ from what the file, or its own times, say."""
_BACK = 0.02
"""Share of steps back in time that a column named after times may have."""
_FAR = 10.0
"""Of columns without units, one that swings so many times as much as the next is the record."""
_PAIRS = 40
"""Columns that are compared with each other; among more than these no choice is plain."""
_ABOUT_G, _ABOUT_TWICE = 0.25, 0.1
"""Share by which a mean acceleration may differ from gravity (a wide swing lowers it), and share by which one period,
known coarsely, may differ from twice another."""
_MINOR = 1 / 3
"""Of sensors alike, one that swings less than this share of the largest says little that that one does not."""


LEFT_OUT = 6
"""Columns that are named of those that are left out."""


@dataclass(frozen=True, eq=False)
class Series:
    """The columns of one record. rate: in Hz, where there is no column of times; why: sentences on what was chosen;
    choice: the sentence on these columns, empty where there were no others; still: names of other columns that do not
    change."""

    value: Column
    time: Column | None = None
    rate: float | None = None
    run: str = ""
    why: tuple[str, ...] = ()
    still: tuple[str, ...] = ()
    choice: str = ""


@dataclass(frozen=True, eq=False)
class _Block:
    """Columns that belong together: those of one run and group."""

    run: str
    columns: tuple[Column, ...]
    time: Column | None
    rate: float | None
    why: tuple[str, ...] = ()

    def record(self, value: Column, choice: str = "", still: tuple[str, ...] = ()) -> Series:
        """Return the record of one of the columns."""
        time = None if self.time is value else self.time
        why = (*self.why, choice) if choice else self.why
        return Series(value, time, None if time is not None else self.rate, self.run, why, still, choice)


def series(
    found: Contents,
    *,
    time: str | int | None = None,
    values: Sequence[str | int] = (),
    rate: float | None = None,
    runs: str | None = None,
) -> list[Series]:
    """The records in a file, as asked for or as chosen. Raises InputError, one line that lists what there is."""
    wanted = [column for one in values for column in asked_for(found.columns, one)]
    timed = asked_for(found.columns, time) if time is not None else []
    blocks = [_block(found, run, group, timed, rate) for run, group in _places(found.columns)]
    labels = list(dict.fromkeys(block.run for block in blocks if block.run))
    if runs is not None:
        kept = runs_asked(runs, labels)
        blocks = [block for run in kept for block in blocks if block.run == run]
    blocks = [_with_named_time(block) for block in blocks]
    if wanted:
        chosen = [s for column in wanted for s in _given(found, column, blocks)]
        if not chosen:
            raise InputError(
                "the column asked for belongs to none of the runs asked for; leave out one of the two"
            )
        return chosen
    blocks = [block for block in blocks if _candidates(block)] or [b for b in blocks if _rest(b)]
    if not blocks:
        if len(found.columns) == 1:
            raise InputError("has one column, and it holds the times; export the recorded quantity too")
        raise InputError(
            f"no column but the times holds numbers that change; columns are {listed(found.columns)}"
        )
    chosen = _same_in_all(found, blocks)
    return [_with_clock(s, found) for s in _not_to_pivot(found, chosen)]


def _not_to_pivot(found: Contents, chosen: list[Series]) -> list[Series]:
    """Leave out accelerations that contain gravity. Raises InputError where nothing else is left."""
    left = [s for s in chosen if unit_said(s.value)[1] != "acceleration" or not contains_gravity(s.value)]
    if left:
        return left
    column = chosen[0].value
    kind = unit_said(column)
    axes = [c for c in found.columns if c is not column and kind[0] and unit_said(c) == kind and _changes(c)]
    named = f" ({', '.join(shown(found.columns, c) for c in axes[:3])})" if axes else ""
    likely = next((c.name for c in axes if c.name and swing(c.values).swings), "")
    raise InputError(
        f"{shown(found.columns, column)} contains gravity (mean {np.nanmean(column.values):.4g}): on a pendulum it "
        f"swings at twice the frequency; give the axis along the swing{named}, or this one if it moves up and down",
        arguments=["value"],
        likely={"value": likely} if likely else {},
    )


def _places(columns: Sequence[Column]) -> list[tuple[str, str]]:
    """Run and group of the columns, each once, in the order of the file."""
    places = list(dict.fromkeys((parted(c)[1], c.group) for c in columns))
    # Where runs are marked in the names, what is marked by none, one column of times say, belongs to all of them.
    return [p for p in places if p[0] or not any(q[0] and q[1] == p[1] for q in places)]


def _block(found: Contents, run: str, group: str, timed: list[Column], rate: float | None) -> _Block:
    columns = tuple(c for c in found.columns if c.group == group and parted(c)[1] in (run, ""))
    own = tuple(c for c in columns if parted(c)[1] == run) if run else columns
    if rate is not None:
        return _Block(run, own, None, rate, _other_rate(_time_column(own) or _time_column(columns), rate))
    if timed:
        mine = [c for c in timed if parted(c)[1] == run] or timed
        return _Block(run, own, mine[0], None)
    size = max((c.values.size for c in own), default=0)
    outside = tuple(
        c for c in found.columns if c.group == "" and group and names_time(c) and c.values.size == size
    )
    time = _time_column(own) or _time_column(columns) or _time_column(outside)
    facts = {  # of the group that the columns belong to
        name: value
        for name, value in found.facts.items()
        if any(c.name.startswith(f"{name.rpartition('.')[0]}.") for c in own)
    }
    said = sampling_rate(facts) or sampling_rate(found.facts)
    counted = said is not None and time is not None and seconds_of_unit(time) is None and _counts(time.values)
    if time is not None and not counted:
        named = time.name and len(found.columns) > 2
        return _Block(run, own, time, None, (f"Times are those of column {time.name!r}.",) if named else ())
    if said is not None:
        own = tuple(c for c in own if c is not time)
        return _Block(run, own, None, said[0], (f"The file says {said[1]!r}: {said[0]:g} Hz.",))
    return _Block(run, own, None, None)


def _other_rate(time: Column | None, rate: float) -> tuple[str, ...]:
    """A sentence where the file's own times have another rate than the one that was given, in Hz."""
    step = 0.0 if time is None else float(np.median(np.diff(time.values[np.isfinite(time.values)])))
    seconds = None if time is None else seconds_of_unit(time)
    if time is None or step <= 0 or (seconds is None and step == 1.0):  # which counts samples
        return ()
    own = 1 / (step * (seconds or 1.0))
    if abs(rate / own - 1) < DIFFER:
        return ()
    return (
        f"Times in column {time.name!r} are at {own:.6g} Hz; the record is read at {rate:.6g} Hz, as asked.",
    )


def with_own_clocks(found: Contents) -> Contents:
    """Put each column of times into a group with the values behind it, where a table has several that differ.

    `Time A, A, Time B, B`: the times may also follow their values, if they do so throughout. A table whose runs are
    marked stays as it is.
    """
    columns = list(found.columns)
    for group in dict.fromkeys(c.group for c in columns):
        at = [i for i, c in enumerate(columns) if c.group == group and np.isfinite(c.values).any()]
        if any(parted(columns[i])[1] for i in at):
            continue
        clocks = [_time_score(columns[i], not columns[i].name) > 0 for i in at]
        if clocks and clocks[-1]:
            at, clocks = at[::-1], clocks[::-1]
        starts = [k for k, clock in enumerate(clocks) if clock]
        ends = [*starts[1:], len(at)]
        alternate = (
            len(starts) > 1 and starts[0] == 0 and all(b - a > 1 for a, b in zip(starts, ends, strict=True))
        )
        if not alternate or all(
            np.array_equal(columns[at[0]].values, columns[at[k]].values, equal_nan=True) for k in starts
        ):
            continue
        for number, (a, b) in enumerate(zip(starts, ends, strict=True), start=1):
            for i in at[a:b]:
                columns[i] = replace(columns[i], group=f"{group} pair {number}".strip())
        found = replace(found, paired=True)
    return replace(found, columns=tuple(columns))


def _time_column(columns: Sequence[Column]) -> Column | None:
    """The column that holds the times, None where there is none."""
    scored = [(score, -i, c) for i, c in enumerate(columns) if (score := _time_score(c, i == 0)) > 0]
    return max(scored, key=lambda one: one[:2])[2] if scored else None


def _time_score(column: Column, first: bool) -> int:
    """How much like times a column looks; 0 for not at all."""
    y = column.values[np.isfinite(column.values)]
    if y.size < 2 or column.rate is not None or names_index(column):
        return 0
    steps = np.diff(y)
    back = float(np.mean(steps < 0))
    if back > _BACK or not np.any(steps > 0):
        return 0
    if back:
        return int(names_time(column))  # a clock that was set back; what to do about it is said later
    if names_time(column):
        unit = seconds_of_unit(column) is not None
        return 4 + 2 * unit - column.clock
    return 2 if first and np.all(steps > 0) else 0


def _candidates(block: _Block) -> list[Column]:
    """Columns that may be a record's values: numbers that change."""
    return [c for c in _rest(block) if _changes(c)]


def _rest(block: _Block) -> list[Column]:
    """The columns that are no times and no numbers of samples."""
    size = block.time.values.size if block.time is not None else None
    return [
        c
        for c in block.columns
        if c is not block.time
        and (size is None or c.values.size == size or c.rate is not None)
        and not (names_time(c) and _time_score(c, False))
        and not (names_index(c) and _counts(c.values))
    ]


def _changes(column: Column) -> bool:
    y = column.values[np.isfinite(column.values)]
    return y.size >= LEAST and np.unique(y[:: max(1, y.size // 20000)]).size > LEVELS


def _counts(y: np.ndarray) -> bool:
    y = y[np.isfinite(y)]
    return bool(y.size > 1 and np.all(np.diff(y) == 1))


def _given(found: Contents, column: Column, blocks: list[_Block]) -> list[Series]:
    """The record of a column that was asked for."""
    run, group = parted(column)[1], column.group
    home = [b for b in blocks if any(c is column for c in b.columns)]
    home = home or [b for b in blocks if not run and any(c.group == group for c in b.columns)]
    if not home:
        return []
    record = replace(home[0].record(column), run=run)
    if record.time is None and record.rate is None and column.rate is None and len(found.columns) == 2:
        other = next(c for c in found.columns if c is not column)
        if other.values.size == column.values.size:
            record = replace(record, time=other)
    return [_with_clock(record, found)]


def _with_clock(record: Series, found: Contents) -> Series:
    """The record with its column's own rate where it has no times. Raises InputError where it has no clock at all."""
    if record.time is not None or record.rate is not None:
        return record
    if record.value.rate is not None:
        note = f"The file gives the sampling rate: {record.value.rate:.9g} Hz."
        return replace(record, rate=record.value.rate, why=(*record.why, note))
    if len(found.columns) == 1:
        raise InputError(
            "no time given, and its one column holds the values: export the times, or give the rate in Hz",
            arguments=["rate"],
        )
    raise InputError(
        f"no time given: name the time column or give the rate in Hz; columns are {listed(found.columns)}",
        arguments=["time", "rate"],
    )


def _with_named_time(block: _Block) -> _Block:
    """Give a block without any clock the column that is named like times, though they do not increase: what is wrong
    with them is said later. Raises InputError where that column has another length."""
    time = next((c for c in block.columns if names_time(c) and not names_index(c)), None)
    clocked = (
        block.time is not None or block.rate is not None or any(c.rate is not None for c in block.columns)
    )
    if clocked or time is None:
        return block
    for other in block.columns:
        if len(block.columns) == 2 and other.values.size != time.values.size:
            raise InputError(
                f"has {time.values.size} times in {time.name!r} and {other.values.size} values in "
                f"{other.name!r}; a record has as many of both: export it again, or give the rate in Hz",
                arguments=["rate"],
            )
    return replace(block, time=time)


def _same_in_all(found: Contents, blocks: list[_Block]) -> list[Series]:
    """The choice in each block; of several runs, the column that most of them would choose."""
    picks = [_chosen(found, block) for block in blocks]
    bases = Counter(tuple(parted(c)[0] for c in some) for some, _ in picks)
    runs = len({block.run for block in blocks}) > 1
    usual = bases.most_common(1)[0][0]
    records: list[Series] = []
    for block, (some, choice) in zip(blocks, picks, strict=True):
        if runs:
            named = [c for base in usual for c in block.columns if parted(c)[0] == base]
            some = named or some
        still = tuple(c.name for c in _rest(block) if c.name and not _changes(c))
        records += [block.record(c, choice, still) for c in some]
    for run in dict.fromkeys(record.run for record in records):
        _plain(found, [record for record in records if record.run == run])
    return records


def _plain(found: Contents, records: list[Series]) -> None:
    """Refuse a choice among columns that are no channels alike. Raises InputError."""
    some = [record.value for record in records]
    kinds = {unit_said(c) for c in some}
    bare = {c.name.removeprefix(f"{c.group}.") for c in some}
    if len(bare) == 1 and len({c.group for c in some}) == len(some):
        return  # the same column of several sheets
    alike = len(kinds) == 1 and all(unit for unit, _ in kinds)
    if len(some) > 1 and not (alike or found.channels or found.paired):
        names = ", ".join(shown(found.columns, c) for c in some[:3])
        more = f" and {len(some) - 3} more" if len(some) > 3 else ""
        clockless = any(r.time is None and r.rate is None and r.value.rate is None for r in records)
        no_times = " and no times" if clockless else ""
        also = ", and the name of the times or the rate in Hz" if clockless else ""
        raise InputError(
            f"has {len(found.columns)} columns{no_times}, and {names}{more} may each be the record; give the name or "
            f"number of one, or of several channels{also}; columns are {listed(found.columns)}",
            arguments=["value", "channels", *(["time", "rate"] if clockless else [])],
            likely={"value": some[0].name or shown(found.columns, some[0])},
        )


def _chosen(found: Contents, block: _Block) -> tuple[list[Column], str]:
    """The columns of one run that are a record each, and why."""
    left = _candidates(block) or _rest(block)
    if len(left) == 1:
        return left, ""
    seen = {id(c): swing(c.values) for c in left}
    moving = [c for c in left if seen[id(c)].swings] or left
    moving = [c for c in moving if seen[id(c)].lasts] or moving
    if not found.channels or all(unit_said(c)[0] for c in moving):
        moving = _lowest_derivative(_across_gravity(moving, seen))
        if len(moving) <= _PAIRS:
            moving = _independent(moving, seen)
        moving = [c for c in moving if not _DERIVED.search(parted(c)[0])] or moving
        moving = [c for c in moving if seen[id(c)].dies] or moving
    if not found.channels:
        moving = _major(moving, seen)
        steady = [c for c in moving if not seen[id(c)].grows_again]
        moving = moving if any(unit_said(c)[0] for c in moving) else steady or moving
    if len(moving) > 1:
        out = ", ".join([shown(found.columns, c) for c in left if c not in moving][:LEFT_OUT])
        return moving, f"Left out are columns that do not swing and die down: {out}." if out else ""
    taken = f"Column {shown(found.columns, moving[0])} is taken"
    return moving, f"{taken}: of {len(left)} that change, it is the one that swings and dies down."


def contains_gravity(column: Column) -> bool:
    """Return whether a column's mean is that of gravity, and nothing says that it is not an acceleration."""
    gravity, (unit, quantity) = UNITS["g"].factor, unit_said(column)
    y = column.values[np.isfinite(column.values)]
    if not y.size or np.abs(y).max() > LARGEST:
        return False
    factor = 1.0 if not unit else UNITS[unit].factor if unit in UNITS and UNITS[unit].base == "m" else 0.0
    may_be = quantity == "acceleration" or not (unit or quantity)
    return may_be and abs(abs(float(y.mean())) * factor / gravity - 1) < _ABOUT_G


def _across_gravity(columns: list[Column], seen: dict[int, Swing]) -> list[Column]:
    """Leave out accelerations that contain gravity where another axis swings at half their frequency.

    The pull of a pendulum's string is largest twice in a cycle.
    """

    def doubled(column: Column) -> bool:
        others = [c for c in columns if unit_said(c) == unit_said(column) and not contains_gravity(c)]
        return any(abs(seen[id(c)].period / seen[id(column)].period / 2 - 1) < _ABOUT_TWICE for c in others)

    return [c for c in columns if not (contains_gravity(c) and doubled(c))]


def _independent(columns: list[Column], seen: dict[int, Swing]) -> list[Column]:
    """Leave out what is another column in another unit."""
    kept: list[Column] = []
    for column in columns:
        twin = next((b for b in kept if proportional(b.values, column.values)), None)
        if twin is None:
            kept.append(column)
        elif unit_said(twin) == unit_said(column) and seen[id(column)].size > seen[id(twin)].size:
            # Of one unit, as the axes of a sensor are: the one that shows more.
            kept[kept.index(twin)] = column
    return kept


def _lowest_derivative(columns: list[Column]) -> list[Column]:
    """Leave out derivatives of other columns: a velocity where there is a displacement of the same kind."""
    kinds = [unit_said(c) for c in columns]
    ranks = [(UNITS[unit].base if unit in UNITS else unit, _ORDER[quantity]) for unit, quantity in kinds]
    lowest = {base: min(order for other, order in ranks if other == base) for base, _ in ranks}
    return [c for c, (base, order) in zip(columns, ranks, strict=True) if order == lowest[base]]


def _major(columns: list[Column], seen: dict[int, Swing]) -> list[Column]:
    """Of sensors of one unit, those that swing nearly as much as the largest; where no unit is said, the one that
    swings far more than all others."""
    sizes = [seen[id(c)].size for c in columns]
    kinds = {unit_said(c) for c in columns}
    if not any(unit for unit, _ in kinds):
        far = [c for c, size in zip(columns, sizes, strict=True) if size >= _FAR * sorted(sizes)[-2:][0]]
        return far if len(far) == 1 else columns
    if len(kinds) > 1:
        return columns
    return [c for c, size in zip(columns, sizes, strict=True) if size >= _MINOR * max(sizes)]
