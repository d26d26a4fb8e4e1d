"""Define a raw record (before cleaning) and its unit, and find doubts about it, with the option that settles each."""

import math
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
"""Unit of a record whose unit is not known, and whose values are too large for an angle in rad."""
HALF_TURN, FULL_TURN = math.pi, 360.0
"""Values without a stated unit are not taken for radians if their amplitude is above `HALF_TURN` (a pendulum would go
over the top), and not for degrees if it is above `FULL_TURN` (conventional)."""
_ANGLE = re.compile(
    r"^$|angle|angular|theta|phi|alpha|roll|pitch|yaw|tilt|pendul|rotation|encoder|winkel|angolo|[θφϕα]",
    re.IGNORECASE,
)
"""Column names that may stand for an angle; a column without a name may be an angle too."""
# An angle counts as wrapped (jumping by a whole turn) under these conditions; all values are conventional.
MIN_JUMPS = 3
"""Values count as a wrapped angle only if they have at least this many jumps by a turn."""
JUMP_TOLERANCE = 0.1
"""The step from one value to the next counts as a jump if it differs from a turn by less than this fraction of a
turn."""
MAX_SPAN = 1.001
"""Largest range of the values of a wrapped angle, in turns; values with a larger one are not unwrapped."""
MAX_STEP = 0.25
"""Largest step of a wrapped angle other than the jumps, in turns; values with a larger one are not unwrapped."""
MAX_EXCESS = 1.5
"""A jump of a wrapped angle must differ from a turn by at most this multiple of the largest step other than the jumps;
the difference is the change of the angle between the two samples."""
MIN_SPAN = 3.0
"""An unwrapped angle must span more than this multiple of its largest step other than the jumps. A signal that is noise
about two levels spans less."""


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
        Row of each sample in the file, shape (n,), counted from 0 at the first row of numbers.
    provenance
        How the record was read.
    run
        Label of the run in the file; "" if the file has no runs.
    channel
        Name of the column, without the run.
    unit
        Unit of the displacement that the file states: a name in UNITS if the unit is known, else as it is written; ""
        if the file states none.
    quantity
        "angle", "velocity", "acceleration", or "" if the file does not state it.
    columns
        Columns of the times (None if there are no times) and of the values, by name or number from 1.
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
        """Return coarse measures of the oscillation in y: period in samples, size in the unit of y, and its kind."""
        return measure_oscillation(self.y)


def choose_unit(unit: str | None, quantity: str | None, stated: str, what: str) -> tuple[str, str]:
    """Return unit and quantity of a record as the user or else the file states them; by default an angle in rad.

    unit, quantity: given by the user, None if not given. stated, what: unit and quantity that the file states, "" if it
    states none. If the given unit belongs to only one quantity, as g to acceleration, this quantity is used instead of
    the file's. A unit of the file that is not in UNITS is not used: rad is returned instead.
    """
    only = UNITS[unit].quantity if unit in UNITS else None
    chosen = unit or (stated if stated in UNITS else "rad")
    return chosen, quantity or only or what or "angle"


