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

    EXACT: the damping follows its law within a small limit (for an envelope: the law probably holds exactly), or laws
    were assumed to hold exactly. APPROXIMATE: the deviation from the law may be larger, but the law is still the
    answer. DEVIATES: no law is named as the answer, because the deviation or the unexplained residual is too large, or
    because the best law contradicts the damping that is measured without a law (for an envelope: because a single power
    of the amplitude describes it much better). NO_FREE_DECAY: the record is not the free decay of one oscillator.
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
    """A value at an amplitude, with the ends `low` and `high` of its 95 % interval.

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
    """The damping divided by the damping of its law at an amplitude: exp(g − mean of g), with the log deviation g."""


@dataclass(frozen=True)
class MeasuredNumber:
    """A number with its total 95 % interval, from `low` to `high`, and its unit.

    sd_noise: the part of its standard deviation sd that is due to noise. sd_law: the other part, √(sd² − sd_noise²),
    such as that due to deviations from the laws, to the sensor or, for several records, to differences between them.
    Both are NaN if unknown.
    """

    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True)
class AtAmplitude:
    """A number at an amplitude, with its total 95 % interval, from `low` to `high`.

    unit: unit of the amplitude, not of the number. sd_noise, sd_law: the two parts of the number's standard deviation,
    as in `MeasuredNumber`.
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
    """A parameter of the damping or restoring law that a verdict names, with its total 95 % interval, low to high.

    sd_noise, sd_law: the two parts of its standard deviation, as in `MeasuredNumber`; NaN for several records. unit:
    unit of all these numbers.
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
    """A possible damping other than the one that the verdict names, with its probability.

    It is another of the compared sums of damping terms, or a form of damping outside these sums.
    """

    damping: str
    probability: float


@dataclass(frozen=True)
class Share:
    """The fraction of the dissipated energy that one damping term dissipates, from 0 to 1, with its 95 % interval.

    probability: probability that the damping contains this term.
    """

    term: str
    share: float
    low: float
    high: float
    probability: float


@dataclass(frozen=True)
class Bound:
    """A 95 % upper limit for a form of damping that is not in the sum of damping terms that the verdict names.

    share_below: the limit of the fraction of the dissipated energy that this damping may account for, from 0 to 1.
    form: the damping term, or "any other form".
    """

    form: str
    share_below: float


@dataclass(frozen=True)
class UsedWindow:
    """The part of the record that was used, from `start` to `stop`, in s on the file's own clock.

    why: for an envelope, clauses on how start and stop were chosen, separated by "; "; otherwise "". cycles: number of
    cycles; NaN if the frequency is not known. floor_db: mean level of the noise floor after an envelope's decay, in dB
    of the recorded power; NaN if no floor was found.
    """

    start: float
    stop: float
    cycles: float
    why: str
    floor_db: float = NAN


@dataclass(frozen=True)
class Averages:
    """Information on the averaging over cycles, by which a record of very many cycles is fitted.

    Amplitudes and phases that are averaged over blocks of cycles are then fitted instead of the full motion. cycles:
    number of cycles in the record. error_sd: largest shift of a parameter by the averaging, in posterior standard
    deviations; infinite if it could not be computed.
    """

    cycles: float
    error_sd: float


@dataclass(frozen=True)
class Oscillation:
    """One of the damped sinusoids in a record that is not a free decay of one oscillator.

    frequency: in Hz. damping_ratio: a fraction, with its 95 % interval from low to high; negative if the sinusoid
    grows. first, last: displacement amplitudes at the start and the end of the record, in `unit`. If the motion is
    `MotionKind.EXCITED`, the damping ratio is NaN, and first and last are the smallest and the largest amplitude.
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
    """Return the quality factor Q = 1/(2 × damping ratio) as text with its 95 % interval.

    If the interval of the damping ratio includes 0, the text contains only the value and the lower limit. If the
    damping ratio itself is not positive or NaN, the text is a dash.
    """
    if not r.value > 0:
        return fmt.NONE
    if not r.low > 0:
        return f"{fmt.digits(0.5 / r.value, n=3)} (above {fmt.digits(0.5 / r.high, n=3)})"
    return fmt.with_interval(0.5 / r.value, 0.5 / r.high, 0.5 / r.low)


def ratios_table(ratios: Iterable[DampingRatio], caption: str = "", parts: bool = False) -> Table:
    """Return a table of damping ratios in per cent and of Q, with 95 % intervals, against amplitude.

    `parts`: whether to add two columns with the parts `sd_noise` and `sd_law` of each standard deviation, in per cent.
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
    """Return a table of an envelope's decay rates in 1/s, and of its quality factor Q, against amplitude.

    `rates`: the decay rates with their 95 % intervals. `qualities`: Q at the same amplitudes, or empty if it is not
    known; the table then has no column for Q.
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
    """Return a number with its 95 % interval as text without unit; a dash for None.

    Very large or small numbers are written with a power of ten.
    """
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
