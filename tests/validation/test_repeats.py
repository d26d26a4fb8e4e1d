"""Repeats of one rig agree where the intervals are right, and not where they are too narrow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.parts import Grade, Rival
from bayesdamp.verdict.types import Verdict
from tests.validation.answering import ratio_at
from validation.measured.agreement import Answering, agreement, amplitude_range, halves, runs, summary


def decay(first: float = 0.3, seconds: float = 20.0, noise: float = 0.003, seed: int = 0) -> Signal:
    t = np.linspace(0.0, seconds, 1500)
    y = 0.5 + first * np.exp(-0.1 * t) * np.cos(7.0 * t + seed)
    return Signal(t, y + noise * np.random.default_rng(seed).standard_normal(t.size), name="rig")


def honest(rng: np.random.Generator, sure: float = 1.0) -> Answering:
    """Answers whose damping ratio is off by what their intervals say, or more, where they are too sure."""

    def answering(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        sd = float(rng.uniform(0.5, 2.0)) * 1e-4
        half = 1.96 * sd / sure
        ratios = tuple(ratio_at(a, 0.1 / 7.0 + sd * rng.standard_normal(), half) for a in amplitudes)
        return Verdict(signal.name, Grade.EXACT, True, "viscous", 0.9, damping_ratio=ratios)

    return answering


@pytest.mark.parametrize("sure", [1.0, 3.0])
def test_differences_are_as_large_as_the_intervals_say(sure: float) -> None:
    """Records apart: 300 z² of mean 1 (or 9) and sd √2 of it; within 5 sd of their mean."""
    rng = np.random.default_rng(1)
    pairs = pd.concat([runs([decay(seed=1), decay(seed=2)], honest(rng, sure)) for _ in range(100)])
    assert pairs["mean_square"].mean() == pytest.approx(sure**2, rel=5 * np.sqrt(2 / 300))
    assert (pairs["largest"] ** 2 >= pairs["mean_square"]).all()


def test_all_pairs_of_runs_are_compared_at_common_amplitudes() -> None:
    signals, asked = [decay(0.3), decay(0.2), decay(0.4, 15.0)], []
    answering = honest(np.random.default_rng(2))

    def noted(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        asked.append(amplitudes)
        return answering(signal, amplitudes)

    pairs = runs(signals, noted)
    assert len(asked) == 3  # each run is answered once
    assert len(set(asked)) == 1
    assert 0.4 * np.exp(-1.5) < asked[0][-1] < asked[0][0] < 0.2
    assert list(pairs["first"]) == ["1 rig", "1 rig", "2 rig"]
    with pytest.raises(Refusal, match="no common amplitudes"):
        runs([decay(0.3), decay(0.01)], honest(np.random.default_rng(2)))


def test_halves_are_compared_at_the_amplitude_between_them() -> None:
    signals, asked = [], []
    answering = honest(np.random.default_rng(2))

    def noted(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        signals.append(signal)
        asked.append(amplitudes)
        return answering(signal, amplitudes)

    (pair,) = halves(decay(), noted).to_dict("records")
    assert (pair["first"], pair["second"]) == ("rig, first half", "rig, second half")
    assert asked[0] == asked[1] == (pytest.approx(0.3 * np.exp(-1.0), rel=0.05),)
    assert [signal.t[0] for signal in signals] == [0.0, 0.0]
    assert sum(signal.t.size for signal in signals) == decay().t.size
    with pytest.raises(Refusal, match="fewer than 3 periods"):
        amplitude_range(decay(seconds=2.0))


def test_a_sum_that_the_other_half_rules_out_is_seen() -> None:
    ratio = (ratio_at(0.1, 0.01, 0.001),)
    two = Rival("coulomb", 0.03), Rival("quadratic", 0.03)
    one = Verdict("a", Grade.EXACT, True, "viscous", 0.94, two, damping_ratio=ratio)
    other = Verdict("b", Grade.EXACT, False, "coulomb", 0.6, (Rival("viscous", 0.4),), damping_ratio=ratio)
    pair = agreement("a", one, "b", other)
    assert (pair["first_possible"], pair["second_possible"]) == (True, False)
    assert pair["mean_square"] == 0.0
    for pairs, words in (
        ([pair, agreement("a", one, "a", one)], "other answer allows 0.75, of those named outright 3 of 3"),
        ([pair, agreement("a", other, "b", one)], "named outright 2 of 2"),
        ([agreement("b", replace(other, decided=True), "a", one)], "named outright 1 of 2"),
    ):
        assert words in summary(pd.DataFrame(pairs))
    with pytest.raises(AssertionError, match="amplitudes of a and b"):
        agreement("a", one, "b", replace(other, damping_ratio=(ratio_at(0.2, 0.01, 0.001),)))
