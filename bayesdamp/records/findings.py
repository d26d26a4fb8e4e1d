"""What looks wrong with a record before anything is computed, and the option that mends it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from bayesdamp.records.columns.choosing import DIFFER
from bayesdamp.records.columns.swings import Swing, swing
from bayesdamp.records.files.facts import sampling_rate
from bayesdamp.records.files.named_units import SECONDS, seconds_in
from bayesdamp.records.record import RawRecord
from bayesdamp.records.stated_columns import HALF_TURN, half_swing
from bayesdamp.units import UNITS

_ASSUMED = {
    "deg": ("degrees", "--unit rad, mm, V ... where they are not"),
    "counts": ("a signal of unknown scale, in counts", "--unit deg, rad, mm, V ... where that is known"),
}
"""What values are taken for where nobody says a unit and they are too large for radians."""
LONG, SHORT = 600.0, 1e-6
"""Periods in s that a rate given by hand hardly means."""
SLOW = 30.0
"""A period in s from which times whose unit nobody says are doubted."""
FASTEST = {"rad": 300.0, "m": 340.0}
"""Speeds in rad/s and m/s beyond which the unit of the times is doubted: a watch's balance wheel has some 130 rad/s,
sound 340 m/s (conventional)."""
COARSE = 0.5
"""The step in s of such times from which they are doubted."""
DAY_NUMBERS = ((25e3, 60e3), (710e3, 780e3), (2.44e6, 2.48e6))
"""Numbers of the days from 1970 to 2060 or so: of spreadsheets and as modified Julian days, of MATLAB, Julian days."""
SHORT_DAYS = 5e-4
"""A period in s from which down times at such a number are doubted: some 40 s if they are days (conventional)."""
_BRACKETS = re.compile(r"[(\[{]\s*([^\W\d][^()\[\]{}\s\d]{0,19}|\d[^()\[\]{}]{1,19})\s*[)\]}]\s*$")
"""A word in brackets behind the name of times, or what begins with a number: `1e-3 s`; `probe 1` is none."""
_NO_UNITS = ("utc", "gmt", "local", "local time", "elapsed", "relative", "rel", "abs", "absolute", "raw", "x")
VALID = "ms, us, ns, ps, min, h, d"
"""Units of time to choose from."""


class Kind(Enum):
    """What is doubted."""

    DEGREES = "a unit that was assumed"
    PERIOD = "a rate that makes the period absurd"
    RATE = "a rate that differs from the file's"
    TIME_UNIT = "times in another unit than s"
    SAMPLE_NUMBERS = "numbers of samples taken for times"
    UNIT = "a unit that is not one of a displacement"
    CONSTANT = "columns that do not change"


QUESTIONS = (Kind.TIME_UNIT, Kind.SAMPLE_NUMBERS, Kind.UNIT)
"""Doubts that must be settled before anything is computed: the times or the values may be wrong a thousandfold."""


@dataclass(frozen=True)
class Finding:
    """A doubt: a sentence for the user, and the option that mends it as it is typed.

    answer: the option's name and its likeliest value, where one option settles the doubt. arguments: of `read`, that
    settle it if it is one of QUESTIONS.
    """

    kind: Kind
    sentence: str
    option: str
    answer: tuple[str, str] | None = None
    arguments: tuple[str, ...] = ("time_unit", "rate")

    def __str__(self) -> str:
        return f"{self.sentence} ({self.option})"


def findings(raw: RawRecord, unit: str, quantity: str, given: bool = False) -> tuple[Finding, ...]:
    """What looks wrong with a record that is read in a unit of UNITS as a quantity; nothing is changed. given: whether
    the user says the unit."""
    seen = swing(raw.y)
    # What is wrong with times that go back is said when they are used.
    rises = raw.t is not None and raw.t[-1] > raw.t[0] and bool(np.all(np.diff(raw.t) >= 0))
    doubts = (
        _assumed(raw, unit, quantity, given),
        None if given or unit != "rad" else _unit(raw),
        rises and (_times(raw, seen) or _too_fast(raw, unit, quantity, given, seen)),
        *_rates(raw, seen),
        _constant(raw),
    )
    return tuple(doubt for doubt in doubts if doubt)


def question(raw: RawRecord, unit: str, quantity: str, given: bool) -> Finding | None:
    """The first finding on a record that has to be answered before it is computed with; None where there is none.
    given: whether the user says the unit."""
    found = findings(raw, unit, quantity, given) if unit in UNITS else ()
    return next((doubt for doubt in found if doubt.kind in QUESTIONS), None)


def _assumed(raw: RawRecord, unit: str, quantity: str, given: bool) -> Finding | None:
    if quantity != "angle" or (raw.unit and raw.unit not in UNITS):
        return None
    size = half_swing(raw)
    if not given and raw.unit == "" and size > HALF_TURN and unit in _ASSUMED:
        turns = size / (2 * math.pi)
        why = f"no unit is said, and its values reach {size:.3g}: {turns:.2g} turns to either side if radians"
        what, option = _ASSUMED[unit]
        return Finding(Kind.DEGREES, f"it is read as {what}: {why}", option, ("unit", unit))
    return None


def _unit(raw: RawRecord) -> Finding | None:
    if not raw.unit or raw.unit in UNITS:
        return None
    sentence = f"its unit, {raw.unit!r}, is not one of a displacement"
    option = "--unit counts for a sensor of unknown scale; mm, deg ... if that is its unit"
    return Finding(Kind.UNIT, sentence, option, ("unit", "counts"), arguments=("unit",))


def _times(raw: RawRecord, seen: Swing) -> Finding | None:
    if raw.t is None or raw.columns[0] is None or raw.provenance.time_unit:
        return None
    steps = np.diff(raw.t)
    step = float(np.median(steps))
    if steps.size and np.all(steps == 1.0) and float(raw.t[0]).is_integer():
        sentence = (
            f"its times are {raw.t[0]:.0f}, {raw.t[1]:.0f}, {raw.t[2]:.0f}, ...: are they numbers of samples?"
        )
        answer = ("rate", "HZ")
        return Finding(
            Kind.SAMPLE_NUMBERS, sentence, "--rate HZ, or --time-unit s if they are seconds", answer
        )
    unknown = _BRACKETS.search(raw.provenance.time_column)
    if unknown is not None and unknown[1].lower() not in _NO_UNITS:
        sentence = f"the unit of its times, {unknown[1]!r}, is not known; they are read as s"
        return Finding(Kind.TIME_UNIT, sentence, f"--time-unit s if they are, or {VALID}", ("time-unit", "s"))
    period = seen.period * step
    if seen.swings and period < SHORT_DAYS and any(low <= raw.t[0] <= high for low, high in DAY_NUMBERS):
        sentence = (
            f"its times begin at {raw.t[0]:.7g} and a period would last {period:.3g} s; do they count days?"
        )
        return Finding(Kind.TIME_UNIT, sentence, "--time-unit d, or s if they are", ("time-unit", "d"))
    if not seen.swings or step < COARSE or period < SLOW:
        return None
    better = next((u for u, s in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if period * s < SLOW), "us")
    sentence = f"its times step by {step:.4g} and a period would last {period:.3g} s; are they in {better}?"
    return Finding(Kind.TIME_UNIT, sentence, f"--time-unit {better}, or s if they are", ("time-unit", better))


def _too_fast(raw: RawRecord, unit: str, quantity: str, given: bool, seen: Swing) -> Finding | None:
    """Doubt the file's unit of the times where an angle or a position of a stated unit would move too fast."""
    limit = FASTEST.get(UNITS[unit].base, math.inf)
    stated = (given or raw.unit in UNITS) and quantity == "angle"
    if raw.t is None or not stated or not seen.swings or raw.provenance.time_unit != "file":
        return None
    period = seen.period * float(raw.t[-1] - raw.t[0]) / (raw.t.size - 1)
    speed = 2 * math.pi / period * math.sqrt(2) * seen.size * UNITS[unit].factor
    said = seconds_in(raw.provenance.time_column) or 1.0
    slower = [u for u in ("s", "ms", "us") if SECONDS[u] > said and speed * said < limit * SECONDS[u]]
    better = next((u for u in slower if period * SECONDS[u] / said < SLOW), None)
    if speed <= limit or better is None:
        return None
    sentence = (
        f"by its head it swings at {1 / period:.4g} Hz and moves at {speed:.2g} {UNITS[unit].base}/s, which hardly "
        f"anything does; are its times in {better}?"
    )
    known = next(
        (unit for unit in ("s", "ms", "us", "ns", "ps") if SECONDS[unit] == said), "as the head says"
    )
    option = f"--time-unit {better}, or {known} if they are"
    return Finding(Kind.TIME_UNIT, sentence, option, ("time-unit", better))


