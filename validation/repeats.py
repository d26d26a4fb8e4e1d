"""Measured records have no known truth, but two answers for one rig, or for two halves of a record, must agree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pandas as pd

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.answers import Answering, probability_of
from validation.contest.peers.shared import even, frequency
from validation.scoring import Z

CYCLES = 3.0
"""Least number of periods from which a range of amplitudes is computed."""
AT = (5 / 6, 1 / 2, 1 / 6)
"""Where in the logarithm of their common range of amplitudes runs are compared."""
LEAST_RANGE = 1.1
"""Runs whose common amplitudes span less than this factor are not compared."""
POSSIBLE = 0.05
"""A sum that one answer names must have this probability in the other."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Of two answers for what should be one damping.

    first, second: names of the records. amplitudes: rad, at which they are compared. z: standardised differences of the
    damping ratio there, the same shape. named: the two damping sums. possible: whether the first's sum has a
    probability of 0.05 or more in the second answer, and the second's in the first. decided: whether each is named
    outright.
    """

    first: str
    second: str
    amplitudes: np.ndarray
    z: np.ndarray
    named: tuple[str, str]
    possible: tuple[bool, bool]
    decided: tuple[bool, bool]


def amplitude_range(signal: Signal) -> tuple[float, float]:
    """Return the amplitudes (unit of the record) half a period within its start and its end.

    Each is that of a sinusoid and a constant fitted to one period by least squares; the period is where the spectrum
    is largest. Raises Refusal on fewer than three periods.
    """
    t, y = signal.t, signal.y
    period = 1 / frequency(*even(t, y))
    if t[-1] - t[0] < CYCLES * period:
        raise Refusal(f"the record has fewer than {CYCLES:g} periods")
    return _size(t, y, t[0], period), _size(t, y, t[-1] - period, period)


def _size(t: np.ndarray, y: np.ndarray, begin: float, period: float) -> float:
    inside = (t >= begin) & (t <= begin + period)
    phase = 2 * np.pi * (t[inside] - begin) / period
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    c, s, _ = np.linalg.lstsq(columns, y[inside], rcond=None)[0]
    return float(np.hypot(c, s))


def runs(signals: Sequence[Signal], answering: Answering) -> list[Agreement]:
    """Every two runs of one rig, at three amplitudes that all of them pass.

    Each run is answered once. Raises Refusal where there are no common amplitudes, or no answer.
    """
    if len(signals) < 2:
        raise ValueError("one run has nothing to agree with")
    ranges = np.array([amplitude_range(signal) for signal in signals])
    high, low = ranges[:, 0].min(), ranges[:, 1].max()
    if high < LEAST_RANGE * low:
        raise Refusal(
            f"the runs have no common amplitudes: one ends at {low:g} rad, one begins at {high:g} rad"
        )
    amplitudes = tuple(float(low * (high / low) ** part) for part in AT)
    answers = [answering(signal, amplitudes) for signal in signals]
    names = [f"{i} {signal.name}" for i, signal in enumerate(signals, 1)]
    return [
        agreement(names[i], answers[i], names[j], answers[j]) for i, j in combinations(range(len(signals)), 2)
    ]


def halves(signal: Signal, answering: Answering) -> Agreement:
    """The first and the second half of a record, at the amplitude between them: the only one that both have.

    Raises Refusal where there is no answer for a half.
    """
    first, second = split(signal)
    between = float(np.sqrt(amplitude_range(first)[1] * amplitude_range(second)[0]))
    return agreement(first.name, answering(first, (between,)), second.name, answering(second, (between,)))


def split(signal: Signal) -> tuple[Signal, Signal]:
    """The halves of a record, by time, each from t = 0 on."""
    cut = int(np.searchsorted(signal.t, 0.5 * (signal.t[0] + signal.t[-1])))
    first = replace(signal, t=signal.t[:cut], y=signal.y[:cut], name=f"{signal.name}, first half")
    second = replace(
        signal, t=signal.t[cut:] - signal.t[cut], y=signal.y[cut:], name=f"{signal.name}, second half"
    )
    return first, second


def agreement(first: str, one: Verdict, second: str, other: Verdict) -> Agreement:
    """Two answers at the same amplitudes. The sd of a ratio is the width of its interval over 2 · 1.96."""
    amplitudes = np.array([at.amplitude for at in one.damping_ratio])
    if not np.allclose(amplitudes, [at.amplitude for at in other.damping_ratio], rtol=1e-6):
        raise ValueError(f"{first} and {second} are answered at different amplitudes")
    a, b = (np.array([at.value for at in answer.damping_ratio]) for answer in (one, other))
    sd_a, sd_b = (
        np.array([at.high - at.low for at in answer.damping_ratio]) / (2 * Z) for answer in (one, other)
    )
    possible = (
        probability_of(other, one.damping) >= POSSIBLE,
        probability_of(one, other.damping) >= POSSIBLE,
    )
    z = (a - b) / np.hypot(sd_a, sd_b)
    decided = bool(one.decided), bool(other.decided)
    return Agreement(first, second, amplitudes, z, (one.damping, other.damping), possible, decided)


def mean_square(found: Iterable[Agreement]) -> float:
    """Mean of z² over pairs and amplitudes: 1 where the intervals are right, whether or not pairs are independent."""
    return float(np.mean(np.concatenate([one.z**2 for one in found])))


def share_possible(found: Iterable[Agreement]) -> float:
    """How often the likeliest sum of one answer is not ruled out by the other."""
    return float(np.mean([one.possible for one in found]))


def named_possible(found: Iterable[Agreement]) -> tuple[int, int]:
    """Of the sums that an answer names outright: how many the other does not rule out, and how many there are."""
    each = [p for one in found for p, sure in zip(one.possible, one.decided, strict=True) if sure]
    return sum(each), len(each)


def table(found: Iterable[Agreement]) -> pd.DataFrame:
    """A line a pair: names, sums, mean z², largest |z|, and whether each sum is possible in the other answer."""
    return pd.DataFrame([
        {
            "first": one.first, "second": one.second, "named_first": one.named[0], "named_second": one.named[1],
            "mean_square": float(np.mean(one.z**2)), "largest": float(np.max(np.abs(one.z))),
            "first_possible": one.possible[0], "second_possible": one.possible[1],
            "first_decided": one.decided[0], "second_decided": one.decided[1],
        }
        for one in found
    ])  # fmt: skip
