"""Whether a second verdict confirms the first."""

from dataclasses import replace

from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.specimen import agreement, worst_agreement
from bayesdamp.verdict.thresholds import AGREEMENT_SDS
from bayesdamp.verdict.types import Verdict


def verdict(value: float = 0.02, damping: str = "viscous", decided: bool = True) -> Verdict:
    half = 1.959963984540054e-4
    ratio = DampingRatio(0.1, "rad", value, 1e-4, 0.0, value - half, value + half)
    return replace(Verdict("a", Grade.EXACT, decided, damping, 0.9), damping_ratio=(ratio,))


def test_a_ratio_that_moves_by_half_its_sd_or_more_does_not_confirm() -> None:
    """In standard deviations of the first verdict, also where the second verdict has ten times narrower intervals."""
    assert agreement(verdict(), verdict(0.02 + 0.9 * AGREEMENT_SDS * 1e-4)).confirms
    second = verdict(0.0203)
    narrow = replace(second, damping_ratio=(replace(second.damping_ratio[0], low=0.02028, high=0.02032),))
    for other in (second, narrow):
        result = agreement(verdict(), other)
        assert (result.same, result.confirms) == (True, False)
        assert abs(result.moved - 3.0) < 1e-6


def test_the_worst_amplitude_counts_and_an_interval_may_reach_zero() -> None:
    """Of three amplitudes: the same, one that is three times as wide and reaches 0, and one that moved a little."""
    ratios = tuple(DampingRatio(a, "rad", 0.02, 1e-4, 0.0, 0.01, 0.03) for a in (0.3, 0.1, 0.03))
    first = replace(verdict(), damping_ratio=ratios)
    worst = worst_agreement(first, [(0.02, 0.01, 0.03), (0.02, -0.01, 0.05), (0.021, 0.011, 0.031)])
    assert (worst.amplitude, worst.moved, worst.confirms) == (0.1, 0.0, False)
    assert worst_agreement(first, [(0.02, 0.01, 0.03)] * 3).confirms  # the control
    assert abs(worst.wider - 3.0) < 1e-9
    assert abs(worst_agreement(first, [(0.02, 0.012, 0.022)] * 3).wider - 0.5) < 1e-9
    point = worst_agreement(first, [(0.02, 0.01, 0.03), (0.02, 0.02, 0.02), (0.021, 0.011, 0.031)])
    assert (point.amplitude, point.wider, point.confirms) == (0.1, 0.0, False)
    moved = worst_agreement(first, [(0.02, 0.01, 0.03), (0.02, 0.0101, 0.03), (0.05, 0.04, 0.06)])
    assert (moved.amplitude, moved.confirms) == (0.03, False)
    assert abs(moved.moved - 3 * 1.959963984540054) < 1e-9
    assert agreement(first, replace(first, damping_ratio=())).moved == 0.0


def test_another_damping_or_none_does_not_confirm() -> None:
    assert not agreement(verdict(), verdict(damping="coulomb")).same
    assert not agreement(verdict(), verdict(decided=False)).same
    # The order of a sum's terms is no difference, and two records that decide nothing agree.
    assert agreement(verdict(damping="viscous+coulomb"), verdict(damping="coulomb+viscous")).same
    assert agreement(verdict(decided=False), verdict(damping="coulomb", decided=False)).same
