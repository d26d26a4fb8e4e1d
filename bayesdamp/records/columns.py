"""Which columns of a file are a record: the times, and the displacement or derivative that swings and dies down."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.names import (
    find_columns,
    list_names,
    names_index,
    names_time,
    quote_name,
    sampling_rate,
    seconds_of_unit,
    select_runs,
    split_run,
    unit_of_column,
)
from bayesdamp.records.oscillation.spectrum import coarse_period
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

LEAST = 10
"""Samples that a record must have."""
LEVELS = 3
"""A column with no more values than these is a switch or a sensor at rest."""
_ORDER = {"angle": 0, "": 0, "velocity": 1, "acceleration": 2}
_DERIVED = re.compile(r"\b(abs|absolute|magnitude|total|norm|resultant|rms|energ\w*)\b", re.IGNORECASE)
DIFFER = 0.01
"""Relative difference of a given rate from what the file, or its own times, state from which on it is reported."""
_BACK = 0.02
"""Share of steps back in time that a column named after times may have."""
_FAR = 10.0
"""Of columns without units, one that swings so many times as much as the next is the record."""
_PAIRS = 40
"""Columns that are compared with each other; among more than these no choice is clear."""
_ABOUT_G, _ABOUT_TWICE = 0.25, 0.1
"""Share by which a mean acceleration may differ from gravity (a wide swing lowers it), and share by which one period,
known coarsely, may differ from twice another."""
_MINOR = 1 / 3
"""Of equal sensors, one that swings less than this share of the largest adds little information."""
SHARE = 0.3
"""As in `free_decay`: the share of an oscillation in a record."""
CYCLES = 2.5
"""Periods below which a column drifts rather than swings."""
FALL = 0.8
"""The swing at the end of a record that dies down is below this share of its largest."""
AGAIN = 0.2
"""Share of its largest swing by which a free decay does not grow once it has begun to fall (conventional)."""
SMOOTHED = 3
"""Periods over which a swing is averaged before its growth is measured."""
ALIKE = 0.9999
"""Correlation of two columns that are one signal in two units."""
LARGEST = 1e100
"""Largest value that can be computed with: its square must not overflow."""


@dataclass(frozen=True)
class Swing:
    """A coarse measure of an oscillation: enough to tell a record from other columns of a file.

    Attributes
    ----------
    period
        In samples.
    size
        The largest swing, its standard deviation in the column's unit.
    swings
        Whether one frequency has most of its power, over enough cycles.
    lasts
        Whether it swings for more than the two periods that one spike can touch.
    dies
        Whether its last amplitude is well below its first.
    grows_again
        Whether it swells once more after it has died down, as beats and the residuals of a fit do.
    """

    period: float
    size: float
    swings: bool = False
    lasts: bool = False
    dies: bool = False
    grows_again: bool = False


def measure_swing(y: np.ndarray) -> Swing:
    """Measure how values swing.

    Parameters
    ----------
    y
        Equally spaced values, (n,); NaN is left out.

    Returns
    -------
    Swing
        With an infinite period and no size, where the values are constant, too few or too large to compute with.
    """
    y = np.asarray(y[np.isfinite(y)], float)
    scale = float(np.abs(y).max()) if y.size else 0.0
    if y.size < 10 or not 0 < scale < LARGEST or np.ptp(y) == 0:
        return Swing(np.inf, 0.0)
    y = y / scale - np.mean(y / scale)
    period, share = coarse_period(np.arange(y.size, dtype=float), y)
    width = int(min(max(round(period), 4), y.size // 2))
    sizes = y[: y.size // width * width].reshape(-1, width).std(axis=1)
    size = float(sizes.max()) * scale
    last = float(np.median(sizes[-max(sizes.size // 5, 1) :])) * scale
    growth = 0.0
    if sizes.size >= 2 * SMOOTHED and sizes.max() > 0:
        smooth = np.convolve(sizes, np.full(SMOOTHED, 1 / SMOOTHED), "valid")
        falling = smooth[int(np.argmax(smooth)) :]
        growth = float((falling - np.minimum.accumulate(falling)).max() / smooth.max())
    periods_filled = float(np.sum(sizes**2) ** 2 / np.sum(sizes**4))
    return Swing(
        period,
        size,
        swings=share >= SHARE and y.size / period >= CYCLES,
        lasts=periods_filled >= CYCLES,
        dies=last < FALL * size,
        grows_again=growth > AGAIN,
    )


@dataclass(frozen=True, eq=False)
class RecordColumns:
    """The columns of one record.

    Attributes
    ----------
    value
        The column of the recorded quantity.
    time
        The column of the times; None where there is a rate instead.
    rate
        In Hz, where there is no column of times.
    run
        The file's own label of the run; empty where there is none.
    why
        Sentences on how the columns were chosen.
    still
        Names of other columns that do not change.
    choice
        The sentence on the choice among several columns; empty where there was one.
    """

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
    time: Column | None = None
    rate: float | None = None
    why: tuple[str, ...] = ()

    @property
    def values(self) -> list[Column]:
        """The columns that hold neither times nor numbers of samples."""
        size = self.time.values.size if self.time is not None else None
        return [
            c
            for c in self.columns
            if c is not self.time
            and (size is None or c.values.size == size or c.rate is not None)
            and not (names_time(c) and _time_score(c, False))
            and not (names_index(c) and _counts(c.values))
        ]

    @property
    def candidates(self) -> list[Column]:
        """The columns that may be a record's values: numbers that change."""
        return [c for c in self.values if _changes(c)]

    def record(self, value: Column, choice: str = "", still: tuple[str, ...] = ()) -> RecordColumns:
        """Return the record of one of the columns."""
        time = None if self.time is value else self.time
        why = (*self.why, choice) if choice else self.why
        return RecordColumns(
            value, time, None if time is not None else self.rate, self.run, why, still, choice
        )


