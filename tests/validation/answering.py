"""Records and answers that are written by hand."""

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from bayesdamp.types import Signal
from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.types import Verdict
from tests.physics.independent import viscous
from validation.scoring import Peer
from validation.truth.oscillator import SUMS
from validation.truth.records import Case

AMPLITUDES = (0.3, 0.2, 0.1)


def a_case(number: int, group: str = "family") -> Case:
    """Return a record whose true damping ratio is 0.02 at all amplitudes."""
    signal = Signal(np.arange(3.0), np.zeros(3))
    name = f"{group}-{number}"
    return Case(name, group, signal, SUMS[number % 7], ratio=lambda _: 0.02, amplitudes=AMPLITUDES)


def peer_of(
    case: Case,
    rng: np.random.Generator,
    *,
    right: bool = True,
    sure: float = 1.0,
    grade: str = "exact",
    decided: bool = True,
) -> Peer:
    """Return a peer whose intervals are narrower by `sure` than those that contain the truth with 95 % probability."""
    sd = 0.001
    values = 0.02 + sd * rng.standard_normal(3)
    half = 1.96 * sd / sure
    named = case.damping if right else next(s for s in SUMS if s != case.damping)
    verdict = replace(verdict_of(values, values - half, values + half), damping=named, probability=0.98)
    return lambda signal, amplitudes: replace(verdict, decided=decided, grade=Grade(grade))


def verdict_of(values: Iterable[float], low: Iterable[float] = (), high: Iterable[float] = ()) -> Verdict:
    """Return a verdict that names no damping, with these damping ratios at `AMPLITUDES`, and NaN for missing ends."""
    rows = zip_longest(AMPLITUDES, values, low, high, fillvalue=math.nan)
    ratios = tuple(DampingRatio(a, "rad", v, 0.0, 0.0, start, end) for a, v, start, end in rows if v == v)
    return Verdict("a", Grade.EXACT, False, "", math.nan, damping_ratio=ratios)


def closed_form(ratio: float = 0.02, noise: float = 0.0, cycles: float = 20.0) -> Case:
    """Return a decay of a linear viscous oscillator of 1 Hz, released at rest 0.5 rad from its equilibrium at 0.3 rad.

    Parameters
    ----------
    ratio : float
        Damping ratio.
    noise : float
        Standard deviation of the noise, rad.
    cycles : float
        Length of the record in cycles.
    """
    t = np.arange(0.0, cycles, 0.02)
    omega = 2 * np.pi
    y = 0.3 + viscous(t, ratio * omega, omega, 0.5) + noise * np.random.default_rng(0).standard_normal(t.size)
    amplitudes = tuple(0.5 * float(np.exp(-ratio * omega * x * cycles)) for x in (0.1, 0.5, 0.8))
    return Case(
        "closed-form", "closed form", Signal(t, y), "viscous", ratio=lambda _: ratio, amplitudes=amplitudes
    )
