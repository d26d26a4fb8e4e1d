"""What a verdict is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

NAN = math.nan
"""One object for all that is not known, so that verdicts with such fields can be equal."""


class Grade(StrEnum):
    """How well a law of damping describes the record."""

    EXACT = "exact"
    APPROXIMATE = "approximate"
    DEVIATES = "deviates"
    NO_FREE_DECAY = "no_free_decay"
    NOT_WEIGHED = "not_weighed"


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval, in a unit."""

    value: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True)
class IntervalAt:
    """A value at an amplitude of the record, with its 95 % interval."""

    amplitude: float
    unit: str
    value: float
    low: float
    high: float


class FrequencyAt(IntervalAt):
    """Frequency in Hz of the oscillation at an amplitude."""


class OverLaw(IntervalAt):
    """How many times its law's own the damping is at an amplitude."""


@dataclass(frozen=True)
class Estimate:
    """A number with its total 95 % interval, in a unit.

    sd_noise and sd_law are the parts of its standard deviation from noise and from what the law does not hold.
    """

    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True)
class AtAmplitude:
    """A number at an amplitude of the record, with its total 95 % interval; the parts of its standard deviation as of
    `Estimate`."""

    amplitude: float
    unit: str
    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float


class DampingRatio(AtAmplitude):
    """Equivalent viscous damping ratio at an amplitude."""


@dataclass(frozen=True)
class LawFreeAt:
    """What is measured without any law: damping ratios at the verdict's amplitudes, or at the nearest that the curve
    reaches, and the frequency at the last of them."""

    ratios: tuple[DampingRatio, ...]
    frequency: FrequencyAt


@dataclass(frozen=True)
class Coefficient:
    """A parameter under the damping that is named, with its total 95 % interval."""

    name: str
    value: float
    sd_noise: float
    sd_law: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """Another damping sum and its probability."""

    damping: str
    probability: float


@dataclass(frozen=True)
class Share:
    """A term's share of the dissipated energy, with its 95 % interval; probability: that the term is there."""

    term: str
    share: float
    low: float
    high: float
    probability: float


@dataclass(frozen=True)
class Bound:
    """The 95 % upper limit of the share of the energy that an absent form of damping may take."""

    form: str
    share_below: float


@dataclass(frozen=True)
class Window:
    """The piece of the record that was used, in s of the file's own times, and why.

    cycles: NaN where the frequency is not known. floor_db: of an envelope, the mean level of the noise floor behind it
    in dB of the recorded power, NaN where none is seen.
    """

    start: float
    stop: float
    cycles: float
    why: str
    floor_db: float = NAN


@dataclass(frozen=True)
class Averages:
    """That averaged amplitude and phase stand for the motion of a record of very many cycles: the number of cycles, and
    the most by which that moves a parameter from where the equation of motion itself has it, in its posterior sds."""

    cycles: float
    error_sd: float


@dataclass(frozen=True)
class Mode:
    """One of the oscillations of a record that is no free decay of one oscillator: a damped sinusoid.

    frequency in Hz; damping_ratio: with its 95 % interval, below 0 where it grows; first, last: amplitude at the ends
    of the record.
    """

    frequency: float
    damping_ratio: float
    low: float
    high: float
    first: float
    last: float
    unit: str


class Motion(StrEnum):
    """What a record is that is no free decay of one oscillator."""

    GROWING = "growing"
    STEADY = "steady"
    EXCITED = "excited"
    BEATS = "beats"
    TWO_MODES = "two modes"
    DRIVEN = "driven"
