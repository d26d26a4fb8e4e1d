"""A verdict in words, in the unit that its record came in."""

import math
from dataclasses import replace

import pytest

from bayesdamp.types import UNITS
from bayesdamp.verdict.parts import (
    Bound,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    MeasuredNumber,
    MotionKind,
    Oscillation,
    OverLaw,
    Rival,
    Share,
    UsedWindow,
    quality_of,
)
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import energy_sentences, power_in_words, sentence

SURE = Verdict("rig", Grade.EXACT, True, "viscous", 0.99)
ABOUT = replace(SURE, grade=Grade.APPROXIMATE)
OPEN = replace(SURE, decided=False, probability=0.3)
DECLINED = Verdict("a", Grade.NO_FREE_DECAY, False, "", math.nan)
RATIO = DampingRatio(0.2, "rad", 0.01, 1e-4, 1e-4, 0.0098, 0.0102)
OVER = OverLaw(0.2, "rad", 2.0, 1.5, 2.5)
MISFIT = replace(
    SURE, grade=Grade.DEVIATES, decided=False, damping_ratio=(RATIO,), unexplained_pct=1.0,
    deviation=Interval(0.3, 0.2, 0.4), restoring_deviation=Interval(0.2, 0.01, 0.3),
)  # fmt: skip


def test_a_verdict_converts_all_amplitudes_to_the_unit_of_the_record() -> None:
    at, eleven = FrequencyAt(0.2, "rad", 1.1, 1.0, 1.2), pytest.approx(math.degrees(0.2))
    verdict = replace(SURE, damping_ratio=(RATIO,), records=10, over_law=OVER, frequency_at=at)
    shown = in_unit(verdict, UNITS["deg"])
    assert shown.damping_ratio == (replace(RATIO, amplitude=eleven, unit="deg"),)
    assert shown.over_law == replace(OVER, amplitude=eleven, unit="deg")
    assert shown.frequency_at == replace(at, amplitude=eleven, unit="deg")
    assert "at 11 deg" in shown.sentence
    assert "rad" not in shown.sentence
    assert shown.sentence.startswith("10 records: ")
    for unit in ("rad", "rpm", "mm"):  # a unit of velocity or of another kind changes nothing
        assert in_unit(verdict, UNITS[unit]) is verdict
    mode = Oscillation(1.1, 0.01, 0.009, 0.011, 0.2, 0.1, "rad")
    grows = in_unit(replace(DECLINED, motion=MotionKind.GROWING, modes=(mode,)), UNITS["deg"])
    assert grows.modes == (replace(mode, first=eleven, last=pytest.approx(math.degrees(0.1)), unit="deg"),)
    assert "from 11 to 5.7 deg" in grows.sentence


NEAR_COULOMB = (0.07, 0.0, 0.38)


@pytest.mark.parametrize(
    ("interval", "damping", "text"),
    [
        ((1.02, 0.99, 1.05), "", "grows as v^(1.020 ± 0.030), which is viscous"),
        ((0.01, 0.0, 0.2), "", "grows as v^0.01 (0 to 0.20), which is Coulomb"),
        ((1.5, 1.3, 1.7), "eddy", "grows as v^(1.50 ± 0.20)"),
        ((1.0, 0.4, 1.6), "", "grows as v^(1.00 ± 0.60)"),
        (NEAR_COULOMB, "eddy+viscous", "grows as v^0.07 (0 to 0.38), near the v^0 of Coulomb damping"),
        (NEAR_COULOMB, "viscous+coulomb", "grows as v^0.07 (0 to 0.38), near the v^0 of Coulomb damping"),
        (NEAR_COULOMB, "coulomb", "grows as v^0.07 (0 to 0.38), which is Coulomb"),
    ],
)
def test_the_exponent_in_words(interval: tuple[float, ...], damping: str, text: str) -> None:
    """A symmetric interval has ±. A law is named if a narrow interval contains its exponent alone.

    Coulomb's law is named only if the verdict names no other damping."""
    assert power_in_words(Interval(*interval), damping) == text


@pytest.mark.parametrize(
    ("ratio", "text"),
    [
        ((0.01, 0.008, 0.0125), "50 (40 to 62)"),
        ((0.01, 0.0, 0.0123), "50 (above 40.7)"),
        ((0.0, 0.0, 1e-16), "–"),
        ((-0.01, -0.02, -0.005), "–"),
    ],
)
def test_the_quality_factor_of_a_ratio_that_may_be_zero(ratio: tuple[float, float, float], text: str) -> None:
    assert quality_of(DampingRatio(0.2, "rad", ratio[0], 1e-4, 1e-4, *ratio[1:])) == text


