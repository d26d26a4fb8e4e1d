"""Compare two answers that must agree: for two runs of one rig, or for the two halves of a record.

Measured records have no known truth, so agreement is what can be tested.
"""

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
"""Least number of periods of a record whose range of amplitudes can be computed."""
AT = (5 / 6, 1 / 2, 1 / 6)
"""Positions at which runs are compared, as fractions of their common range of ln(amplitude)."""
LEAST_RANGE = 1.1
"""Runs are compared only if their common range of amplitudes spans at least this factor."""
POSSIBLE = 0.05
"""Least probability that an answer must give to the sum that the other answer names."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """The agreement of two answers for the same damping.

    Attributes
    ----------
    first, second : str
        Names of the records.
    amplitudes : (n,) array
        Amplitudes in rad at which the answers are compared.
    z : (n,) array
        Standardised differences of the damping ratio at these amplitudes.
    named : tuple of str
        The damping sum of each answer.
    possible : tuple of bool
        Whether the first sum has a probability of 0.05 or more in the second answer, and the second in the first.
    decided : tuple of bool
        Whether each answer names its sum outright.
    """

    first: str
    second: str
    amplitudes: np.ndarray
    z: np.ndarray
    named: tuple[str, str]
    possible: tuple[bool, bool]
    decided: tuple[bool, bool]


def amplitude_range(signal: Signal) -> tuple[float, float]:
    """Return the amplitudes (unit of the record) half a period after its start and half a period before its end.

    Each is the amplitude of a sinusoid with a constant, fitted to one period by least squares. The period is that of
    the largest spectral line. Raises Refusal if the record has fewer than three periods.
    """
    t, y = signal.t, signal.y
    period = 1 / frequency(*even(t, y))
    if t[-1] - t[0] < CYCLES * period:
        raise Refusal(f"the record has fewer than {CYCLES:g} periods")
    return _size(t, y, t[0], period), _size(t, y, t[-1] - period, period)


def _size(t: np.ndarray, y: np.ndarray, begin: float, period: float) -> float:
    """Return the amplitude of a sinusoid with a constant, fitted to the period that starts at `begin`."""
    inside = (t >= begin) & (t <= begin + period)
    phase = 2 * np.pi * (t[inside] - begin) / period
    columns = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(phase)])
    c, s, _ = np.linalg.lstsq(columns, y[inside], rcond=None)[0]
    return float(np.hypot(c, s))


def runs(signals: Sequence[Signal], answering: Answering) -> list[Agreement]:
    """Compare every two runs of one rig, at three amplitudes that are in the range of all runs.

    Each run is answered once. Raises Refusal if the runs have no common amplitudes, or if a run has no answer.
    """
    if len(signals) < 2:
        raise ValueError("at least two runs are needed")
    ranges = np.array([amplitude_range(signal) for signal in signals])
    high, low = ranges[:, 0].min(), ranges[:, 1].max()
    if high < LEAST_RANGE * low:
        raise Refusal(
            f"the runs have no common amplitudes: one run ends at {low:g} rad, another begins at {high:g} rad"
        )
    amplitudes = tuple(float(low * (high / low) ** part) for part in AT)
    answers = [answering(signal, amplitudes) for signal in signals]
    names = [f"{i} {signal.name}" for i, signal in enumerate(signals, 1)]
    return [
        agreement(names[i], answers[i], names[j], answers[j]) for i, j in combinations(range(len(signals)), 2)
    ]


def halves(signal: Signal, answering: Answering) -> Agreement:
    """Compare the two halves of a record at the amplitude between them, the only one that both have.

    Raises Refusal if a half has no answer.
    """
    first, second = split(signal)
    between = float(np.sqrt(amplitude_range(first)[1] * amplitude_range(second)[0]))
    return agreement(first.name, answering(first, (between,)), second.name, answering(second, (between,)))


def split(signal: Signal) -> tuple[Signal, Signal]:
    """Split a record at half of its time; each half begins at t = 0."""
    cut = int(np.searchsorted(signal.t, 0.5 * (signal.t[0] + signal.t[-1])))
    first = replace(signal, t=signal.t[:cut], y=signal.y[:cut], name=f"{signal.name}, first half")
    second = replace(
        signal, t=signal.t[cut:] - signal.t[cut], y=signal.y[cut:], name=f"{signal.name}, second half"
    )
    return first, second


def agreement(first: str, answer: Verdict, second: str, other: Verdict) -> Agreement:
    """Compare two answers at the same amplitudes.

    The standard deviation of a ratio is the width of its interval over 2 · 1.96.

    Parameters
    ----------
    first, second : str
        Names of the records.
    answer, other : Verdict
        The answers for the first and the second record.

    Raises
    ------
    ValueError
        The amplitudes differ.
    """
    amplitudes = np.array([at.amplitude for at in answer.damping_ratio])
    if not np.allclose(amplitudes, [at.amplitude for at in other.damping_ratio], rtol=1e-6):
        raise ValueError(f"the answers for {first} and {second} are at different amplitudes")
    a, b = (np.array([at.value for at in verdict.damping_ratio]) for verdict in (answer, other))
    sd_a, sd_b = (
        np.array([at.high - at.low for at in verdict.damping_ratio]) / (2 * Z) for verdict in (answer, other)
    )
    possible = (
        probability_of(other, answer.damping) >= POSSIBLE,
        probability_of(answer, other.damping) >= POSSIBLE,
    )
    z = (a - b) / np.hypot(sd_a, sd_b)
    decided = bool(answer.decided), bool(other.decided)
    return Agreement(first, second, amplitudes, z, (answer.damping, other.damping), possible, decided)


def mean_square(pairs: Iterable[Agreement]) -> float:
    """Return the mean of z² over pairs and amplitudes.

    Its expected value is 1 if the intervals are right, whether or not the pairs are independent.
    """
    return float(np.mean(np.concatenate([pair.z**2 for pair in pairs])))


def share_possible(pairs: Iterable[Agreement]) -> float:
    """Return how often the likeliest sum of one answer is possible in the other answer."""
    return float(np.mean([pair.possible for pair in pairs]))


def named_possible(pairs: Iterable[Agreement]) -> tuple[int, int]:
    """Count the sums that an answer names outright: how many are possible in the other answer, and all of them."""
    each = [p for pair in pairs for p, sure in zip(pair.possible, pair.decided, strict=True) if sure]
    return sum(each), len(each)


def table(pairs: Iterable[Agreement]) -> pd.DataFrame:
    """Return a row for each pair: names, sums, mean z², largest |z|, and whether each sum is possible and decided."""
    return pd.DataFrame([
        {
            "first": pair.first, "second": pair.second,
            "named_first": pair.named[0], "named_second": pair.named[1],
            "mean_square": float(np.mean(pair.z**2)), "largest": float(np.max(np.abs(pair.z))),
            "first_possible": pair.possible[0], "second_possible": pair.possible[1],
            "first_decided": pair.decided[0], "second_decided": pair.decided[1],
        }
        for pair in pairs
    ])  # fmt: skip
