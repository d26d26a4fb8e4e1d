"""Define the record as read from a file, choose its unit, and find doubts about it and the option that settles each."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import numpy as np

from bayesdamp.records.columns import OscillationMeasure, measure_oscillation
from bayesdamp.records.files.contents import SECONDS, sampling_rate, seconds_in
from bayesdamp.records.oscillation.noise import SHORTEST_PERIOD
from bayesdamp.types import UNITS, InputError, Provenance

GUESSED = "counts"
"""Unit that is assumed for a record without a stated unit, if its values are too large for radians and degrees are not
plausible either."""
HALF_TURN, FULL_TURN = np.pi, 360.0
"""Limits of half the range of values whose unit is not stated: above `HALF_TURN` they are not taken for radians (a
pendulum would go over the top), above `FULL_TURN` not for degrees (conventional)."""
_ANGLE = re.compile(
    r"^$|angle|angular|theta|phi|alpha|roll|pitch|yaw|tilt|pendul|rotation|encoder|winkel|angolo|[θφϕα]",
    re.IGNORECASE,
)
"""Regular expression for column names that may mean an angle. An empty name also matches."""
# An angle is wrapped if it jumps by a turn at the end of its scale, for example from 360 to 0 degrees. These limits
# decide whether values are a wrapped angle; all are conventional.
MIN_JUMPS = 3
"""Values count as a wrapped angle (one that jumps by a turn, as from 360 to 0 degrees) only if they have at least this
many such jumps."""
JUMP_TOLERANCE = 0.1
"""To recognise a wrapped angle: the step between two successive values counts as a jump by a turn (360 degrees) if it
differs from a turn by less than this fraction of a turn."""
MAX_SPAN = 1.001
"""Largest range, in turns (360 degrees), of the values of a wrapped angle (one that jumps by a turn). Values with a
larger range are not unwrapped."""
MAX_STEP = 0.25
"""Largest step between successive values of a wrapped angle, except for its jumps by a turn, in turns (360 degrees).
Values with a larger step are not unwrapped."""
MAX_EXCESS = 1.5
"""The jumps of a wrapped angle may differ from a turn (360 degrees) by at most this multiple of its largest other step.
The difference is the change of the angle between the two samples."""
MIN_SPAN = 3.0
"""After unwrapping (removing the jumps by a turn), an angle must span more than this multiple of its largest step other
than the jumps. Noise about two levels, which also jumps, spans less."""


@dataclass(frozen=True)
class RawRecord:
    """A record as it is in its file, before cleaning.

    Parameters
    ----------
    t
        Times in s, shape (n,); None if there is a sampling rate instead.
    y
        The recorded quantity in the file's unit, shape (n,).
    rate
        Sampling rate in Hz, given by the user or stated in the file; None if there are times.
    rows
        Row of each sample in the file, shape (n,), counted from 0 at the first row of numbers; empty if not known.
    provenance
        How the record was read: notes, warnings, facts of the file, and names of the columns.
    run
        Label of the run in the file; "" if the file has no runs.
    channel
        Name of the column of values, without the run.
    unit
        Unit of the displacement that the file states: a name in UNITS if the unit is known, else as it is written; ""
        if the file states none.
    quantity
        "angle", "velocity", "acceleration", or "" if the file does not state it.
    columns
        Columns of the times (None if no column contains them) and of the values, by name or number from 1.
    choice
        Sentence on the choice among the file's columns; "" if there was no choice.
    """

    t: np.ndarray | None
    y: np.ndarray
    rate: float | None = None
    rows: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    provenance: Provenance = field(default_factory=Provenance)
    run: str = ""
    channel: str = ""
    unit: str = ""
    quantity: str = ""
    columns: tuple[str | int | None, str | int | None] = (None, None)
    choice: str = ""

    @cached_property
    def oscillation(self) -> OscillationMeasure:
        """Return coarse measures of the oscillation in y: its period in samples, its size, and whether it decays."""
        return measure_oscillation(self.y)


def choose_unit(unit: str | None, quantity: str | None, stated: str, what: str) -> tuple[str, str]:
    """Return unit and quantity of a record: those of the user, else those of its file, else "rad" and "angle".

    unit, quantity: given by the user; None if not given. stated, what: unit and quantity that the file states; "" if it
    states none. If the unit that the user gives belongs to only one quantity (g is an acceleration), this quantity is
    used instead of that of the file. A unit of the file that is not in UNITS is ignored.
    """
    only = UNITS[unit].quantity if unit in UNITS else None
    return unit or (stated if stated in UNITS else "rad"), quantity or only or what or "angle"


def unit_or_guess(raw: RawRecord, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """Return unit and quantity of a record, as `choose_unit`; guess the unit of an angle that is too large for radians.

    unit, quantity: given by the user; None if not given. The guess is made only if neither the user nor the file states
    a unit, the quantity is "angle" (the default), and half the range of the values exceeds π. It is "deg" if the name
    of the column is empty or may mean an angle, and half the range is at most 360; otherwise it is "counts" (of a
    sensor).
    """
    resolved, what = choose_unit(unit, quantity, raw.unit, raw.quantity)
    if unit is not None or raw.unit or what != "angle" or half_swing(raw) <= HALF_TURN:
        return resolved, what
    return ("deg" if _ANGLE.search(raw.channel) and half_swing(raw) <= FULL_TURN else GUESSED), what


def half_swing(raw: RawRecord) -> float:
    """Return half of the range of a record's values, in the unit of the file."""
    return float(np.ptp(raw.y)) / 2


