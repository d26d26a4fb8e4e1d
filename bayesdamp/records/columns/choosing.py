"""Which columns of a file are a record: the times, and what swings and dies down, a displacement before its
derivatives."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.records.columns.gravity import Pull, across, pull
from bayesdamp.records.columns.names import (
    asked_for,
    listed,
    names_index,
    names_time,
    numbered_alike,
    parted,
    runs_asked,
    seconds_of_unit,
    shown,
    unit_said,
)
from bayesdamp.records.columns.swings import Swing, derivative, proportional, swing
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import doubtful_rate, sampling_rate
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

LEAST = 10
"""Samples that a record must have."""
LEVELS = 3
"""A column with no more values than these is a switch or a sensor at rest."""
_ORDER = {"angle": 0, "": 0, "velocity": 1, "acceleration": 2}
_DERIVED = re.compile(r"\b(abs|absolute|magnitude|total|norm|resultant|rms|energ\w*)\b", re.IGNORECASE)
_BACK = 0.02
"""Share of steps back in time that a column named after times may have."""
_FAR = 10.0
"""Of columns without units, one that swings so many times as much as the next is the record."""
_PAIRS = 40
"""Columns that are compared with each other; among more than these no choice is plain."""
_MINOR = 1 / 3
"""Of sensors alike, one that swings less than this share of the largest says little that that one does not."""


LEFT_OUT = 6
"""Columns that are named of those that are left out."""
DIES, DIES_FOR_GOOD = "swings and dies down", "swings and dies down for good"


@dataclass(frozen=True)
class Choice:
    """The column that was taken, or, where several were taken, the names of the columns that were left out.

    taken: its name. why: what only it does. changing: how many columns change, including it. still: how many others do
    not change. left_out: names of columns that do not swing and die down, where several were taken.
    """

    taken: str = ""
    why: str = DIES
    changing: int = 1
    still: int = 0
    left_out: Sequence[str] = ()

    def __str__(self) -> str:
        """Write it as a sentence."""
        if self.left_out:
            names = ", ".join(self.left_out[:LEFT_OUT])
            return f"Left out are columns that do not swing and die down: {names}."
        reason = "nothing else goes with these times"
        if self.changing > 1:
            reason = (
                f"of {self.changing} that change it alone {self.why}, but for copies and derivatives of it"
            )
        elif self.still:
            are = (
                "is only one column that does"
                if self.still == 1
                else f"are only {self.still} columns that do"
            )
            reason = f"beside it {are} not change"
        return f"Column {self.taken} is taken: {reason}."


@dataclass(frozen=True, eq=False)
class Series:
    """The columns of one record. rate: in Hz, where there is no column of times; why: sentences on what was chosen;
    choice: why these columns, where there were others; still: names of columns beside it that do not change; aside: the
    times that a given rate stands in for."""

    value: Column
    time: Column | None = None
    rate: float | None = None
    run: str = ""
    why: tuple[str, ...] = ()
    still: tuple[str, ...] = ()
    choice: Choice | None = None
    aside: Column | None = None


@dataclass(frozen=True, eq=False)
class _Block:
    """Columns that belong together: those of one run and group."""

    run: str
    columns: tuple[Column, ...]
    time: Column | None
    rate: float | None
    said: tuple[str, ...] = ()
    aside: Column | None = None


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
        chosen = [
            s for column in wanted for s in _given(found, column, blocks, time is None and rate is None)
        ]
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
    """Leave out accelerations that may point to a pendulum's pivot. Raises InputError where nothing else is left."""
    left = [s for s in chosen if pull(s.value) in (None, Pull.CONSTANT)]
    if left:
        return left
    column = chosen[0].value
    others = [
        c for c in found.columns if c is not column and unit_said(c) == unit_said(column) and _changes(c)
    ]
    swinging = [c for c in others if swing(c.values).swings]
    axes = (
        f" ({', '.join(shown(found.columns, c) for c in others[:3])})"
        if unit_said(column)[0] and others
        else ""
    )
    raise InputError(
        f"{shown(found.columns, column)} contains gravity (mean {np.nanmean(column.values):.4g}): on a pendulum it "
        f"swings at twice the frequency; give the axis along the swing{axes}, or this one if it moves up and down",
        arguments=["value"],
        likely={"value": swinging[0].name} if axes and swinging and swinging[0].name else {},
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
        return _Block(run, own, None, rate, aside=_time_column(own) or _time_column(columns))
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


def _given(found: Contents, column: Column, blocks: list[_Block], clockless: bool) -> list[Series]:
    """The record of a column that was asked for."""
    run, group = parted(column)[1], column.group
    home = [b for b in blocks if any(c is column for c in b.columns)]
    home = home or [b for b in blocks if not run and any(c.group == group for c in b.columns)]
    if not home:
        return []
    block = home[0]
    time = block.time if block.time is not column else None
    record = Series(
        column, time, None if time is not None else block.rate, run, block.said if time is not None else ()
    )
    if clockless and time is None and len(found.columns) == 2 and record.rate is None and column.rate is None:
        other = next(c for c in found.columns if c is not column)
        if other.values.size == column.values.size:
            record = replace(record, time=other)
    aside = block.aside if block.aside is not column else None
    return [_with_clock(replace(record, aside=aside), found, block.said)]


def _with_clock(record: Series, found: Contents, said: tuple[str, ...] = ()) -> Series:
    """The record with its column's own rate where it has no times. Raises InputError where it has no clock at all."""
    if record.time is not None or record.rate is not None:
        why = record.why or said
        return replace(record, why=why)
    if record.value.rate is not None:
        note = f"The file gives the sampling rate: {record.value.rate:.9g} Hz."
        return replace(record, rate=record.value.rate, why=(*record.why, note))
    doubtful = doubtful_rate(found.facts)
    if doubtful is not None:
        written, rates = doubtful
        either = " or ".join(f"{rate:.9g}" for rate in rates)
        raise InputError(
            f"its head says {written[:80]!r}, which may be {either} Hz: give the rate",
            arguments=["rate"],
            likely=_likely_rate(found),
        )
    if len(found.columns) == 1:
        raise InputError(
            "no time given, and its one column holds the values: export the times, or give the rate in Hz",
            arguments=["rate"],
        )
    raise InputError(
        f"no time given: name the time column or give the rate in Hz; columns are {listed(found.columns)}",
        arguments=["time", "rate"],
    )


def _likely_rate(found: Contents) -> dict[str, str]:
    """The first reading of a rate in the head that has two; empty where there is none."""
    doubtful = doubtful_rate(found.facts)
    return {"rate": f"{doubtful[1][0]:.9g}"} if doubtful is not None else {}


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
        rate = None if block.time is not None else block.rate
        still = tuple(c.name for c in _rest(block) if c.name and not _changes(c))
        why = block.said if choice is None else (*block.said, str(choice))
        records += [
            Series(
                c, block.time, rate, block.run, why, still, choice, None if block.aside is c else block.aside
            )
            for c in some
        ]
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
    alike = len(kinds) == 1 and (all(unit for unit, _ in kinds) or numbered_alike(some))
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
            likely={"value": some[0].name or shown(found.columns, some[0]), **_likely_rate(found)},
        )