def unit_or_guess(raw: RawRecord, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """Return the unit and the quantity of a record's values; guess the unit if it is neither given nor stated.

    The result is that of `choose_unit`, which guesses rad. But the guess is different for an angle if half the range of
    the values exceeds π: "deg" if the column's name allows an angle (or is empty) and half the range is at most 360,
    otherwise "counts" (of a sensor).
    """
    resolved, what = choose_unit(unit, quantity, raw.unit, raw.quantity)
    if unit is not None or raw.unit or what != "angle" or half_swing(raw) <= HALF_TURN:
        return resolved, what
    return ("deg" if _ANGLE.search(raw.channel) and half_swing(raw) <= FULL_TURN else GUESSED), what


def half_swing(raw: RawRecord) -> float:
    """Return half of the range of a record's values, in the unit of the file."""
    return float(np.ptp(raw.y)) / 2


def count_jumps(y: np.ndarray, turn: float) -> int:
    """Return how often values y (n,) jump by a turn; 0 if they are not a wrapped angle. turn: a turn in the unit of y.

    A rectangular signal is not a wrapped angle: without its jumps it is constant, or noise.
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
    """Return the record with its wrapped angle unwrapped, and a note; a record without jumps by a turn is unchanged.

    An encoder's angle jumps at the end of its scale, for example between 360 and 0 degrees. unit, quantity: those in
    which the record is read; only an "angle" in a unit of angles is unwrapped, or one without any unit (`GUESSED`), for
    which turns of 360 and of 2π are tried.
    """
    if quantity != "angle" or unit not in UNITS:
        return raw
    if UNITS[unit].base == "rad":
        turns = [2 * math.pi / UNITS[unit].factor]
    else:
        turns = [360.0, 2 * math.pi] if unit == GUESSED and not raw.unit else []
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
and the command-line option that changes it."""
# The following limits are conventional.
LONGEST_PERIOD, SHORT = 600.0, 1e-6
"""Longest and shortest plausible period of an oscillation in s; the user is warned if a sampling rate gives a period
outside these limits."""
RATE_TOLERANCE = 0.01
"""A sampling rate that differs by more than this fraction from that which the file states is reported to the user."""
SLOW_PERIOD = 30.0
"""Times without a stated unit are probably not in s if they step by at least COARSE_STEP and the period would be longer
than this many s; the user must then state their unit."""
LARGEST_VELOCITY = {"rad": 300.0, "m": 340.0}
"""Largest plausible velocity in rad/s and m/s: the balance wheel of a watch reaches about 130 rad/s, sound 340 m/s. If
the velocity would be larger, the user must confirm the unit of the times."""
COARSE_STEP = 0.5
"""Times without a stated unit are probably not in s if they step by at least this, read as s, and the period is longer
than `SLOW_PERIOD`."""
DAY_NUMBERS = ((25e3, 60e3), (710e3, 780e3), (2.44e6, 2.48e6))
"""Ranges (lowest, highest) of numbers that may be dates between about 1970 and 2060, counted in days: in spreadsheets
or as modified Julian days, in MATLAB, and as Julian days."""
SHORT_DAYS = 5e-4
"""Times without a stated unit that begin in one of the ranges DAY_NUMBERS may count days, if the period is shorter than
this number of days (43 s); the user must then state their unit."""
_BRACKETS = re.compile(r"[(\[{]\s*([^\W\d][^()\[\]{}\s\d]{0,19}|\d[^()\[\]{}]{1,19})\s*[)\]}]\s*$")
"""Text in brackets at the end of a name of times that may be a unit: a word, or text that begins with a number, such as
`1e-3 s` but not `probe 1`."""
_NO_UNITS = ("utc", "gmt", "local", "local time", "elapsed", "relative", "rel", "abs", "absolute", "raw", "x")
"""Words in brackets that are not units."""
TIME_UNIT_NAMES = "ms, us, ns, ps, min, h, d"
"""Units of time for messages."""


class Kind(Enum):
    """Kinds of findings: what the doubt about a record is about."""

    DEGREES = "a unit that was assumed"
    PERIOD = "a rate that makes the period absurd"
    RATE = "a rate that differs from the file's"
    TIME_UNIT = "times in another unit than s"
    SAMPLE_NUMBERS = "sample numbers in place of times"
    UNIT = "a unit that is not one of a displacement"


QUESTIONS = (Kind.TIME_UNIT, Kind.SAMPLE_NUMBERS, Kind.UNIT)
"""Kinds of findings that the user must settle before anything is computed, because times or values may be wrong by
large factors."""


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
        The option that settles it, as typed on the command line.
    arguments
        Arguments of `read` that settle it; used for the kinds in QUESTIONS.
    """

    kind: Kind
    sentence: str
    option: str
    arguments: tuple[str, ...] = ("time_unit", "rate")

    def __str__(self) -> str:
        return f"{self.sentence} ({self.option})"


def findings(raw: RawRecord, unit: str, quantity: str, given: bool = False) -> tuple[Finding, ...]:
    """Return the doubts about a record, without changing it.

    Parameters
    ----------
    raw
        The record.
    unit, quantity
        Unit (of UNITS) and quantity in which it is read.
    given
        Whether the user gave the unit, which is then not doubted.

    Returns
    -------
    tuple of Finding
        Doubts about the unit, the times and the rate, in this order.
    """
    doubts: list[Finding] = []
    size = half_swing(raw)
    if quantity == "angle" and not given and raw.unit == "" and size > HALF_TURN and unit in _ASSUMED:
        turns = size / (2 * math.pi)
        why = f"no unit given, and an amplitude of {size:.3g} would be {turns:.2g} turns in radians"
        what, option = _ASSUMED[unit]
        doubts.append(Finding(Kind.DEGREES, f"it is read as {what}: {why}", option))
    if not given and unit == "rad" and raw.unit and raw.unit not in UNITS:
        sentence = f"its unit, {raw.unit!r}, is not a unit of displacement"
        option = "--unit counts for a sensor of unknown scale; mm, deg ... if that is its unit"
        doubts.append(Finding(Kind.UNIT, sentence, option, arguments=("unit",)))
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
            doubts.append(Finding(Kind.PERIOD, sentence, f"--rate {rate}"))
    by_file = sampling_rate(raw.provenance.facts)
    used = raw.rate
    if used is None and raw.t is not None and raw.t.size > 1 and raw.t[-1] > raw.t[0]:
        used = (raw.t.size - 1) / float(raw.t[-1] - raw.t[0])
    if used is not None and by_file is not None and abs(used / by_file[0] - 1) > RATE_TOLERANCE:
        sentence = f"its file states {by_file[0]:.6g} Hz, but it is read at {used:.6g} Hz"
        doubts.append(Finding(Kind.RATE, sentence, f"--rate {by_file[0]:.6g} uses the stated rate"))
    return tuple(doubts)


def refuse_questions(doubts: Iterable[Finding], where: str = "") -> None:
    """Raise InputError for the first doubt that the user must settle before anything is computed, if there is one.

    where: the file, for the message.
    """
    for doubt in doubts:
        if doubt.kind in QUESTIONS:
            raise InputError(doubt.sentence, where, arguments=doubt.arguments)


def _doubt_times(raw: RawRecord, t: np.ndarray) -> Finding | None:
    """Return a finding if times t (n,) may not be in s: sample numbers, days, an unknown unit or a unit shorter than s.

    Return None if they are plausible, if their unit is given or stated by the file, or if no column contains them.
    """
    if raw.columns[0] is None or raw.provenance.time_unit:
        return None
    steps = np.diff(t)
    step = float(np.median(steps))
    if np.all(steps == 1.0) and float(t[0]).is_integer():
        sentence = f"its times are {t[0]:.0f}, {t[1]:.0f}, {t[2]:.0f}, ...: are they sample numbers?"
        option = "--rate HZ, or --time-unit s if they are seconds"
        return Finding(Kind.SAMPLE_NUMBERS, sentence, option)
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
    """Return a finding if the file's unit of the times t (n,) gives an implausibly large velocity; else None.

    t: times converted to s. unit: unit of the displacement, a name in UNITS; the limits are `LARGEST_VELOCITY`. The
    result is also None if nothing oscillates, or if no longer unit of time (s, ms or us) would give a plausible
    velocity and period.
    """
    base = UNITS[unit].base
    limit, step = LARGEST_VELOCITY.get(base, math.inf), float(t[-1] - t[0]) / (t.size - 1)
    scale = 2 * math.pi / step * math.sqrt(2) * UNITS[unit].factor
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
    option = f"--time-unit {better}, or {known} if they are in {known}"
    return Finding(Kind.TIME_UNIT, sentence, option)