def count_jumps(y: np.ndarray, turn: float) -> int:
    """Return how often values y (n,) jump by a turn (360 degrees); 0 if they are not a wrapped angle.

    turn: a turn in the unit of y. Fewer than `MIN_JUMPS` jumps do not count. A rectangular signal, which also jumps, is
    not a wrapped angle: without its jumps only a constant or noise remains.
    """
    if y.size < 2 or not 0 < np.ptp(y) <= MAX_SPAN * turn:
        return 0
    steps = np.diff(y)
    jumped = np.abs(np.abs(steps) - turn) < JUMP_TOLERANCE * turn
    many = int(jumped.sum())
    largest = np.abs(steps[~jumped]).max(initial=0.0)
    missed = np.abs(np.abs(steps[jumped]) - turn).max(initial=0.0)
    if many < MIN_JUMPS or largest > MAX_STEP * turn or missed > MAX_EXCESS * largest:
        return 0
    return many if np.ptp(np.unwrap(y, period=turn)) > MIN_SPAN * largest else 0


def unwrap(raw: RawRecord, unit: str, quantity: str) -> RawRecord:
    """Return a record with its wrapped angle unwrapped, and with a note on this in its provenance.

    A wrapped angle jumps by a turn at the end of its scale, as that of an encoder between 360 and 0 degrees; without
    such jumps (`count_jumps`), the record is returned unchanged. unit, quantity: unit and quantity in which the record
    is read. Only an "angle" is unwrapped: in a unit of angles, or in "counts" (`GUESSED`) if the file states no unit.
    For counts, turns of 360 and of 2π are tried.
    """
    if quantity != "angle" or unit not in UNITS:
        return raw
    if UNITS[unit].base == "rad":
        turns = [2 * np.pi / UNITS[unit].factor]
    else:
        turns = [360.0, 2 * np.pi] if unit == GUESSED and not raw.unit else []
    for turn in turns:
        if many := count_jumps(raw.y, turn):
            note = (
                f"The angle was wrapped: it jumps by a turn ({turn:.6g}) {many} times. The jumps are removed; if the "
                "values are not angles, give their unit."
            )
            before = raw.provenance
            y = np.unwrap(raw.y, period=turn)
            return replace(raw, y=y, provenance=replace(before, notes=(*before.notes, note)))
    return raw