def _chosen(found: Contents, block: _Block) -> tuple[list[Column], Choice | None]:
    """The columns of one run that are a record each, and why."""
    rest = _rest(block)
    left = _candidates(block) or rest
    still = sum(bool(c.name or np.isfinite(c.values).any()) for c in rest) - len(left)
    if len(left) == 1 and (len(found.columns) <= 2 or (len(block.columns) <= 2 and not still)):
        return left, None
    seen = {id(c): swing(c.values) for c in left}
    moving = [c for c in left if seen[id(c)].swings] or left
    moving = [c for c in moving if seen[id(c)].lasts] or moving
    if found.channels and not all(unit_said(c)[0] for c in moving):
        return moving, _because(found, left, moving, still)
    moving = _lowest_derivative(across(moving, seen))
    if len(moving) <= _PAIRS:
        moving = _independent(moving, seen)
    plain = [c for c in moving if not _DERIVED.search(parted(c)[0])] or moving
    dying = [c for c in plain if seen[id(c)].dies] or plain
    if found.channels:
        return dying, _because(found, left, dying, still)
    dying = _major(dying, seen)
    steady = [c for c in dying if not seen[id(c)].grows_again]
    if 0 < len(steady) < len(dying) and not any(unit_said(c)[0] for c in dying):
        return steady, _because(found, left, steady, still, DIES_FOR_GOOD)
    return dying, _because(found, left, dying, still)


def _independent(columns: list[Column], seen: dict[int, Swing]) -> list[Column]:
    """Without what is another column in another unit, or its derivative where no name says what is which."""
    kept: list[Column] = []
    for column in columns:
        twin = next((b for b in kept if proportional(b.values, column.values)), None)
        if twin is None:
            kept.append(column)
        elif unit_said(twin) == unit_said(column) and seen[id(column)].size > seen[id(twin)].size:
            kept[kept.index(twin)] = (
                column  # of one unit, as the axes of a sensor are: the one that shows more
            )

    def derived(column: Column) -> bool:
        others = [b for b in kept if b is not column]
        return any(derivative(b.values, column.values, seen[id(b)].period) for b in others)

    return [c for c in kept if unit_said(c)[1] or not derived(c)] or kept


def _because(
    found: Contents, left: list[Column], kept: list[Column], still: int, why: str = DIES
) -> Choice | None:
    if len(kept) > 1:
        out = tuple(shown(found.columns, c) for c in left if c not in kept)
        return Choice(left_out=out) if out else None
    return Choice(shown(found.columns, kept[0]), why, len(left), still)


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