def _rates(raw: RawRecord, seen: Swing) -> Iterator[Finding]:
    """Doubt a rate that makes the period absurd, or that differs from what the file says."""
    if raw.rate is not None and seen.swings:
        period = seen.period / raw.rate
        if raw.rate < 1:
            sentence = (
                f"at {raw.rate:.4g} Hz a period lasts {period:.3g} s; is {raw.rate:.4g} the interval in s?"
            )
            rate = f"{1 / raw.rate:.6g}"
            yield Finding(Kind.PERIOD, sentence, f"--rate {rate}", ("rate", rate))
        elif not SHORT < period < LONG:
            sentence = f"at {raw.rate:.4g} Hz a period lasts {period:.3g} s; is the rate in Hz?"
            yield Finding(Kind.PERIOD, sentence, "--rate HZ", ("rate", "HZ"))
    stated = sampling_rate(raw.provenance.facts)
    used = raw.rate
    if used is None and raw.t is not None and raw.t.size > 1 and raw.t[-1] > raw.t[0]:
        used = (raw.t.size - 1) / float(raw.t[-1] - raw.t[0])
    if used is not None and stated is not None and abs(used / stated[0] - 1) > DIFFER:
        sentence = f"its file says {stated[0]:.6g} Hz, and it is read at {used:.6g} Hz"
        yield Finding(Kind.RATE, sentence, f"--rate {stated[0]:.6g} takes the file's")


def _constant(raw: RawRecord) -> Finding | None:
    still = raw.provenance.constant_columns
    if not still:
        return None
    names = ", ".join(repr(str(name)[:40]) for name in still[:4])
    more = f" and {len(still) - 4} more" if len(still) > 4 else ""
    sentence = f"left out because {'they do' if len(still) > 1 else 'it does'} not change: {names}{more}"
    return Finding(Kind.CONSTANT, sentence, "--angle NAME takes another column")