_ASSUMED = {
    "deg": ("degrees", "--unit rad, mm, V ... changes this"),
    "counts": ("a signal of unknown scale, in counts", "--unit deg, rad, mm, V ... if its scale is known"),
}
"""For each unit that is assumed for values which have no stated unit and are too large for radians: its description,
and the command-line option with which the user changes it."""
# The following limits are conventional.
LONGEST_PERIOD, SHORT = 600.0, 1e-6
"""Longest and shortest plausible period of an oscillation in s. If a record has a sampling rate instead of times, the
command line warns if the rate gives a period outside these limits, or is below 1 Hz."""
RATE_TOLERANCE = 0.01
"""The command line warns if the sampling rate that is used differs by more than this fraction from the rate that the
file states."""
SLOW_PERIOD = 30.0
"""Times without a stated unit are probably not in s if, taken as s, they step by at least `COARSE_STEP` and give a
period of at least this many s. The user must then state their unit."""
LARGEST_VELOCITY = {"rad": 300.0, "m": 340.0}
"""Largest plausible velocity, in rad/s and in m/s: the balance wheel of a watch reaches about 130 rad/s, sound 340 m/s.
If times in the unit that the file states give a larger velocity, and a longer unit would give a plausible one, the user
must confirm their unit."""
COARSE_STEP = 0.5
"""Times without a stated unit are probably not in s if, taken as s, they step by at least this many s and give a period
of at least `SLOW_PERIOD`."""
DAY_NUMBERS = ((25e3, 60e3), (710e3, 780e3), (2.44e6, 2.48e6))
"""Ranges (lowest, highest) of numbers of days that are dates between about 1970 and 2060: in spreadsheets and as
modified Julian days, in MATLAB, and as Julian days."""
SHORT_DAYS = 5e-4
"""The user must state the unit of times without a stated unit if they may count days: if they begin in one of the
ranges `DAY_NUMBERS`, and the period is shorter than this number of days (43 s)."""
_BRACKETS = re.compile(r"[(\[{]\s*([^\W\d][^()\[\]{}\s\d]{0,19}|\d[^()\[\]{}]{1,19})\s*[)\]}]\s*$")
"""Regular expression for text in brackets at the end of the name of a column of times, which may be a unit: a word, or
text that begins with a number, such as `1e-3 s` but not `probe 1`."""
_NO_UNITS = ("utc", "gmt", "local", "local time", "elapsed", "relative", "rel", "abs", "absolute", "raw", "x")
"""Words in brackets after the name of a column of times that are not units."""
TIME_UNIT_NAMES = "ms, us, ns, ps, min, h, d"
"""Units of time that a message lists."""


class Kind(Enum):
    """Kinds of doubts about a record, which a `Finding` states."""

    DEGREES = "a unit that was assumed"
    PERIOD = "a rate that makes the period absurd"
    RATE = "a rate that differs from the file's"
    TIME_UNIT = "times in another unit than s"
    SAMPLE_NUMBERS = "sample numbers in place of times"
    UNIT = "a unit that is not one of a displacement"


QUESTIONS = (Kind.TIME_UNIT, Kind.SAMPLE_NUMBERS, Kind.UNIT)
"""Kinds of doubts about a record that the user must settle before anything is computed, because its times or values may
be wrong by large factors."""


@dataclass(frozen=True)
class Finding:
    """A doubt about a record, and the option with which a user settles it.

    Attributes
    ----------
    kind
        Kind of the doubt.
    sentence
        The doubt in words, for the user.
    option
        What to type on the command line to settle it, with advice, such as `--time-unit ms, or s if they are in s`.
    arguments
        Names of the arguments of `read` that settle it, without values.
    """

    kind: Kind
    sentence: str
    option: str
    arguments: tuple[str, ...] = ("time_unit", "rate")

    def __str__(self) -> str:
        return f"{self.sentence} ({self.option})"