def choose_columns(
    content: Contents,
    *,
    time: str | int | None = None,
    values: Sequence[str | int] = (),
    rate: float | None = None,
    runs: str | None = None,
) -> list[RecordColumns]:
    """Return the columns of the records in a file, as given or as chosen.

    Parameters
    ----------
    content
        What the file contains.
    time, values
        Columns by name or number from 1.
    rate
        Sampling rate in Hz, in place of the file's times.
    runs
        Such as `1,3-5`; all by default.

    Raises
    ------
    InputError
        One line that lists what there is, where a column does not exist or no choice is clear.
    """
    columns = content.columns
    wanted = [column for value in values for column in find_columns(columns, value)]
    timed = find_columns(columns, time) if time is not None else []
    places = list(dict.fromkeys((split_run(c)[1], c.group) for c in columns))
    # Where names mark runs, a column without a mark, such as the only one of times, belongs to all of them.
    places = [p for p in places if p[0] or not any(q[0] and q[1] == p[1] for q in places)]
    if runs is not None:
        labels = list(dict.fromkeys(run for run, _ in places if run))
        places = [place for run in select_runs(runs, labels) for place in places if place[0] == run]
    blocks = [_block(content, run, group, timed, rate) for run, group in places]
    if wanted:
        chosen = []
        for column in wanted:
            run, group = split_run(column)[1], column.group
            home = [b for b in blocks if any(c is column for c in b.columns)]
            home = home or [b for b in blocks if not run and any(c.group == group for c in b.columns)]
            if not home:
                continue
            record = replace(home[0].record(column), run=run)
            if record.time is None and record.rate is None and column.rate is None and len(columns) == 2:
                other = next(c for c in columns if c is not column)
                if other.values.size == column.values.size:
                    record = replace(record, time=other)
            chosen.append(_with_clock(record, content))
        if not chosen:
            raise InputError(
                "the column asked for belongs to none of the runs asked for; leave out one of the two"
            )
        return chosen
    blocks = [block for block in blocks if block.candidates] or [block for block in blocks if block.values]
    if not blocks:
        if len(columns) == 1:
            raise InputError("has one column, and it holds the times; export the recorded quantity too")
        raise InputError(f"only the times hold numbers that change; columns are {list_names(columns)}")
    chosen = _choose_in_all(content, blocks)
    left = [
        r for r in chosen if unit_of_column(r.value)[1] != "acceleration" or not _contains_gravity(r.value)
    ]
    if left:
        return [_with_clock(record, content) for record in left]
    column = chosen[0].value
    kind = unit_of_column(column)
    axes = [c for c in columns if c is not column and kind[0] and unit_of_column(c) == kind and _changes(c)]
    named = f" ({', '.join(quote_name(columns, c) for c in axes[:3])})" if axes else ""
    likely = next((c.name for c in axes if c.name and measure_swing(c.values).swings), "")
    raise InputError(
        f"{quote_name(columns, column)} contains gravity (mean {np.nanmean(column.values):.4g}): on a pendulum it "
        f"swings at twice the frequency; give the axis along the swing{named}, or this one if it moves up and down",
        arguments=["value"],
        likely={"value": likely} if likely else {},
    )