VISCOUS, DRAG = Share("viscous", 1.0, 0.0, 1.0, 0.991), Share("quadratic", 1.0, 1.0, 1.0, 0.22)
POWER = replace(ABOUT, damping="quadratic", probability=0.22, rivals=(Rival("power", 0.78),), energy=(DRAG,))
BOUNDS = (Bound("quadratic", 0.02), Bound("coulomb", 0.3), Bound("any other form", 0.0001))
BEATEN = replace(SURE, probability=0.9, rivals=(Rival("viscous+coulomb", 0.1),), other_forms=BOUNDS)
LIMITS = "Of the energy lost, each of these other damping terms can account for at most (95 %): "


@pytest.mark.parametrize(
    ("verdict", "sentences"),
    [
        # A term that alone takes all the energy has no interval; each term of a sum has one.
        (replace(SURE, energy=(VISCOUS,)), ["Energy lost: all of it viscous with probability 0.99."]),
        (replace(SURE, energy=(replace(VISCOUS, low=1.0),)), ["Energy lost: all of it viscous."]),
        # A twin that loses as much at every amplitude, and is not excluded, may be the cause instead.
        (
            replace(SURE, energy=(replace(VISCOUS, low=1.0),), other_forms=(Bound("structural", 0.95),)),
            ["Energy lost: all of it viscous or structural (rate independent)."],
        ),
        # A fraction that is rounded to 0 % is an upper limit.
        (
            replace(SURE, energy=(Share("viscous", 0.84, 0.78, 0.93, 1.0), Share("coulomb", 0.006, 0.0, 0.06, 0.5))),
            ["Energy lost: viscous 84 % (78 to 93), Coulomb (dry friction) 1 % (0 to 6)."],
        ),
        # Another form that is as probable is named too.
        (
            POWER,
            ["Energy lost: by power-law (|v|^p) damping with probability 0.78; without it all of it quadratic (drag)."],
        ),
        (
            replace(POWER, probability=0.88, rivals=(Rival("power", 0.12),)),
            ["Energy lost: all of it quadratic (drag); or by power-law (|v|^p) damping, with probability 0.12."],
        ),
        # No limits of probable rivals or of terms whose energy is already stated; a tiny limit is not shown as 0.
        (BEATEN, [LIMITS + "quadratic (drag) 2 %, any other form 0.1 %."]),
        (
            replace(BEATEN, energy=(replace(VISCOUS, low=0.94), Share("quadratic", 0.003, 0.0, 0.06, 0.05))),
            [
                "Energy lost: all of it viscous with probability 0.90, quadratic (drag) at most 6 %; or by viscous + "
                "Coulomb (dry friction) damping, with probability 0.10.",
                LIMITS + "any other form 0.1 %.",
            ],
        ),
    ],
)  # fmt: skip
def test_energy_in_words(verdict: Verdict, sentences: list[str]) -> None:
    assert list(energy_sentences(verdict)) == sentences


def declined(motion: MotionKind, *modes: tuple[float, float, float, float]) -> Verdict:
    """Return the verdict on another motion; modes: frequency, damping ratio, first and last amplitude of each."""
    each = [Oscillation(f, r, r - 0.001, r + 0.001, a, b, "rad") for f, r, a, b in modes]
    return replace(DECLINED, motion=motion, modes=tuple(each))


def steady(*ratio: float) -> Verdict:
    mode, window = Oscillation(1.1, *ratio, 0.2, 0.2, "rad"), UsedWindow(0.0, 30.0, 33.0, "")
    return replace(DECLINED, motion=MotionKind.STEADY, modes=(mode,), window=window)


SLOW, FAST = "1.1000 Hz (damping ratio 1.000 %, 0.900 to 1.100)", "(damping ratio 2.00 %, 1.90 to 2.10)"
FORMS = (Rival("coulomb", 0.2), Rival("power", 0.45), Rival("quadratic", 0.06), Rival("eddy", 0.04))
SHARES = tuple(
    Share(n, 0.5, 0.4, 0.6, p) for n, p in (("viscous", 0.97), ("coulomb", 0.96), ("quadratic", 0.9))
)
DEVIATES = Interval(0.05, 0.0, 0.1)