def findings(raw: RawRecord, unit: str, quantity: str, given: bool = False) -> tuple[Finding, ...]:
    """Return the doubts about the unit, the times and the sampling rate of a record.

    Those of a kind in `QUESTIONS` become errors, and the others warnings (`with_warnings`).

    Parameters
    ----------
    raw
        The record.
    unit, quantity
        Unit (of UNITS) and quantity in which it is read.
    given
        Whether the user gave the unit, which is then not doubted. An implausibly large velocity of a displacement is a
        doubt only if the user gave the unit or the file states a known one.

    Returns
    -------
    tuple of Finding
        Doubts about the unit, the times and the rate, in this order; empty if there are none.
    """
    doubts: list[Finding] = []
    size = half_swing(raw)
    if quantity == "angle" and not given and raw.unit == "" and size > HALF_TURN and unit in _ASSUMED:
        turns = size / (2 * np.pi)
        why = f"no unit given, and an amplitude of {size:.3g} would be {turns:.2g} turns in radians"
        what, option = _ASSUMED[unit]
        doubts.append(Finding(Kind.DEGREES, f"it is read as {what}: {why}", option, ("unit",)))
    if not given and unit == "rad" and raw.unit and raw.unit not in UNITS:
        choice = "give a unit such as deg, rad/s or mm, or counts for a sensor of unknown scale"
        sentence = f"its unit, {raw.unit!r}, is not known; {choice}"
        doubts.append(Finding(Kind.UNIT, sentence, "--unit counts", arguments=("unit",)))
    # Decreasing times are reported later, by the cleaning.
    if raw.t is not None and raw.t[-1] > raw.t[0] and bool(np.all(np.diff(raw.t) >= 0)):
        stated = (given or raw.unit in UNITS) and quantity == "angle"
        doubt = _doubt_times(raw, raw.t)
        if doubt is None and stated and raw.provenance.time_unit == "file":
            doubt = _doubt_speed(raw, raw.t, unit)
        doubts += [doubt] if doubt is not None else []
    if raw.rate is not None and raw.oscillation.oscillates:
        period = raw.oscillation.period / raw.rate
        if raw.rate < 1 or not SHORT < period < LONGEST_PERIOD:
            is_interval = raw.rate < 1
            question = f"is {raw.rate:.4g} the interval in s?" if is_interval else "is the rate in Hz?"
            rate = f"{1 / raw.rate:.6g}" if is_interval else "HZ"
            sentence = f"at {raw.rate:.4g} Hz a period lasts {period:.3g} s; {question}"
            doubts.append(Finding(Kind.PERIOD, sentence, f"--rate {rate}", ("rate",)))
    by_file = sampling_rate(raw.provenance.facts)
    used = raw.rate
    if used is None and raw.t is not None and raw.t.size > 1 and raw.t[-1] > raw.t[0]:
        used = (raw.t.size - 1) / float(raw.t[-1] - raw.t[0])
    if used is not None and by_file is not None and abs(used / by_file[0] - 1) > RATE_TOLERANCE:
        sentence = f"its file states {by_file[0]:.6g} Hz, but it is read at {used:.6g} Hz"
        option = f"--rate {by_file[0]:.6g} uses the stated rate"
        doubts.append(Finding(Kind.RATE, sentence, option, ("rate",)))
    return tuple(doubts)


def with_warnings(raw: RawRecord, doubts: Iterable[Finding], where: str = "") -> RawRecord:
    """Return the record with the doubts (`Finding`) about it as warnings in its provenance.

    Raise InputError for the first doubt that the user must settle before anything is computed (`QUESTIONS`), if any.
    where: name of the file, for the message.
    """
    texts = list(raw.provenance.warnings)
    for doubt in doubts:
        if doubt.kind in QUESTIONS:
            raise InputError(doubt.sentence, where, arguments=doubt.arguments)
        texts.append(f"{doubt.sentence.rstrip('?')}; give {doubt.arguments[0]}= if that is wrong.")
    return replace(raw, provenance=replace(raw.provenance, warnings=tuple(texts)))