def _block(content: Contents, run: str, group: str, timed: list[Column], rate: float | None) -> _Block:
    """Return the columns of a run and group, with their times or their rate where the file has them.

    Raises InputError where a column that is named like times has another length than the values.
    """
    columns = tuple(c for c in content.columns if c.group == group and split_run(c)[1] in (run, ""))
    own = tuple(c for c in columns if split_run(c)[1] == run) if run else columns
    if rate is not None:
        time, why = _time_column(own) or _time_column(columns), ()
        if time is not None:
            step = float(np.median(np.diff(time.values[np.isfinite(time.values)])))
            seconds = seconds_of_unit(time)
            counts_samples = seconds is None and step == 1.0
            stated = 1 / (step * (seconds or 1.0)) if step > 0 and not counts_samples else rate
            if not abs(rate / stated - 1) < DIFFER:
                read_at = f"the record is read at {rate:.6g} Hz, as asked"
                why = (f"Times in column {time.name!r} are at {stated:.6g} Hz; {read_at}.",)
        return _Block(run, own, None, rate, why)
    if timed:
        mine = [c for c in timed if split_run(c)[1] == run] or timed
        return _Block(run, own, mine[0])
    size = max((c.values.size for c in own), default=0)
    outside = [
        c for c in content.columns if c.group == "" and group and names_time(c) and c.values.size == size
    ]
    time = _time_column(own) or _time_column(columns) or _time_column(outside)
    facts = {  # of the group that the columns belong to
        name: value
        for name, value in content.facts.items()
        if any(c.name.startswith(f"{name.rpartition('.')[0]}.") for c in own)
    }
    stated = sampling_rate(facts) or sampling_rate(content.facts)
    if stated is not None and time is not None and seconds_of_unit(time) is None and _counts(time.values):
        own, time = tuple(c for c in own if c is not time), None  # they number the samples
    if time is not None:
        named = time.name and len(content.columns) > 2
        return _Block(run, own, time, None, (f"Times are those of column {time.name!r}.",) if named else ())
    if stated is not None:
        return _Block(run, own, None, stated[0], (f"The file says {stated[1]!r}: {stated[0]:g} Hz.",))
    if any(c.rate is not None for c in own):
        return _Block(run, own)
    # Without any clock: the column that is named like times, even if it does not increase, which cleaning reports.
    time = next((c for c in own if names_time(c) and not names_index(c)), None)
    if time is not None and len(own) == 2 and own[0].values.size != own[1].values.size:
        other = own[1] if time is own[0] else own[0]
        raise InputError(
            f"has {time.values.size} times in {time.name!r} and {other.values.size} values in "
            f"{other.name!r}; a record has as many of both: export it again, or give the rate in Hz",
            arguments=["rate"],
        )
    return _Block(run, own, time)


def separate_clocks(content: Contents) -> Contents:
    """Put each column of times into a group with the values behind it, where a table has several that differ.

    Such a table is `Time A, A, Time B, B`; the times may also follow their values, if they do so throughout. A table
    whose runs are marked is not changed.

    Parameters
    ----------
    content
        What a file contains.

    Returns
    -------
    Contents
        The same columns in new groups, marked as `paired`; the contents themselves where nothing changes.
    """
    columns = list(content.columns)
    for group in dict.fromkeys(c.group for c in columns):
        at = [i for i, c in enumerate(columns) if c.group == group and np.isfinite(c.values).any()]
        if any(split_run(columns[i])[1] for i in at):
            continue
        clocks = [_time_score(columns[i], not columns[i].name) > 0 for i in at]
        if clocks and clocks[-1]:
            at, clocks = at[::-1], clocks[::-1]
        starts = [k for k, clock in enumerate(clocks) if clock]
        if len(starts) < 2 or starts[0] != 0:
            continue
        spans = list(zip(starts, [*starts[1:], len(at)], strict=True))
        times = [columns[at[k]].values for k in starts]
        same = all(np.array_equal(times[0], t, equal_nan=True) for t in times)
        if same or any(stop - start == 1 for start, stop in spans):
            continue
        for number, (start, stop) in enumerate(spans, start=1):
            for i in at[start:stop]:
                columns[i] = replace(columns[i], group=f"{group} pair {number}".strip())
        content = replace(content, paired=True)
    return replace(content, columns=tuple(columns))


