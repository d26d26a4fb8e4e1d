"""Choose the columns of a file that form a record: the times, and a column of values that oscillates and decays."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from bayesdamp.records.files.contents import (
    Column,
    Contents,
    find_columns,
    list_names,
    names_index,
    names_time,
    sampling_rate,
    seconds_of_unit,
    select_runs,
    selector,
    split_run,
    unit_of_column,
)
from bayesdamp.records.oscillation.noise import LEAST_SHARE, coarse_period
from bayesdamp.types import DERIVATIVES, UNITS, InputError

MIN_SAMPLES = 10
"""Smallest number of samples of a record; shorter ones are refused (conventional)."""
MAX_STILL_LEVELS = 3
"""A column with at most this many different values does not count as changing: it is a switch or a sensor at rest."""
_ORDER = {"": 0, **DERIVATIVES}
"""Order of the time derivative of the displacement for each quantity; "" is an unknown quantity, which counts as a
displacement."""
_DERIVED = re.compile(r"\b(abs|absolute|magnitude|total|norm|resultant|rms|energ\w*)\b", re.IGNORECASE)
# The following limits are conventional.
_MAX_BACKWARD = 0.02
"""A column is not taken for times if more than this fraction of its steps decrease."""
_MUCH_LARGER = 10.0
"""Among columns without units, one is used alone as the record if its oscillation is at least this many times larger
than the second largest oscillation."""
_MAX_COMPARED = 40
"""Columns that are copies of other columns are recognised by correlation only if at most this many columns are to be
compared."""
_ABOUT_G, _ABOUT_TWICE = 0.25, 0.1
"""Relative tolerances with which an accelerometer's axis along gravity is recognised. Its mean differs from 9.81 m/s²
by less than the fraction `_ABOUT_G` (large amplitudes of a pendulum lower the mean). It oscillates at twice the
frequency of another axis: the ratio of the periods differs from 2 by less than the fraction `_ABOUT_TWICE`."""
_MIN_RELATIVE_SIZE = 1 / 3
"""Among several columns with the same unit and quantity, a column is not used as a record if its oscillation is smaller
than this fraction of the largest oscillation."""
MIN_CYCLES = 2.5
"""A column counts as oscillating only if it contains at least this many periods; with fewer it may be a drift."""
MAX_FINAL_SIZE = 0.8
"""A column decays if its oscillation at the end is smaller than this fraction of the largest (measured by standard
deviations within one period)."""
MAX_REGROWTH = 0.2
"""A column is not a free decay if its oscillation, after it has become smaller, grows again by more than this fraction
of the largest (measured by standard deviations within one period)."""
SMOOTHING_PERIODS = 3
"""Number of periods over which the size of an oscillation (its standard deviation within a period) is averaged before
its growth is measured."""
SAME_SIGNAL = 0.9999
"""Two columns whose correlation is larger than this, in absolute value, are the same signal, perhaps in two units."""
LARGEST_VALUE = 1e100
"""Largest absolute value of a record that is accepted, so that squares do not overflow; larger values are refused."""


@dataclass(frozen=True)
class OscillationMeasure:
    """Coarse measures of the oscillation in a column, by which the records among the columns of a file are recognised.

    Attributes
    ----------
    period
        Period in samples.
    size
        Standard deviation within the period in which it is largest, in the column's unit.
    oscillates
        Whether one frequency has at least the fraction `LEAST_SHARE` of the variance, over at least `MIN_CYCLES`
        periods, and the values both rise and fall again by more than their rounding, unlike a slow temperature.
    fills_periods
        Whether the oscillation fills at least `MIN_CYCLES` periods, which a single spike does not.
    decays
        Whether the oscillation at the end (median over the last fifth of the periods) is smaller than `MAX_FINAL_SIZE`
        times the largest.
    grows_again
        Whether the oscillation, after it has decayed, grows again by more than `MAX_REGROWTH` times the largest, as
        beats do.
    """

    period: float
    size: float
    oscillates: bool = False
    fills_periods: bool = False
    decays: bool = False
    grows_again: bool = False


def measure_oscillation(y: np.ndarray) -> OscillationMeasure:
    """Measure coarsely the oscillation in values: its period, its size, and whether it decays or grows again.

    Parameters
    ----------
    y
        Equally spaced values, (n,); NaN and infinite values are left out.

    Returns
    -------
    OscillationMeasure
        The measures. If the finite values are constant, fewer than ten, or too large to compute with, the period is
        inf, the size is 0, and the other fields are False.
    """
    y = np.asarray(y[np.isfinite(y)], float)
    scale = float(np.abs(y).max()) if y.size else 0.0
    if y.size < 10 or not 0 < scale < LARGEST_VALUE or np.ptp(y) == 0:
        return OscillationMeasure(np.inf, 0.0)
    y = y / scale - np.mean(y / scale)
    period, share = coarse_period(np.arange(y.size, dtype=float), y)
    # `sizes` are the standard deviations within successive periods.
    width = int(min(max(round(period), 4), y.size // 2))
    sizes = y[: y.size // width * width].reshape(-1, width).std(axis=1)
    size = float(sizes.max()) * scale
    last = float(np.median(sizes[-max(sizes.size // 5, 1) :])) * scale
    growth, steps = 0.0, np.abs(np.diff(y))
    turn = min(np.max(np.maximum.accumulate(y) - y), np.max(y - np.minimum.accumulate(y)))
    turns = bool(turn > 1.5 * steps[steps > 0].min())
    if sizes.size >= 2 * SMOOTHING_PERIODS and sizes.max() > 0:
        smooth = np.convolve(sizes, np.full(SMOOTHING_PERIODS, 1 / SMOOTHING_PERIODS), "valid")
        falling = smooth[int(np.argmax(smooth)) :]
        growth = float((falling - np.minimum.accumulate(falling)).max() / smooth.max())
    return OscillationMeasure(
        period,
        size,
        oscillates=share >= LEAST_SHARE and y.size / period >= MIN_CYCLES and turns,
        fills_periods=float(np.sum(sizes**2) ** 2 / np.sum(sizes**4)) >= MIN_CYCLES,
        decays=last < MAX_FINAL_SIZE * size,
        grows_again=growth > MAX_REGROWTH,
    )


@dataclass(frozen=True, eq=False)
class RecordColumns:
    """The columns of a file that form one record: the values, and the times or a sampling rate.

    Attributes
    ----------
    value
        Column of the recorded quantity.
    time
        Column of the times; None if there is a sampling rate instead.
    rate
        Sampling rate in Hz; None if there is a column of times.
    run
        Label of the run in the file; "" without runs.
    why
        Sentences that say how the columns were chosen.
    choice
        Sentence on the choice among several columns, which is also in `why`; "" if there was no choice.
    """

    value: Column
    time: Column | None = None
    rate: float | None = None
    run: str = ""
    why: tuple[str, ...] = ()
    choice: str = ""


MOSTLY, ROUNDED = 0.9, 1e-3
"""A column is the amplitude of a demodulated oscillation if it differs from √(x² + y²) of two other columns by less
than the fraction `ROUNDED` of its maximum, and if the fraction `MOSTLY` of each of its halves is above or below its
median, as in a decay (conventional)."""
FASTEST_PENDULUM = 5.0
"""Frequency in Hz above which an acceleration with gravity is not that along a pendulum: such an axis oscillates at
twice the pendulum's frequency, and the pendulum would be shorter than 4 cm."""