def _doubt_times(raw: RawRecord, t: np.ndarray) -> Finding | None:
    """Return a doubt if times t (n,) may not be in s: sample numbers, days, an unknown unit or a unit shorter than s.

    The doubt becomes an error that the user must settle (`QUESTIONS`). The result is None if the times are plausible,
    if the user or the file states their unit, or if they do not come from a column of the file.
    """
    if raw.columns[0] is None or raw.provenance.time_unit:
        return None
    steps = np.diff(t)
    step = float(np.median(steps))
    if np.all(steps == 1.0) and float(t[0]).is_integer():
        sentence = f"its times are {t[0]:.0f}, {t[1]:.0f}, {t[2]:.0f}, ...: are they sample numbers?"
        return Finding(Kind.SAMPLE_NUMBERS, sentence, "--rate HZ, or --time-unit s if they are seconds")
    unknown = _BRACKETS.search(raw.provenance.time_column)
    if unknown is not None and unknown[1].lower() not in _NO_UNITS:
        sentence = f"the unit of its times, {unknown[1]!r}, is not known; the times are read as s"
        return Finding(Kind.TIME_UNIT, sentence, f"--time-unit s if they are in s, or {TIME_UNIT_NAMES}")
    oscillation, period = raw.oscillation, raw.oscillation.period * step
    if (
        oscillation.oscillates
        and period < SHORT_DAYS
        and any(low <= t[0] <= high for low, high in DAY_NUMBERS)
    ):
        sentence = f"its times begin at {t[0]:.7g} and a period lasts {period:.3g} s; do they count days?"
        return Finding(Kind.TIME_UNIT, sentence, "--time-unit d, or s if they are in s")
    if not oscillation.oscillates or step < COARSE_STEP or period < SLOW_PERIOD:
        return None
    better = next((u for u in ("ms", "us") if period * SECONDS[u] < SLOW_PERIOD), "ns")
    sentence = f"its times step by {step:.4g} and a period would last {period:.3g} s; are they in {better}?"
    return Finding(Kind.TIME_UNIT, sentence, f"--time-unit {better}, or s if they are in s")


def _doubt_speed(raw: RawRecord, t: np.ndarray, unit: str) -> Finding | None:
    """Return a doubt if the time unit that the file states gives an implausibly large velocity; otherwise None.

    The doubt becomes an error that the user must settle (`QUESTIONS`). The result is None also if nothing oscillates,
    if `LARGEST_VELOCITY` has no limit for the base unit, or if none of the longer units of time (s, ms or us) would
    give a plausible velocity and period. t: times converted to s, (n,). unit: unit of the displacement (in UNITS).
    """
    base = UNITS[unit].base
    limit, step = LARGEST_VELOCITY.get(base, np.inf), float(t[-1] - t[0]) / (t.size - 1)
    scale = 2 * np.pi / step * np.sqrt(2) * UNITS[unit].factor
    if scale * half_swing(raw) <= limit * SHORTEST_PERIOD:  # too slow even for the shortest possible period
        return None
    oscillation, period = raw.oscillation, raw.oscillation.period * step
    speed = scale / oscillation.period * oscillation.size
    own = seconds_in(raw.provenance.time_column) or 1.0
    slower = [u for u in ("s", "ms", "us") if SECONDS[u] > own and speed * own < limit * SECONDS[u]]
    better = next((u for u in slower if period * SECONDS[u] / own < SLOW_PERIOD), None)
    if not oscillation.oscillates or speed <= limit or better is None:
        return None
    sentence = (
        f"the time unit of its header gives an oscillation at {1 / period:.4g} Hz with {speed:.2g} {base}/s, which is "
        f"implausible; are its times in {better}?"
    )
    known = next(u for u in ("ms", "us", "ns", "ps") if SECONDS[u] == own)
    return Finding(Kind.TIME_UNIT, sentence, f"--time-unit {better}, or {known} if they are in {known}")