def _time_column(columns: Sequence[Column]) -> Column | None:
    """Return the first column that looks most like times, None where none does."""
    scores = [_time_score(column, i == 0) for i, column in enumerate(columns)]
    best = max(scores, default=0)
    return columns[scores.index(best)] if best > 0 else None


def _time_score(column: Column, first: bool) -> int:
    """Return how much a column looks like times; 0 for not at all."""
    y = column.values[np.isfinite(column.values)]
    if y.size < 2 or column.rate is not None or names_index(column):
        return 0
    steps = np.diff(y)
    back = float(np.mean(steps < 0))
    if back > _BACK or not np.any(steps > 0):
        return 0
    if back:
        return int(names_time(column))  # a clock that was set back: cleaning deals with it
    if names_time(column):
        unit = seconds_of_unit(column) is not None
        return 4 + 2 * unit - column.clock
    return 2 if first and np.all(steps > 0) else 0


def _changes(column: Column) -> bool:
    y = column.values[np.isfinite(column.values)]
    return y.size >= LEAST and np.unique(y[:: max(1, y.size // 20000)]).size > LEVELS


def _counts(y: np.ndarray) -> bool:
    y = y[np.isfinite(y)]
    return bool(y.size > 1 and np.all(np.diff(y) == 1))


def _with_clock(record: RecordColumns, content: Contents) -> RecordColumns:
    """Return the record, with its column's own rate where it has no times. Raises InputError where it has neither."""
    if record.time is not None or record.rate is not None:
        return record
    if record.value.rate is not None:
        note = f"The file gives the sampling rate: {record.value.rate:.9g} Hz."
        return replace(record, rate=record.value.rate, why=(*record.why, note))
    if len(content.columns) == 1:
        what = "no time given, and its one column holds the values: export the times, or give the rate in Hz"
        raise InputError(what, arguments=["rate"])
    what = "no time given: name the time column or give the rate in Hz"
    raise InputError(f"{what}; columns are {list_names(content.columns)}", arguments=["time", "rate"])


def _choose_in_all(content: Contents, blocks: list[_Block]) -> list[RecordColumns]:
    """Return the choice in each block; of several runs, the column that most of them would choose.

    Raises InputError for a choice of several columns that are not channels of one kind.
    """
    picks = [_choose_in_block(content, block) for block in blocks]
    usual = Counter(tuple(split_run(c)[0] for c in chosen) for chosen, _ in picks).most_common(1)[0][0]
    several = len({block.run for block in blocks}) > 1
    records: list[RecordColumns] = []
    for block, (chosen, choice) in zip(blocks, picks, strict=True):
        if several:
            chosen = [c for base in usual for c in block.columns if split_run(c)[0] == base] or chosen
        still = tuple(c.name for c in block.values if c.name and not _changes(c))
        records += [block.record(c, choice, still) for c in chosen]
    for run in dict.fromkeys(record.run for record in records):
        of_run = [record for record in records if record.run == run]
        columns = [record.value for record in of_run]
        kinds = {unit_of_column(c) for c in columns}
        have_one_unit = len(kinds) == 1 and all(unit for unit, _ in kinds)
        bare, sheets = {c.name.removeprefix(f"{c.group}.") for c in columns}, {c.group for c in columns}
        are_of_sheets = len(bare) == 1 and len(sheets) == len(columns)  # the same column of several sheets
        if have_one_unit or are_of_sheets or len(columns) == 1 or content.channels or content.paired:
            continue
        names = ", ".join(quote_name(content.columns, c) for c in columns[:3])
        more = f" and {len(columns) - 3} more" if len(columns) > 3 else ""
        clockless = any(r.time is None and r.rate is None and r.value.rate is None for r in of_run)
        no_times = " and no times" if clockless else ""
        also = ", and the name of the times or the rate in Hz" if clockless else ""
        raise InputError(
            f"has {len(content.columns)} columns{no_times}, and {names}{more} may each be the record; give the name or "
            f"number of one, or of several channels{also}; columns are {list_names(content.columns)}",
            arguments=["value", "channels", *(["time", "rate"] if clockless else [])],
            likely={"value": columns[0].name or quote_name(content.columns, columns[0])},
        )
    return records


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A column that may be a record: how it swings, and the unit and quantity that the file states."""

    column: Column
    swing: Swing
    unit: str
    quantity: str

    @property
    def base(self) -> str:
        """The base unit; the unit itself where it is not known."""
        return UNITS[self.unit].base if self.unit in UNITS else self.unit


def _choose_in_block(content: Contents, block: _Block) -> tuple[list[Column], str]:
    """Return the columns of one run that are a record each, and why."""
    values = block.candidates or block.values
    if len(values) == 1:
        return values, ""
    every = [_Candidate(c, measure_swing(c.values), *unit_of_column(c)) for c in values]
    left = [c for c in every if c.swing.swings] or every
    left = [c for c in left if c.swing.lasts] or left
    if not content.channels or all(c.unit for c in left):
        # The pull of a pendulum's string is largest twice in a cycle: leave out an axis with gravity that swings at
        # twice the frequency of another.
        level = [c for c in left if not _contains_gravity(c.column)]
        left = [
            c
            for c in left
            if c in level
            or not any(
                (other.unit, other.quantity) == (c.unit, c.quantity)
                and abs(other.swing.period / c.swing.period / 2 - 1) < _ABOUT_TWICE
                for other in level
            )
        ]
        # Leave out derivatives of other columns: a velocity where there is a displacement of the same kind.
        lowest = {
            base: min(_ORDER[c.quantity] for c in left if c.base == base) for base in {c.base for c in left}
        }
        left = [c for c in left if _ORDER[c.quantity] == lowest[c.base]]
        if len(left) <= _PAIRS:
            left = _independent(left)
        left = [c for c in left if not _DERIVED.search(split_run(c.column)[0])] or left
        left = [c for c in left if c.swing.dies] or left
    if not content.channels:
        sizes = [c.swing.size for c in left]
        if not any(c.unit for c in left):
            far = [c for c in left if c.swing.size >= _FAR * sorted(sizes)[-2:][0]]
            left = far if len(far) == 1 else left
            left = [c for c in left if not c.swing.grows_again] or left
        elif len({(c.unit, c.quantity) for c in left}) == 1:  # sensors of one unit
            left = [c for c in left if c.swing.size >= _MINOR * max(sizes)]
    chosen = [c.column for c in left]
    if len(chosen) > 1:
        out = ", ".join([quote_name(content.columns, c) for c in values if c not in chosen][:6])
        return chosen, f"Columns that do not oscillate and decay are left out: {out}." if out else ""
    used = f"Using column {quote_name(content.columns, chosen[0])}"
    return (
        chosen,
        f"{used}: of the {len(values)} columns that change, it is the one that oscillates and decays.",
    )


def _independent(candidates: list[_Candidate]) -> list[_Candidate]:
    """Leave out what is another column in another unit or with another zero."""
    independent: list[_Candidate] = []
    for candidate in candidates:
        b = candidate.column.values
        twin = None
        for other in independent:
            a = other.column.values
            if a.size == b.size and np.sum(both := np.isfinite(a) & np.isfinite(b)) >= LEAST:
                with np.errstate(all="ignore"):  # of a constant column, and of one that overflows
                    if abs(np.corrcoef(a[both], b[both])[0, 1]) > ALIKE:
                        twin = other
                        break
        if twin is None:
            independent.append(candidate)
        elif (twin.unit, twin.quantity) == (candidate.unit, candidate.quantity):
            # Of one unit, as the axes of a sensor are: the one that shows more.
            larger = candidate if candidate.swing.size > twin.swing.size else twin
            independent[independent.index(twin)] = larger
    return independent


def _contains_gravity(column: Column) -> bool:
    """Return whether a column's mean is that of gravity, and nothing states that it is not an acceleration."""
    gravity, (unit, quantity) = UNITS["g"].factor, unit_of_column(column)
    y = column.values[np.isfinite(column.values)]
    if not y.size or np.abs(y).max() > LARGEST:
        return False
    factor = 1.0 if not unit else UNITS[unit].factor if unit in UNITS and UNITS[unit].base == "m" else 0.0
    may_be = quantity == "acceleration" or not (unit or quantity)
    return may_be and abs(abs(float(y.mean())) * factor / gravity - 1) < _ABOUT_G
