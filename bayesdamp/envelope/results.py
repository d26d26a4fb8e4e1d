"""What is said of an envelope. Frozen, with hardly any behaviour."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from bayesdamp.envelope.likelihood import RateLikelihood


@dataclass(frozen=True)
class Range:
    """A number with its central 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Estimated(Range):
    """A number with its 95 % interval, and what of its standard deviation the readings' noise and what an inexact law
    (and an imperfect detector) account for."""

    sd_noise: float
    sd_law: float


@dataclass(frozen=True)
class AtAmplitude:
    """The decay at one amplitude of the record, averaged over damping sums.

    amplitude in `unit` (dBm, V, ...); rate in 1/s: -d ln A/dt; damping_ratio = rate/ω and quality_factor = ω/(2 rate),
    None where the frequency is not known.
    """

    amplitude: float
    unit: str
    rate: Estimated
    damping_ratio: Estimated | None
    quality_factor: Estimated | None


@dataclass(frozen=True)
class Coefficient:
    """A damping coefficient averaged over the sums that have its term."""

    name: str
    unit: str
    estimate: Estimated


@dataclass(frozen=True)
class Cut:
    """The free decay in the record's own clock: start and stop in s, their samples, why, and the floor's mean level in
    dB of the recorded power (nan where it is not reached)."""

    start: float
    stop: float
    first: int
    behind: int
    why: tuple[str, ...]
    floor: float


@dataclass(frozen=True, eq=False)
class Curve:
    """For pictures: times in s on the record's clock, levels in dB of the recorded power of the readings' means, of the
    fit of the best sum, and the sd of a reading's scatter in dB, shape (n,)."""

    __pydantic_config__: ClassVar = {"arbitrary_types_allowed": True}

    t: np.ndarray
    level: np.ndarray
    fit: np.ndarray
    scatter: np.ndarray


@dataclass(frozen=True, eq=False)
class EnvelopeResult:
    """The damping of one envelope.

    grade: "exact", "approximate", "deviates" (from every sum of the three dampings) or "no_free_decay".
    damping, probability: the most probable sum; probabilities: of every sum; terms: probability of each term, summed
    over the sums that have it. rate: the law's in 1/s, mean over the first half of the fall in dB; quality_factor of it
    where the frequency (Hz) is known; at: at three amplitudes, as it was, largest first. energy: share of the energy
    that each term takes. exponent: p of dA/dt = -cA^p by itself; power_law: its log Bayes factor against the mixture of
    sums. deviation: root mean square of the law's relative deviation over the decay. unexplained_pct, noise_pct: of the
    amplitude. likelihoods: of the rates, by sum, for an answer over several records; only those whose terms have
    no parameters beside coefficients.
    """

    name: str
    grade: str
    sentence: str
    decided: bool = False
    damping: str = ""
    probability: float = float("nan")
    probabilities: Mapping[str, float] = field(default_factory=dict)
    terms: Mapping[str, float] = field(default_factory=dict)
    frequency: float | None = None
    rate: Estimated | None = None
    quality_factor: Estimated | None = None
    at: tuple[AtAmplitude, ...] = ()
    energy: Mapping[str, Range] = field(default_factory=dict)
    exponent: Range | None = None
    power_law: float = float("nan")
    deviation: Range | None = None
    probability_exact: float = float("nan")
    unexplained_pct: float = float("nan")
    noise_pct: float = float("nan")
    coefficients: tuple[Coefficient, ...] = ()
    cut: Cut | None = None
    remarks: tuple[str, ...] = ()
    curve: Curve | None = None
    likelihoods: Mapping[str, RateLikelihood] = field(default_factory=dict)


def estimated(draws: np.ndarray, plain: np.ndarray) -> Estimated:
    """Of draws (n,), and of those by the readings' noise alone."""
    low, middle, high = (float(q) for q in np.nanquantile(draws, [0.025, 0.5, 0.975]))
    sd, noise = float(np.nanstd(draws)), float(np.nanstd(plain))
    noise = min(noise, sd)
    return Estimated(middle, low, high, noise, float(np.sqrt(max(sd * sd - noise * noise, 0.0))))