@dataclass(frozen=True, eq=False)
class _Block:
    """The columns of one run in one group (sheet, structure) of a file, with their times or sampling rate.

    run: label of the run; "" without runs. time: column of the times; None if there is none. rate: sampling rate in Hz;
    None if it is not known. why: sentences on the choice of times or rate.
    """

    run: str
    columns: tuple[Column, ...]
    time: Column | None = None
    rate: float | None = None
    why: tuple[str, ...] = ()

    @property
    def values(self) -> list[Column]:
        """Return the columns that may contain recorded values.

        Columns of times and of sample numbers are left out. If the block has a column of times, a column must have as
        many values as the times, or a sampling rate of its own.
        """
        size = self.time.values.size if self.time is not None else None
        return [
            c
            for c in self.columns
            if c is not self.time
            and (size is None or c.values.size == size or c.rate is not None)
            and not (names_time(c) and _time_score(c, False))
            and not (names_index(c) and _is_sample_numbers(c.values))
        ]

    @property
    def candidates(self) -> list[Column]:
        """Return the columns of `values` that change, and may therefore be a record.

        They have at least `MIN_SAMPLES` numbers, and more than `MAX_STILL_LEVELS` different ones.
        """
        return [c for c in self.values if _is_not_constant(c)]

    def record(self, value: Column, choice: str = "") -> RecordColumns:
        """Return the columns of the record with the values `value` and the times or sampling rate of this block.

        choice: sentence on the choice of this column, for the user; "" if there was no choice.
        """
        time = None if self.time is value else self.time
        why = (*self.why, choice) if choice else self.why
        rate = None if time is not None else self.rate
        return RecordColumns(value, time, rate, self.run, why, choice)


