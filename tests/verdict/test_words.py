"""A verdict in words, in the unit that its record came in."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.units import UNITS
from bayesdamp.verdict.parts import (
    Bound,
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
from bayesdamp.verdict.words import energy_sentences, power_in_words, sentence


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
        found = power_in_words(Interval(*interval))
        assert found == said


def test_an_exponent_near_coulombs_does_not_call_another_law_coulomb() -> None:
    """Control: it does where the damping named is Coulomb friction."""
    for damping in ["eddy", "eddy+viscous", "structural", "viscous+coulomb"]:
        e = Interval(0.07, 0.0, 0.38)
        assert power_in_words(e, damping) == "grows as v^0.07 (0 to 0.38), near the v^0 of Coulomb damping"
        assert power_in_words(e, "coulomb").endswith(", which is Coulomb")
        assert power_in_words(Interval(1.5, 1.3, 1.7), damping) == "grows as v^(1.50 ± 0.20)"


def test_a_share_of_all_is_not_given_an_interval_from_nothing() -> None:
    """Control: a term beside another has its interval."""
    sole = Verdict("rig", Grade.EXACT, True, "viscous", 0.991, energy=(Share("viscous", 1, 0, 1, 0.991),))
    assert energy_sentences(sole) == ("Energy lost: all of it viscous with probability 0.991.",)
    sure = replace(sole, energy=(Share("viscous", 1, 1, 1, 0.999),))
    assert energy_sentences(sure) == ("Energy lost: all of it viscous.",)
    beside = replace(sole, damping="viscous+coulomb", energy=(Share("viscous", 0.84, 0.78, 0.93, 0.991),))
    assert energy_sentences(beside) == ("Energy lost: viscous 84 % (78 to 93).",)


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
    assert energy_sentences(power) == (
        "Energy lost: by power-law (|v|^p) damping with probability 0.78; without it all of it quadratic (drag).",
    )
    behind = replace(power, probability=0.88, rivals=(Rival("power", 0.12),))
    assert energy_sentences(behind) == (
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


def oscillation(frequency: float, ratio: float, first: float, last: float) -> Oscillation:
    return Oscillation(frequency, ratio, ratio - 0.001, ratio + 0.001, first, last, "rad")


@pytest.mark.parametrize(
    ("motion", "modes", "text"),
    [
        (
            MotionKind.BEATS, (oscillation(1.1, 0.01, 0.2, 0.1), oscillation(1.3, 0.02, 0.1, 0.03)),
            "two oscillations beat, at 1.1000 Hz (damping ratio 1.000 %, 0.900 to 1.100) and at 1.3000 Hz (damping "
            "ratio 2.00 %, 1.90 to 2.10), the second with 50 % of the amplitude of the first.",
        ),
        (
            MotionKind.TWO_MODES, (oscillation(1.1, 0.01, 0.2, 0.1), oscillation(3.3, 0.02, 0.01, 0.02)),
            "it contains two modes, at 1.1000 Hz (damping ratio 1.000 %, 0.900 to 1.100) and at 3.3000 Hz (damping "
            "ratio 2.00 %, 1.90 to 2.10), the second with 10 % of the amplitude of the first.",
        ),
        (
            MotionKind.DRIVEN, (oscillation(1.1, 0.01, 0.2, 0.1), oscillation(1.3, 0.0, 0.1, 0.12)),
            "something drives it at 1.3000 Hz with an amplitude of 0.12 rad, in addition to a decay at 1.1000 Hz "
            "(damping ratio 1.000 %, 0.900 to 1.100).",
        ),
        (
            MotionKind.EXCITED, (oscillation(1.1, 0.01, 0.1, 0.4),),
            "at 1.1 Hz its amplitude rises and falls repeatedly between 0.1 and 0.4 rad, as under random forces.",
        ),
    ],
)  # fmt: skip
def test_what_a_record_is_instead_of_a_decay(
    motion: MotionKind, modes: tuple[Oscillation, ...], text: str
) -> None:
    one = Verdict("a", Grade.NO_FREE_DECAY, False, "", math.nan, motion=motion, modes=modes)
    assert sentence(one).startswith(f"Not the free decay of one oscillator: {text}")


def test_how_well_the_law_holds_in_words() -> None:
    cases = [
        (Grade.EXACT, Interval(0.01, 0.0, 0.02), None, "; the law holds within 2 %."),
        (Grade.EXACT, Interval(0.0, 0.0, 0.0001), None, "; the law holds within 0.1 %."),
        (
            Grade.APPROXIMATE, Interval(0.0009, 0.0, 0.04), None,
            "; no deviation from the law is detected (95 %: below 4 %).",
        ),
        (Grade.APPROXIMATE, Interval(0.05, 0.0, 0.1), None, "; the law holds within 5 % (95 %: below 10 %)."),
        (
            Grade.APPROXIMATE, Interval(0.05, 0.0, 0.1), OverLaw(0.2, "rad", 2.0, 1.5, 2.5),
            "; the law holds within 5 % (95 %: below 10 %) but at 0.2 rad, where the damping is 2.00 (1.50 to 2.50) "
            "times the law's.",
        ),
    ]  # fmt: skip
    for grade, deviation, over, text in cases:
        one = Verdict("a", grade, True, "viscous", 0.99, deviation=deviation, over_law=over)
        assert sentence(one).endswith(text)


def test_several_dampings_and_those_that_are_sure() -> None:
    """The likeliest first, also where it is another form; no more than three; two sure terms."""
    shares = tuple(
        Share(t, 0.5, 0.4, 0.6, p) for t, p in (("viscous", 0.97), ("coulomb", 0.96), ("quadratic", 0.9))
    )
    rivals = (Rival("coulomb", 0.2), Rival("power", 0.45), Rival("quadratic", 0.06), Rival("eddy", 0.04))
    one = Verdict("a", Grade.EXACT, False, "viscous", 0.3, rivals, energy=shares)
    assert (
        "; damping power-law (|v|^p) (0.45) or viscous (0.30) or Coulomb (dry friction) (0.20); viscous and Coulomb "
        "(dry friction) are sure" in sentence(one)
    )
    behind = replace(one, probability=0.04, energy=())
    assert "; damping power-law (|v|^p) (0.45) or Coulomb (dry friction) (0.20)." in sentence(behind)


def test_upper_limits_of_other_terms() -> None:
    """Not of those that are likely rivals, or whose energy is stated before; a tiny one is not 0."""
    bounds = (Bound("quadratic", 0.02), Bound("coulomb", 0.3), Bound("any other form", 0.0001))
    one = Verdict(
        "a", Grade.EXACT, True, "viscous", 0.9, (Rival("viscous+coulomb", 0.1),), other_forms=bounds
    )
    assert energy_sentences(one) == (
        "Other damping terms can account for at most (95 %): quadratic (drag) 2 %, any other form 0.1 %.",
    )
    shares = (Share("viscous", 1.0, 0.94, 1.0, 1.0), Share("quadratic", 0.001, 0.0, 0.06, 0.05))
    assert energy_sentences(replace(one, energy=shares)) == (
        "Energy lost: all of it viscous with probability 0.90, quadratic (drag) at most 6 %; or by viscous + Coulomb "
        "(dry friction) damping, with probability 0.10.",
        "Other damping terms can account for at most (95 %): any other form 0.1 %.",
    )


def test_by_what_a_law_misses() -> None:
    """The largest of three, relative to its threshold."""
    ratio = DampingRatio(0.2, "rad", 0.01, 1e-4, 1e-4, 0.0098, 0.0102)
    deviation, restoring = Interval(0.3, 0.2, 0.4), Interval(0.2, 0.01, 0.3)
    one = Verdict("a", Grade.DEVIATES, False, "viscous", 0.9, damping_ratio=(ratio,), unexplained_pct=1.0)
    one = replace(one, deviation=deviation, restoring_deviation=restoring)
    assert sentence(one).endswith("is viscous, from which the damping deviates by 30 % (20 to 40).")
    bent = replace(one, restoring_deviation=replace(restoring, low=0.1))
    assert sentence(bent).endswith("while the restoring force deviates from its law by 20 % (10 to 30).")
    left = replace(one, unexplained_pct=9.0)
    assert sentence(left).endswith("which leaves 9 % of the amplitude unexplained.")
