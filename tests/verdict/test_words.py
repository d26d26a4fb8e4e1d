"""A verdict in words, in the unit that its record came in."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.units import UNITS
from bayesdamp.verdict.parts import (
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    MotionKind,
    Oscillation,
    OverLaw,
    Rival,
    Share,
    quality_of,
)
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import energy_of, loses_like, sentence


def test_a_verdict_in_the_records_own_unit_has_all_its_amplitudes_in_it() -> None:
    ratio = DampingRatio(0.2, "rad", 0.01, 1e-4, 1e-4, 0.0098, 0.0102)
    one = Verdict("rig", Grade.EXACT, True, "viscous", 0.99, damping_ratio=(ratio,))
    one = replace(one, records=10)
    one = replace(one, sentence=sentence(one))
    shown = in_unit(one, UNITS["deg"])
    assert shown.damping_ratio[0].amplitude == pytest.approx(math.degrees(0.2))
    assert (shown.damping_ratio[0].unit, shown.damping_ratio[0].value) == ("deg", 0.01)
    assert "at 11 deg" in shown.sentence
    assert "rad" not in shown.sentence
    assert shown.sentence.startswith("10 records: ")
    for unit in ("rad", "rpm", "mm"):  # a unit of velocity or of another kind changes nothing
        assert in_unit(one, UNITS[unit]) is one


def test_the_exponent_in_words():
    """With ± where the interval is even; a law is named where the interval is narrow and holds it alone."""
    cases = [
        ((1.02, 0.99, 1.05), "grows as v^(1.020 ± 0.030), which is viscous"),
        ((0.01, 0.0, 0.2), "grows as v^0.01 (0 to 0.20), which is Coulomb"),
        ((1.5, 1.3, 1.7), "grows as v^(1.50 ± 0.20)"),
        ((1.0, 0.4, 1.6), "grows as v^(1.00 ± 0.60)"),
    ]
    for interval, said in cases:
        found = loses_like(Interval(*interval))
        assert found == said


def test_an_exponent_near_coulombs_does_not_call_another_law_coulomb() -> None:
    """Control: it does where the damping named is Coulomb friction."""
    for damping in ["eddy", "eddy+viscous", "structural", "viscous+coulomb"]:
        e = Interval(0.07, 0.0, 0.38)
        assert loses_like(e, damping) == "grows as v^0.07 (0 to 0.38), near the v^0 of Coulomb damping"
        assert loses_like(e, "coulomb").endswith(", which is Coulomb")
        assert loses_like(Interval(1.5, 1.3, 1.7), damping) == "grows as v^(1.50 ± 0.20)"


def test_a_share_of_all_is_not_given_an_interval_from_nothing() -> None:
    """Control: a term beside another has its interval."""
    sole = Verdict("rig", Grade.EXACT, True, "viscous", 0.991, energy=(Share("viscous", 1, 0, 1, 0.991),))
    assert energy_of(sole) == ("Energy lost: all of it viscous with probability 0.991.",)
    sure = replace(sole, energy=(Share("viscous", 1, 1, 1, 0.999),))
    assert energy_of(sure) == ("Energy lost: all of it viscous.",)
    beside = replace(sole, damping="viscous+coulomb", energy=(Share("viscous", 0.84, 0.78, 0.93, 0.991),))
    assert energy_of(beside) == ("Energy lost: viscous 84 % (78 to 93).",)


def test_a_frequency_that_was_given_has_no_width() -> None:
    """Negative control: one that was found has."""
    one = Verdict(
        "rig", Grade.EXACT, True, "viscous", 0.99, frequency=Interval(0.71265, 0.71265, 0.71265, "Hz")
    )
    assert "natural frequency 0.71265 Hz (specified)" in sentence(one)
    found = replace(one, frequency=Interval(0.71265, 0.7126, 0.7127, "Hz"))
    assert "given" not in sentence(found)
    assert "0.712650 ± 0.000050 Hz" in sentence(found)


def test_quality_of_what_may_lose_nothing() -> None:
    cases = [
        ((0.01, 0.008, 0.0125), "50 (40 to 62)"),
        ((0.01, 0.0, 0.0125), "50 (above 40)"),
        ((0.0, 0.0, 1e-16), "–"),
        ((-0.01, -0.02, -0.005), "–"),
    ]
    for ratio, said in cases:
        value, low, high = ratio
        assert quality_of(DampingRatio(0.2, "rad", value, 1e-4, 1e-4, low, high)) == said


def test_a_record_of_which_most_is_not_explained_is_said_so_first() -> None:
    """The control is one of which a tenth is not explained: its curve is the answer."""
    ratio = DampingRatio(0.2, "rad", 3e4, 1e-4, 1e-4, 1e3, 5e4)
    one = Verdict("walk", Grade.DEVIATES, False, "viscous", 0.9, damping_ratio=(ratio,), unexplained_pct=67.0)
    assert sentence(one) == (
        "No damping model describes the record: the nearest, viscous damping, leaves 67 % of the amplitude "
        "unexplained."
    )
    assert sentence(replace(one, unexplained_pct=10.0)).startswith("Equivalent damping ratio")


def test_shares_are_not_said_without_the_form_that_is_as_likely() -> None:
    share = Share("quadratic", 1.0, 1.0, 1.0, 0.22)
    power = Verdict(
        "a", Grade.APPROXIMATE, False, "quadratic", 0.22, (Rival("power", 0.78),), energy=(share,)
    )
    assert energy_of(power) == (
        "Energy lost: by power-law (|v|^p) damping with probability 0.78; without it all of it quadratic (drag).",
    )
    behind = replace(power, probability=0.88, rivals=(Rival("power", 0.12),))
    assert energy_of(behind) == (
        "Energy lost: all of it quadratic (drag); or by power-law (|v|^p) damping, with probability 0.12.",
    )


def test_oscillations_that_are_seen_are_in_the_records_unit() -> None:
    mode = Oscillation(1.1, 0.01, 0.009, 0.011, 0.2, 0.1, "rad")
    over, at = OverLaw(0.2, "rad", 2.0, 1.5, 2.5), FrequencyAt(0.2, "rad", 1.1, 1.0, 1.2)
    one = Verdict("a", Grade.NO_FREE_DECAY, False, "", math.nan, motion=MotionKind.GROWING, modes=(mode,))
    shown = in_unit(replace(one, over_law=over, frequency_at=at), UNITS["deg"])
    (shown_mode,) = shown.modes
    assert (shown_mode.first, shown_mode.last) == pytest.approx(np.degrees([0.2, 0.1]))
    assert (shown_mode.unit, shown_mode.frequency, shown_mode.damping_ratio) == ("deg", 1.1, 0.01)
    for part in (shown.over_law, shown.frequency_at):
        assert part is not None
        assert (part.amplitude, part.unit) == (pytest.approx(np.degrees(0.2)), "deg")
    assert "from 11 to 5.7 deg" in shown.sentence


def test_what_stays_loses_no_more_than_its_rate_allows() -> None:
    """A rate below 0 is 0 and its error."""
    cases = [
        ((1e-4, 5e-5, 1.5e-4), "damping ratio is below 0.015 % (95 %), Q above 3,300."),
        ((-1e-4, -1.5e-4, -5e-5), "damping ratio is below 0.005 % (95 %), Q above 10,000."),
    ]
    for ratio, said in cases:
        mode = Oscillation(1.1, *ratio, 0.2, 0.2, "rad")
        one = Verdict("a", Grade.NO_FREE_DECAY, False, "", math.nan, motion=MotionKind.STEADY, modes=(mode,))
        assert sentence(one).endswith(said)