@pytest.mark.parametrize(
    ("verdict", "text"),
    [
        (
            replace(SURE, frequency=Interval(0.71265, 0.71265, 0.71265, "Hz")),
            "natural frequency 0.71265 Hz (specified)",
        ),
        # If most of a record is not explained, the sentence begins with that; if a tenth, with the damping ratio.
        (
            replace(MISFIT, unexplained_pct=67.0),
            "^No damping model describes the record: the nearest, viscous damping, leaves 67 % of the amplitude "
            "unexplained.",
        ),
        (replace(MISFIT, unexplained_pct=10.0), "^Equivalent damping ratio"),
        # The largest of three misfits, relative to their thresholds.
        (MISFIT, "is viscous, from which the damping deviates by 30 % (20 to 40)."),
        (
            replace(MISFIT, restoring_deviation=Interval(0.2, 0.1, 0.3)),
            "while the frequency deviates from that of the law by 20 % (10 to 30).",
        ),
        (replace(MISFIT, unexplained_pct=9.0), "which leaves 9 % of the amplitude unexplained."),
        # A steady oscillation has an upper limit of its damping; a negative ratio counts as 0.
        (steady(-1e-4, -1.5e-4, -5e-5), "damping ratio is below 0.005 % (95 %), Q above 10,000."),
        (steady(0.0, 0.0, 0.0), " of 0.2 rad over 33 cycles"),
        (replace(SURE, rate=MeasuredNumber(0.21, 0.01, 0.01, 0.185, 0.215, "1/s")), "0.210 1/s (0.185 to 0.215)"),
        # Records that are not the free decay of one oscillator.
        (
            declined(MotionKind.TWO_MODES, (1.1, 0.01, 0.2, 0.1), (3.3, 0.02, 0.01, 0.02)),
            f"^Not the free decay of one oscillator: it contains two modes, at {SLOW} and at 3.3000 Hz {FAST}, the "
            "second with 10 % of the amplitude of the first.",
        ),
        (
            declined(MotionKind.DRIVEN, (1.1, 0.01, 0.2, 0.1), (1.3, 0.0, 0.1, 0.12)),
            "^Not the free decay of one oscillator: something drives it at 1.3000 Hz with an amplitude of 0.12 rad, in "
            f"addition to a decay at {SLOW}.",
        ),
        (
            declined(MotionKind.EXCITED, (1.1, 0.01, 0.1, 0.4)),
            "^Not the free decay of one oscillator: at 1.1 Hz its amplitude rises and falls repeatedly between 0.1 and "
            "0.4 rad, as under random forces.",
        ),
        # How well the law holds.
        (replace(SURE, deviation=Interval(0.0, 0.0, 0.0001)), "; the law holds within 0.1 %."),
        (
            replace(ABOUT, deviation=Interval(0.0009, 0.0, 0.04)),
            "; no deviation from the law is detected (95 %: below 4 %).",
        ),
        (replace(ABOUT, deviation=DEVIATES), "; the law holds within 5 % (95 %: below 10 %)."),
        (replace(ABOUT, deviation=DEVIATES, over_law=OVER), "the damping is 2.00 (1.50 to 2.50) times the law's."),
        # At most three dampings, the most probable first, also if it is another form; two certain terms.
        (
            replace(OPEN, rivals=FORMS, energy=SHARES),
            "; damping power-law (|v|^p) (0.45) or viscous (0.30) or Coulomb (dry friction) (0.20); among "
            "the compared models it surely contains viscous and Coulomb (dry friction) damping",
        ),
        (
            replace(OPEN, probability=0.04, rivals=FORMS),
            "; damping power-law (|v|^p) (0.45) or Coulomb (dry friction) (0.20).",
        ),
    ],
)  # fmt: skip
def test_a_verdict_in_words(verdict: Verdict, text: str) -> None:
    """A text with ^ begins the sentence; another text with a full stop ends it; any other is somewhere in it."""
    shown = sentence(verdict)
    assert shown.startswith(text[1:]) if text.startswith("^") else text in shown
    assert shown.endswith(text) or not text.endswith(".") or text.startswith("^")


def test_a_steady_oscillation_without_any_width_has_no_limit_of_q() -> None:
    """Control: a limit of 0.1 % is a Q of 500."""
    texts = [sentence(steady(0.0, -width, width)) for width in (0.0, 0.001)]
    assert ["damping ratio is below" in text for text in texts] == [True, True]
    assert ["Q above 500" in text for text in texts] == [False, True]
