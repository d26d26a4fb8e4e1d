"""Define the values of which a verdict consists, and write tables of them."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from bayesdamp import formatting as fmt
from bayesdamp.formatting import Table

NAN = math.nan
"""The NaN that all unknown values of verdicts share. Tuples and dataclasses with the same NaN object compare as equal,
those with different ones do not."""


class Grade(StrEnum):
    """How well a law of damping describes the record, the best first; or why no law was compared.

    EXACT: no deviation from the law is larger than a small limit. APPROXIMATE: the damping deviates from its law by
    more than that, but the law is still the answer. DEVIATES: the deviation, or what the law leaves unexplained, is so
    large that no law is named as the answer. NO_FREE_DECAY: the record is not the free decay of one oscillator.
    NOT_WEIGHED: no model could be fitted. `decide.grade_of`, and for an envelope `envelope.answer`, state the limits.
    """

    EXACT = "exact"
    APPROXIMATE = "approximate"
    DEVIATES = "deviates"
    NO_FREE_DECAY = "no_free_decay"
    NOT_WEIGHED = "not_weighed"


@dataclass(frozen=True)
class Interval:
    """A value with the ends `low` and `high` of its 95 % interval, all in `unit`; the unit is "" for a pure number."""

    value: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True)
class IntervalAt:
    """A value at an amplitude of the record, with the ends `low` and `high` of its 95 % interval.

    unit: unit of the amplitude, not of the value.
    """

    amplitude: float
    unit: str
    value: float
    low: float
    high: float


class FrequencyAt(IntervalAt):
    """The frequency in Hz at an amplitude, with its 95 % interval."""


class OverLaw(IntervalAt):
    """The inferred damping divided by the damping that its law alone gives, without the deviation, at an amplitude."""


@dataclass(frozen=True)
class MeasuredNumber:
    """A number with its total 95 % interval, from `low` to `high`, and its unit.

    sd_noise, sd_law: the parts of its standard deviation from noise and from deviations of the law; NaN if unknown.
    """

    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True)
class AtAmplitude:
    """A number at an amplitude of the record, with its total 95 % interval, from `low` to `high`.

    unit: unit of the amplitude, not of the number. sd_noise, sd_law: the parts of the number's standard deviation from
    noise and from deviations of the law; NaN if unknown.
    """

    amplitude: float
    unit: str
    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float


class DampingRatio(AtAmplitude):
    """The equivalent viscous damping ratio (a fraction, not per cent) at an amplitude."""


@dataclass(frozen=True)
class Coefficient:
    """A parameter of the most probable damping sum or restoring law, with its total 95 % interval, from low to high.

    sd_noise, sd_law: the parts of its standard deviation from noise and from deviations of the law. unit: unit of all
    these numbers.
    """

    name: str
    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """A damping other than the one named first, with its probability.

    It is another damping sum, or a form of damping outside the compared sums.
    """

    damping: str
    probability: float


@dataclass(frozen=True)
class Share:
    """A term's fraction of the dissipated energy, from 0 to 1, with its 95 % interval.

    probability: that the damping contains the term.
    """

    term: str
    share: float
    low: float
    high: float
    probability: float


@dataclass(frozen=True)
class Bound:
    """The 95 % upper limit `share_below` (0 to 1) of the energy fraction that an absent damping may dissipate.

    form: a term that is not in the named damping sum, or "any other form".
    """

    form: str
    share_below: float


@dataclass(frozen=True)
class UsedWindow:
    """The part of the record that was used, from `start` to `stop` in s on the file's own clock, and why.

    why: for an envelope, clauses on how start and stop were chosen, separated by "; "; otherwise "". cycles: number of
    cycles; NaN where the frequency is not known. floor_db: mean level of the noise floor after an envelope's decay, in
    dB of the recorded power; NaN where there is none.
    """

    start: float
    stop: float
    cycles: float
    why: str
    floor_db: float = NAN


@dataclass(frozen=True)
class Averages:
    """The averaging by which amplitudes and phases replaced the full motion, in a record of very many cycles.

    cycles: number of cycles in the record. error_sd: largest shift of a parameter by the averaging, in posterior
    standard deviations.
    """

    cycles: float
    error_sd: float


@dataclass(frozen=True)
class Oscillation:
    """One of the damped sinusoids in a record that is not a free decay of one oscillator.

    frequency: in Hz. damping_ratio: a fraction, with its 95 % interval low to high; negative where the sinusoid grows,
    NaN if the motion is `EXCITED`. first, last: displacement amplitudes at the ends of the record, in `unit`; the least
    and the largest one if the motion is `EXCITED`.
    """

    frequency: float
    damping_ratio: float
    low: float
    high: float
    first: float
    last: float
    unit: str


class MotionKind(StrEnum):
    """Kinds of records that are not a free decay of one oscillator.

    GROWING: the oscillation grows. STEADY: no decay is detected. EXCITED: the amplitude rises and falls repeatedly, as
    under random forces. BEATS, TWO_MODES: two oscillations, which beat or not. DRIVEN: a driven oscillation in addition
    to a decay.
    """

    GROWING = "growing"
    STEADY = "steady"
    EXCITED = "excited"
    BEATS = "beats"
    TWO_MODES = "two modes"
    DRIVEN = "driven"


def quality_of(r: DampingRatio) -> str:
    """Return Q = 1/(2 × damping ratio) as text with its 95 % interval.

    The text has only the value and the lower limit where the interval of the damping ratio includes 0. Return a dash
    where the damping ratio itself is not positive.
    """
    if not r.value > 0:
        return fmt.NONE
    if not r.low > 0:
        return f"{fmt.digits(0.5 / r.value, n=3)} (above {fmt.digits(0.5 / r.high, n=3)})"
    return fmt.with_interval(0.5 / r.value, 0.5 / r.high, 0.5 / r.low)


def ratios_table(ratios: Iterable[DampingRatio], caption: str = "", parts: bool = False) -> Table:
    """Return a table of damping ratios in per cent and of Q, with 95 % intervals, against amplitude.

    `parts`: whether to add the parts of the ratios' standard deviations that are due to noise and to the law.
    """
    columns: dict[str, Callable[[DampingRatio], str]] = {
        "amplitude": lambda r: f"{fmt.digits(r.amplitude, n=3)} {r.unit}",
        "equivalent damping ratio (95 %)": lambda r: fmt.with_interval(r.value, r.low, r.high, " %", 100),
        "Q": quality_of,
    }
    if parts:
        columns["sd from noise"] = lambda r: f"{fmt.digits(100 * r.sd_noise, n=2)} %"
        columns["sd from the law"] = lambda r: f"{fmt.digits(100 * r.sd_law, n=2)} %"
    return Table.of(ratios, columns, caption=caption)


def decay_table(rates: Sequence[AtAmplitude], qualities: Sequence[AtAmplitude]) -> Table:
    """Return a table of an envelope's decay rates in 1/s, and of Q, with 95 % intervals, against amplitude.

    `qualities`: Q at the amplitudes of `rates`, or empty if it is not known.
    """
    columns: dict[str, Callable[[int], str]] = {
        "amplitude": lambda i: f"{fmt.digits(rates[i].amplitude)} {rates[i].unit}",
        "rate / (1/s) (95 %)": lambda i: number(rates[i]),
    }
    if qualities:
        columns["Q (95 %)"] = lambda i: number(qualities[i])
    caption = "Decay rate of the amplitude, and Q if the frequency is known, with 95 % intervals in brackets."
    return Table.of(range(len(rates)), columns, caption=caption)


def number(value: MeasuredNumber | Interval | AtAmplitude | None) -> str:
    """Return a number with its 95 % interval as text without unit; a power of ten if large, a dash for None."""
    return fmt.NONE if value is None else fmt.with_interval(value.value, value.low, value.high)


def modes_table(modes: Iterable[Oscillation], motion: MotionKind | None) -> Table:
    """Return a table of the sinusoids in a record that is not a free decay of one oscillator.

    If the motion is excited, the two amplitudes are the least and the largest, otherwise the first and the last.
    """
    first, last = ("least", "largest") if motion is MotionKind.EXCITED else ("first", "last")
    columns: dict[str, Callable[[Oscillation], str]] = {
        "frequency": lambda m: f"{fmt.digits(m.frequency, n=5)} Hz",
        "damping ratio (95 %)": lambda m: fmt.with_interval(m.damping_ratio, m.low, m.high, " %", 100),
        f"{first} amplitude": lambda m: f"{fmt.digits(m.first, n=3)} {m.unit}",
        f"{last} amplitude": lambda m: f"{fmt.digits(m.last, n=3)} {m.unit}",
    }
    caption = (
        f"Oscillations in the record, with the {first} and the {last} amplitude of the displacement. The 95 % interval "
        "of the damping ratio is in brackets."
    )
    return Table.of(modes, columns, left=(), caption=caption)