def choose_columns(
    content: Contents,
    *,
    time: str | int | None = None,
    values: Sequence[str | int] = (),
    rate: float | None = None,
    runs: str | None = None,
) -> list[RecordColumns]:
    """Return the columns of each record in a file, as the user gives them; otherwise choose them automatically.

    Parameters
    ----------
    content
        Contents of the file.
    time, values
        Columns of the times and of the values, by name or number from 1; by default chosen automatically.
    rate
        Sampling rate in Hz; replaces the times of the file.
    runs
        Which runs to use, such as `1,3-5`; all by default.

    Returns
    -------
    list of RecordColumns
        For given `values`, in their order, and for each of them in the order of the runs in the file; runs that are not
        selected are left out. Otherwise in the order of `runs` (by default that of the file), and in each run in the
        order of the columns.

    Raises
    ------
    InputError
        If a column or run does not exist, the selected column is not in the selected runs, the choice is not clear, or
        there are neither times nor a rate. Columns of accelerations that contain gravity are left out of an automatic
        choice; the error is also raised if no other column remains, or if they oscillate most.
    """
    columns = content.columns
    wanted = [column for value in values for column in find_columns(columns, value)]
    timed = find_columns(columns, time) if time is not None else []
    places = list(dict.fromkeys((split_run(c)[1], c.group) for c in columns))
    # If column names mark runs, a column without a mark, such as the times, belongs to all runs.
    places = [p for p in places if p[0] or not any(q[0] and q[1] == p[1] for q in places)]
    if runs is not None:
        labels = list(dict.fromkeys(run for run, _ in places if run))
        places = [place for run in select_runs(runs, labels) for place in places if place[0] == run]
    blocks = [_make_block(content, run, group, timed, rate) for run, group in places]
    if wanted:
        chosen = []
        for column in wanted:
            run, group = split_run(column)[1], column.group
            home = [b for b in blocks if any(c is column for c in b.columns)]
            home = home or [b for b in blocks if not run and any(c.group == group for c in b.columns)]
            if home:
                record = replace(home[0].record(column), run=run)
                chosen.append(_with_clock(record, content))
        if not chosen:
            raise InputError(
                "the selected column is not in the selected runs; select other runs or another column"
            )
        return chosen
    blocks = [block for block in blocks if block.candidates] or [block for block in blocks if block.values]
    timed_blocks = [
        b for b in blocks if b.time is not None or b.rate is not None or any(c.rate for c in b.columns)
    ]
    if others := [
        b.columns[0].group or b.columns[0].name for b in blocks if timed_blocks and b not in timed_blocks
    ]:
        note = f"Without times, and therefore left out: {', '.join(map(repr, others[:6]))}."
        blocks = [replace(b, why=(*b.why, note)) for b in timed_blocks]
    if not blocks:
        if len(columns) == 1:
            raise InputError("its only column contains the times; export the recorded quantity too")
        if len({c.values.size for c in columns}) > 1:
            sizes = ", ".join(f"{c.name!r}: {c.values.size}" for c in columns)
            raise InputError(
                f"columns of the file have different lengths ({sizes}); give as many values as times"
            )
        raise InputError(
            f"its columns contain only times or sample numbers (they are {list_names(columns)}); give a file with a "
            "recorded quantity"
        )
    for block in blocks:
        if amplitude := _lock_in_amplitude(block.candidates):
            raise InputError(
                f"{selector(columns, amplitude)!r} is √(x² + y²) of two other columns and falls, as the amplitude in a "
                "lock-in amplifier does: give it as an envelope, or give one of the others if they are motions",
                arguments=["value", "quantity"],
            )
    chosen = _choose_in_all(content, blocks)
    accelerations = [r for r in chosen if unit_of_column(r.value)[1] == "acceleration"]
    heavy = [r for r in accelerations if _contains_gravity(r.value) and not _is_fast(r)]
    # An axis without gravity is not the record if its oscillation is smaller: it may be the crosstalk of the other.
    largest = max(accelerations, key=lambda r: measure_oscillation(r.value.values).size, default=chosen[0])
    if largest not in heavy or len(heavy) == len(accelerations) < len(chosen):
        return [_with_clock(record, content) for record in chosen if record not in heavy]
    column = largest.value
    raise InputError(
        f"{selector(columns, column)!r} contains gravity (mean {np.nanmean(column.values):.4g}): on a pendulum such an "
        "axis oscillates at twice the frequency; give the axis along the swing, or this one if the body moves up and "
        "down",
        arguments=["value"],
    )


def _lock_in_amplitude(columns: Sequence[Column]) -> Column | None:
    """Return the column that is the falling amplitude √(x² + y²) of two others; None if there is none."""
    for r in columns:
        half, middle = r.values.size // 2, np.nanmedian(r.values)
        if np.nanmean(r.values[:half] > middle) < MOSTLY or np.nanmean(r.values[half:] < middle) < MOSTLY:
            continue
        # Some of the rows suffice. A copy of r is not one of its parts.
        rows = slice(None, None, max(r.values.size // 200, 1))
        others = [c.values[rows] for c in columns if c.values.size == r.values.size]
        parts = [x for x in others if not _is_rounded(x, r.values[rows])]
        if any(_is_rounded(np.hypot(x, y), r.values[rows]) for x, y in combinations(parts, 2)):
            return r
    return None


def _is_rounded(values: np.ndarray, other: np.ndarray) -> bool:
    """Return whether values are equal to others but for rounding (`ROUNDED`); False if some are not finite."""
    return bool(np.all(np.abs(values - other) < ROUNDED * np.max(np.abs(other))))


def _is_fast(record: RecordColumns) -> bool:
    """Return whether a record oscillates so fast that it is not the axis along a pendulum (`FASTEST_PENDULUM`).

    Times whose column states no unit are taken as seconds.
    """
    y, time, rate = record.value.values, record.time, record.rate or record.value.rate
    step = 1.0 / rate if rate else np.inf
    if time is not None:
        t = time.values[np.isfinite(y) & np.isfinite(time.values)]
        step = (seconds_of_unit(time) or 1.0) * float(np.mean(np.diff(t))) if t.size > 1 else np.inf
    return 0 < measure_oscillation(y).period * step < 1.0 / FASTEST_PENDULUM


def _make_block(content: Contents, run: str, group: str, timed: list[Column], rate: float | None) -> _Block:
    """Return the columns of one run in one group of a file, with their times or sampling rate if the file has these.

    timed: columns that the user gives as times. rate: sampling rate in Hz that the user gives; it replaces all times.
    If a column numbers the samples (`frame`) and some numbers are missing, the times are its numbers divided by this
    rate. If there are neither times nor a rate, a column that is named like times is used even if it does not increase.
    """
    columns = tuple(c for c in content.columns if c.group == group and split_run(c)[1] in (run, ""))
    own = tuple(c for c in columns if split_run(c)[1] == run) if run else columns
    if rate is not None:
        numbers = next((c for c in own if names_index(c) and _skips_numbers(c.values)), None)
        if numbers is None:
            return _Block(run, own, None, rate)
        why = f"Samples are missing by the numbers in column {numbers.name!r}; times are these numbers / {rate:g} Hz."
        others = tuple(c for c in own if c is not numbers)
        return _Block(run, others, replace(numbers, values=numbers.values / rate), None, (why,))
    if timed:
        return _Block(run, own, next((c for c in timed if split_run(c)[1] == run), timed[0]))
    size = max((c.values.size for c in own), default=0)
    outside = [
        c for c in content.columns if c.group == "" and group and names_time(c) and c.values.size == size
    ]
    time = _time_column(own) or _time_column(columns) or _time_column(outside)
    facts = {  # facts (named numbers, texts) of the group that contains the columns
        name: value
        for name, value in content.facts.items()
        if any(c.name.startswith(f"{name.rpartition('.')[0]}.") for c in own)
    }
    stated = sampling_rate(facts) or sampling_rate(content.facts)
    if stated and time and seconds_of_unit(time) is None and _is_sample_numbers(time.values):
        own, time = tuple(c for c in own if c is not time), None  # this column only numbers the samples
    if time is not None:
        named = time.name and len(content.columns) > 2
        return _Block(run, own, time, None, (f"Times are those of column {time.name!r}.",) if named else ())
    if stated is not None:
        why = f"The sampling rate is that in the file, {stated[1]!r}: {stated[0]:g} Hz."
        return _Block(run, own, None, stated[0], (why,))
    if any(c.rate is not None for c in own):
        return _Block(run, own)
    # Neither times nor a rate: use a column that is named like times. If it does not increase, the cleaning reports
    # this.
    return _Block(run, own, next((c for c in own if names_time(c) and not names_index(c)), None))


def separate_clocks(content: Contents) -> Contents:
    """Put each column of times into one group with its columns of values, if a table has several columns of times.

    Such a table has the columns `Time A, A, Time B, B`, or `A, Time A, B, Time B`. It is changed only if the times
    differ, or if the same names are repeated (`Time, A, Time, A`); to repeated names, the name of the new group is
    added. A table whose column names mark runs is not changed.

    Parameters
    ----------
    content
        Contents of a file.

    Returns
    -------
    Contents
        The contents with the columns in new groups, and `paired` true; unchanged if there are no such columns of times.
    """
    columns = list(content.columns)
    for group in dict.fromkeys(c.group for c in columns):
        at = [i for i, c in enumerate(columns) if c.group == group and np.isfinite(c.values).any()]
        if any(split_run(columns[i])[1] for i in at):
            continue
        many = Counter(columns[i].name for i in at)
        clocks = [_time_score(c, not c.name or many[c.name] > 1) > 0 for c in (columns[i] for i in at)]
        if clocks and clocks[-1]:
            at, clocks = at[::-1], clocks[::-1]
        starts = [k for k, clock in enumerate(clocks) if clock]
        if len(starts) < 2 or starts[0] != 0:
            continue
        spans = list(zip(starts, [*starts[1:], len(at)], strict=True))
        times = [columns[at[k]].values for k in starts]
        same = all(np.array_equal(times[0], t, equal_nan=True) for t in times)
        repeated = all(columns[i].name and many[columns[i].name] == len(starts) for i in at)
        if (same and not repeated) or any(stop - start == 1 for start, stop in spans):
            continue
        for number, (start, stop) in enumerate(spans, start=1):
            pair = f"{group} pair {number}".strip()
            for i in at[start:stop]:
                name = columns[i].name.removeprefix(f"{group}.")
                name = f"{pair}.{name}" if repeated else name
                columns[i] = replace(columns[i], name=name, group=pair)
        content = replace(content, paired=True)
    return replace(content, columns=tuple(columns))


def _time_column(columns: Sequence[Column]) -> Column | None:
    """Return the column that most probably contains the times, the first if several are equally probable.

    Return None if no column can contain times.
    """
    scores = [_time_score(column, i == 0) for i, column in enumerate(columns)]
    best = max(scores, default=0)
    return columns[scores.index(best)] if best > 0 else None


def _time_score(column: Column, first: bool) -> int:
    """Return how probably a column contains times, as a number from 0 (it cannot) to 6.

    first: whether it may contain the times even if its name does not say so, like the first column of a table.
    """
    y = column.values[np.isfinite(column.values)]
    if y.size < 2 or column.rate is not None or names_index(column):
        return 0
    steps = np.diff(y)
    back = float(np.mean(steps < 0))
    if back > _MAX_BACKWARD or not np.any(steps > 0):
        return 0
    if back:
        return int(names_time(column))  # a clock that was set back, which the cleaning repairs or refuses
    if names_time(column):
        return 4 + 2 * (seconds_of_unit(column) is not None) - column.clock
    return 2 if first and np.all(steps > 0) else 0


def _is_not_constant(column: Column) -> bool:
    y = column.values[np.isfinite(column.values)]
    return y.size >= MIN_SAMPLES and np.unique(y[:: max(1, y.size // 20000)]).size > MAX_STILL_LEVELS


def _is_sample_numbers(y: np.ndarray) -> bool:
    y = y[np.isfinite(y)]
    return bool(y.size > 1 and np.all(np.diff(y) == 1))


def _skips_numbers(y: np.ndarray) -> bool:
    """Return whether values y, (n,), are rising whole numbers, most of which follow on one another, but not all."""
    steps = np.diff(y)
    return bool(y.size > 1 and np.all(steps % 1 == 0) and steps.min() == 1 == np.median(steps) < steps.max())


def _with_clock(record: RecordColumns, content: Contents) -> RecordColumns:
    """Return the record unchanged if it has times or a sampling rate; otherwise add the rate that its column states.

    Raises InputError if the column states no rate. content: contents of the file, whose columns the message lists.
    """
    if record.time is not None or record.rate is not None:
        return record
    if record.value.rate is not None:
        note = f"The file gives the sampling rate: {record.value.rate:.9g} Hz."
        return replace(record, rate=record.value.rate, why=(*record.why, note))
    if len(content.columns) == 1:
        what = "has one column of values and no times: export the times too, or give the rate in Hz"
        raise InputError(what, arguments=["rate"])
    what = "has no column whose name means a time, and the values of the first do not always increase"
    what = f"{what}: name the time column or give the rate in Hz"
    raise InputError(f"{what}; columns are {list_names(content.columns)}", arguments=["time", "rate"])


def _choose_in_all(content: Contents, blocks: list[_Block]) -> list[RecordColumns]:
    """Choose the columns of values in each block (the columns of one run in one group), and return one record for each.

    The records of all blocks are in one list, in the order of the blocks. If there are several runs, the columns that
    are chosen in most of them are used in each run that has them. Raises InputError if several columns of a run are
    chosen, and neither their unit nor the file shows that each is a record of its own.
    """
    picks = [_choose_in_block(content, block) for block in blocks]
    usual = Counter(tuple(split_run(c)[0] for c in chosen) for chosen, _ in picks).most_common(1)[0][0]
    several = len({block.run for block in blocks}) > 1
    records: list[RecordColumns] = []
    for block, (chosen, choice) in zip(blocks, picks, strict=True):
        if several:
            chosen = [c for base in usual for c in block.columns if split_run(c)[0] == base] or chosen
        records += [block.record(c, choice) for c in chosen]
    for run in dict.fromkeys(record.run for record in records):
        columns = [record.value for record in records if record.run == run]
        kinds = {unit_of_column(c) for c in columns}
        have_one_unit = len(kinds) == 1 and all(unit for unit, _ in kinds)
        bare, sheets = {c.name.removeprefix(f"{c.group}.") for c in columns}, {c.group for c in columns}
        are_of_sheets = len(bare) == 1 and len(sheets) == len(columns)  # the same column of several sheets
        if have_one_unit or are_of_sheets or len(columns) == 1 or content.channels or content.paired:
            continue
        names = ", ".join(repr(selector(content.columns, c)) for c in columns[:3])
        more = f" and {len(columns) - 3} more" if len(columns) > 3 else ""
        raise InputError(
            f"has {len(content.columns)} columns, and {names}{more} may each be the record; give the name or number of "
            f"one, or of several channels; columns are {list_names(content.columns)}",
            arguments=["value", "channels"],
        )
    return records


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A column that may be a record, its oscillation, and the unit and quantity that the file states ("" if none)."""

    column: Column
    oscillation: OscillationMeasure
    unit: str
    quantity: str

    @property
    def base(self) -> str:
        """Return the base unit (rad, m, ...); for an unknown unit, the unit itself."""
        return UNITS[self.unit].base if self.unit in UNITS else self.unit


def _choose_in_block(content: Contents, block: _Block) -> tuple[list[Column], str]:
    """Choose the columns of a block that are records; return also a sentence on the choice.

    A block contains the columns of one run in one group (sheet, structure) of the file. These columns are left out, as
    long as others remain: columns that do not oscillate or decay, accelerations along gravity, derived quantities (a
    velocity if there is a displacement), copies, and oscillations that are much smaller than others. If the file
    declares its columns as channels of sensors, small oscillations are not left out. If the units of these channels are
    also not all stated, all columns that oscillate are records. The sentence is "" if no column is left out.
    """
    values = block.candidates or block.values
    if len(values) == 1:
        return values, ""
    every = [_Candidate(c, measure_oscillation(c.values), *unit_of_column(c)) for c in values]
    left = [c for c in every if c.oscillation.oscillates] or every
    left = [c for c in left if c.oscillation.fills_periods] or left
    if not content.channels or all(c.unit for c in left):
        # Leave out an accelerometer axis along the gravity that oscillates at twice the frequency of another axis,
        # because the tension of a pendulum's string is largest twice per cycle.
        level = [c for c in left if not _contains_gravity(c.column)]
        left = [
            c
            for c in left
            if c in level
            or not any(
                (other.unit, other.quantity) == (c.unit, c.quantity)
                and abs(other.oscillation.period / c.oscillation.period / 2 - 1) < _ABOUT_TWICE
                for other in level
            )
        ]
        # Leave out time derivatives of other columns, such as a velocity if there is a displacement.
        bases = {c.base for c in left}
        lowest = {base: min(_ORDER[c.quantity] for c in left if c.base == base) for base in bases}
        left = [c for c in left if _ORDER[c.quantity] == lowest[c.base]]
        left = [c for c in left if not _DERIVED.search(split_run(c.column)[0])] or left
        if len(left) <= _MAX_COMPARED:
            left = _independent(left)
        left = [c for c in left if c.oscillation.decays] or left
    if not content.channels:
        sizes = [c.oscillation.size for c in left]
        if not any(c.unit for c in left):
            far = [c for c in left if c.oscillation.size >= _MUCH_LARGER * sorted(sizes)[-2:][0]]
            left = far if len(far) == 1 else left
            left = [c for c in left if not c.oscillation.grows_again] or left
        elif len({(c.unit, c.quantity) for c in left}) == 1:  # sensors of one unit
            left = [c for c in left if c.oscillation.size >= _MIN_RELATIVE_SIZE * max(sizes)]
    chosen = [c.column for c in left]
    if len(chosen) > 1:
        out = ", ".join([repr(selector(content.columns, c)) for c in values if c not in chosen][:6])
        return chosen, f"Left out, because smaller, derived or not decaying: {out}." if out else ""
    why = f"of the {len(values)} columns that change, it oscillates and decays most clearly."
    return chosen, f"Using column {selector(content.columns, chosen[0])!r}: {why}"


def _independent(candidates: list[_Candidate]) -> list[_Candidate]:
    """Return the candidates without copies: those equal to another candidate up to a factor and an offset.

    Their correlation with it is nearly 1 or −1 (`SAME_SIGNAL`). Of two candidates with the same unit and quantity, that
    with the larger oscillation is kept, otherwise the first.
    """

    def are_copies(a: np.ndarray, b: np.ndarray) -> bool:
        if a.size != b.size or np.sum(both := np.isfinite(a) & np.isfinite(b)) < MIN_SAMPLES:
            return False
        with np.errstate(all="ignore"):  # constant columns, and overflow
            return bool(abs(np.corrcoef(a[both], b[both])[0, 1]) > SAME_SIGNAL)

    independent: list[_Candidate] = []
    for candidate in candidates:
        values = candidate.column.values
        twin = next((other for other in independent if are_copies(other.column.values, values)), None)
        if twin is None:
            independent.append(candidate)
        elif (twin.unit, twin.quantity) == (candidate.unit, candidate.quantity):
            # If both have the same unit, as two axes of a sensor, keep the one with the larger oscillation.
            larger = candidate if candidate.oscillation.size > twin.oscillation.size else twin
            independent[independent.index(twin)] = larger
    return independent


def _contains_gravity(column: Column) -> bool:
    """Return whether a column is perhaps an acceleration that contains gravity, because its mean is near 9.81 m/s².

    "Near" means within the fraction `_ABOUT_G`, with either sign. The column may be an acceleration if the file says
    so, or if the file states neither unit nor quantity. Without a unit, m/s² is assumed.
    """
    gravity, (unit, quantity) = UNITS["g"].factor, unit_of_column(column)
    y = column.values[np.isfinite(column.values)]
    if not y.size or np.abs(y).max() > LARGEST_VALUE:
        return False
    factor = 1.0 if not unit else UNITS[unit].factor if unit in UNITS and UNITS[unit].base == "m" else 0.0
    may_be = quantity == "acceleration" or not (unit or quantity)
    return may_be and abs(abs(float(y.mean())) * factor / gravity - 1) < _ABOUT_G
