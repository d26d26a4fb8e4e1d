"""A verdict is a pure function of the findings: grade, whether a damping is named, and the facts of the sentence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np
import pytest

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.findings import Findings, Quantity
from bayesdamp.types import NORMAL_95, LawFreeDamping, Ratio
from bayesdamp.verdict import Verdict, thresholds
from bayesdamp.verdict.decide import decide
from bayesdamp.verdict.parts import Averages, DampingRatio, FrequencyAt, Grade, OverLaw, UsedWindow

TINY = 1e-6
HERTZ = Quantity(0.7118, 0.7117, 0.7119)
FINDINGS: dict[str, object] = {
    "damping": {"viscous": 0.97, "viscous+coulomb": 0.03},
    "damping_if_exact": {"viscous": 0.98, "viscous+coulomb": 0.02},
    "restoring": {"linear": 0.8, "pendulum": 0.2},
    "term": {"viscous": 1.0, "coulomb": 0.03, "quadratic": 0.01},
    "ratios": (
        Ratio(0.3, 0.0101, 0.0099, 0.0103, 1e-5, 1e-4),
        Ratio(0.1, 0.0102, 0.0100, 0.0104, 1e-5, 1e-4),
        Ratio(0.03, 0.0103, 0.0100, 0.0106, 1e-5, 1e-4),
    ),
    "curve": (),
    "other_forms": {},
    "exponent": None,
    "frequency": HERTZ,
    "energy": {
        "viscous": Quantity(0.99, 0.95, 1.0), "coulomb": Quantity(0.0, 0.0, 0.04),
        "quadratic": Quantity(0.0, 0.0, 0.01),
    },
    "bound": {"viscous": 1.0, "coulomb": 0.05, "quadratic": 0.02},
    "deviation": Quantity(0.01, 0.0, 0.02),
    "restoring_deviation": Quantity(0.001, 0.0, 0.003),
    "other": 0.02,
    "coefficients": {"zeta": Quantity(0.045, 0.044, 0.046, 1e-4, 4e-4)},
    "best": MotionCandidate(("viscous",), "linear"),
    "unexplained": 0.001,
    "noise": 0.004,
    "amplitudes": (0.31, 0.028),
    "cycles": 30.0,
}  # fmt: skip
"""Viscous damping that is decided, with laws that hold."""


def cycles_of(fall: float) -> float:
    """Return the number of cycles in which the amplitude falls by a fraction, with the damping ratio of FINDINGS."""
    return -math.log(1 - fall) / (2 * math.pi * 0.0102)


def verdict_of(**given: object) -> Verdict:
    """Decide with these changes of FINDINGS; what is not a finding is an option of `decide`."""
    changed = {f.name: given.pop(f.name) for f in fields(Findings) if f.name in given}
    return decide(Findings(**(FINDINGS | changed)), record="rig", **given)


@pytest.mark.parametrize(
    ("changed", "grade"),
    [
        ({"deviation": Quantity(0.01, 0.0, thresholds.EXACT)}, Grade.EXACT),
        ({"deviation": Quantity(0.01, 0.0, thresholds.EXACT + TINY)}, Grade.APPROXIMATE),
        ({"deviation": Quantity(thresholds.DEVIATES, 0.1, 0.6)}, Grade.APPROXIMATE),
        ({"deviation": Quantity(thresholds.DEVIATES + TINY, 0.1, 0.6)}, Grade.DEVIATES),
        ({"restoring_deviation": Quantity(0.06, thresholds.RESTORING_DEVIATES, 0.1)}, Grade.EXACT),
        ({"restoring_deviation": Quantity(0.06, thresholds.RESTORING_DEVIATES + TINY, 0.1)}, Grade.DEVIATES),
        ({"unexplained": thresholds.UNEXPLAINED}, Grade.EXACT),
        ({"unexplained": thresholds.UNEXPLAINED + TINY}, Grade.DEVIATES),
    ],
)
def test_grades_change_at_their_thresholds(changed: Mapping[str, object], grade: Grade) -> None:
    verdict = verdict_of(**changed)
    deviates = grade is Grade.DEVIATES
    assert (verdict.grade, verdict.decided) == (grade, not deviates)
    assert ("the nearest law of damping is" in verdict.sentence.lower()) is deviates


def test_under_exact_laws_the_grade_is_exact() -> None:
    verdict = verdict_of(deviation=Quantity(0.5, 0.4, 0.6), approximate=False)
    assert (verdict.grade, verdict.deviation) == (Grade.EXACT, None)
    assert "holds within" not in verdict.sentence
    assert "any other form" not in {b.form for b in verdict.other_forms}


@pytest.mark.parametrize(
    ("p", "p_if_exact", "decided"),
    [
        (thresholds.DECIDED, thresholds.DECIDED, True), (thresholds.DECIDED - TINY, thresholds.DECIDED, False),
        (0.9999, 0.4, False), (0.9999, 0.6, True),
    ],
)  # fmt: skip
def test_a_damping_is_named_if_it_is_probable_enough_and_first_under_exact_laws_too(
    p: float, p_if_exact: float, decided: bool
) -> None:
    exact = {"viscous": p_if_exact, "coulomb": 1 - p_if_exact}
    by_probability = dict(sorted(exact.items(), key=lambda item: -item[1]))
    verdict = verdict_of(damping={"viscous": p, "coulomb": 1 - p}, damping_if_exact=by_probability)
    assert (verdict.damping, verdict.decided) == ("viscous", decided)
    assert verdict.sentence.startswith("Viscous damping") is decided
    assert any("would be the most probable" in remark for remark in verdict.remarks) is (p_if_exact < 0.5)


def test_probabilities_of_measured_records_are_capped() -> None:
    for measured, approximate, cap in [(True, True, thresholds.CAP), (False, True, 1), (True, False, 1)]:
        for p in (0.99999, thresholds.CAP - 0.01):
            damping = {"viscous": p, "coulomb": 1 - p}
            verdict = verdict_of(damping=damping, measured=measured, approximate=approximate)
            assert verdict.probability == min(p, cap)
            other = verdict_of(other_forms={"power": p}, measured=measured, approximate=approximate)
            assert other.rivals[0].probability == min(p, cap)
            assert ("> 0.999" in verdict.sentence) is (verdict.probability > 0.999)


OPEN = {"viscous": 0.9 - thresholds.NAMED, "coulomb": 0.1, "quadratic": thresholds.NAMED}
BOTH = {"viscous+coulomb": 0.6, "viscous": 0.4}
BENT = {"restoring": {"duffing": 1.0}, "restoring_deviation": Quantity(0.01, 0.0021, 0.02)}
SURE = {"viscous": thresholds.TERM_SURE, "coulomb": 0.6, "quadratic": 0.0}


@pytest.mark.parametrize(
    ("changed", "control", "text"),
    [
        (
            {"damping": OPEN, "damping_if_exact": OPEN}, {"damping": OPEN | {"quadratic": thresholds.NAMED - TINY}},
            "quadratic",
        ),
        (
            {"damping": BOTH, "damping_if_exact": BOTH, "term": SURE}, {"term": {**SURE, "viscous": 0.9}},
            "; among the compared models it surely contains viscous damping",
        ),
        ({"damping": OPEN, "damping_if_exact": OPEN}, BENT, "; the law holds"),
        ({"unexplained": thresholds.REMARK}, {"unexplained": thresholds.REMARK - TINY}, "explained neither by"),
        ({"midline": -0.0123}, {"midline": 0.5 * thresholds.MIDLINE}, "The midline drifts by 1.2 % of the first"),
        (BENT, {"restoring_deviation": Quantity(0.01, 0.0019, 0.02)}, ", by 1 % (0.21 to 2). Check unit and scale"),
        (BENT, {"restoring": {"linear": 1.0}}, "Equivalent damping ratio"),  # no damping is named
        ({"cycles": cycles_of(0.29)}, {"cycles": cycles_of(0.31)}, "hard to distinguish"),
        ({"undetermined": ("rest_angle",)}, {"undetermined": ()}, "rest angle; its interval is just the prior"),
        (
            {"inseparable": (("zeta", "mu_q"),)}, {"inseparable": ()},
            "Only a combination of the coefficient of viscous damping and the coefficient of quadratic (drag) damping",
        ),
    ],
)  # fmt: skip
def test_a_fact_is_stated_only_beyond_its_threshold(changed: dict, control: dict, text: str) -> None:
    for given, is_stated in ((changed, True), ({**changed, **control}, False)):
        verdict = verdict_of(**given)
        assert (text in " ".join([verdict.sentence, *verdict.remarks])) is is_stated


@pytest.mark.parametrize(
    ("natural", "start", "is_given"),
    [
        (HERTZ, "natural frequency 0.711800 ± 0.000100 Hz", True),
        (Quantity(0.7161, 0.716, 0.7162), "frequency 0.711800 ± 0.000100 Hz at 0.03 rad (extrapolated", True),
        (Quantity(0.7, 0.3, 0.8), "frequency 0.711800 ± 0.000100 Hz at 0.03 rad", False),
    ],
)
def test_an_extrapolated_or_undetermined_natural_frequency_is_replaced_by_that_at_an_amplitude(
    natural: Quantity, start: str, is_given: bool
) -> None:
    verdict = verdict_of(frequency=natural, frequency_at=HERTZ)
    assert start in verdict.sentence
    assert ("extrapolated" in verdict.sentence) is ("extrapolated" in start)
    assert (verdict.frequency is not None) is is_given
    assert verdict.frequency_at == FrequencyAt(0.03, "rad", 0.7118, 0.7117, 0.7119)


def test_terms_of_a_sum_are_listed_by_their_share_of_the_energy() -> None:
    damping = {"viscous+coulomb": 0.98, "viscous": 0.02}
    energy = {
        "viscous": Quantity(0.3, 0.25, 0.35), "coulomb": Quantity(0.7, 0.65, 0.75), "quadratic": Quantity(0, 0, 0.02),
    }  # fmt: skip
    verdict = verdict_of(damping=damping, damping_if_exact=damping, energy=energy)
    assert "Coulomb (dry friction) 70 % (65 to 75), viscous 30 % (25 to 35)" in verdict.sentence
    assert [s.term for s in verdict.energy] == ["coulomb", "viscous", "quadratic"]
    assert [b.form for b in verdict.other_forms] == ["quadratic", "any other form"]


def test_a_damping_is_not_decided_while_its_twin_is_possible() -> None:
    """Viscous and structural damping lose the same energy at every amplitude. Control: structural was not compared."""
    with_twin = {"viscous": 1.0, "coulomb": 0.03, "quadratic": 0.01, "structural": 0.02}
    cases = (with_twin, 0.45, False), (with_twin, 0.05, True), (FINDINGS["term"], 0.45, True)
    for term, share, decided in cases:
        verdict = verdict_of(term=term, bound={"coulomb": 0.05, "quadratic": 0.02, "structural": share})
        assert verdict.decided is decided
        remarks = [r for r in verdict.remarks if "cannot distinguish viscous damping from structural" in r]
        assert ["p to 45 % of the loss" in r for r in remarks] == ([] if decided else [True])


def law_free(middle: Sequence[float] = (0.0102, 0.0101, 0.0103), hertz: float = 0.7118) -> LawFreeDamping:
    """Return what is measured without a law at the amplitudes of FINDINGS."""
    return measured([(0.3, 0.0101, 0.0099, 0.0103), (0.1, *middle), (0.03, 0.0103, 0.0098, 0.0108)], hertz)


def measured(rows: Sequence[Sequence[float]], hertz: float, half: float = 1e-4) -> LawFreeDamping:
    """Return a measurement; rows: amplitude, ratio and its interval; half: half the interval of the frequency."""
    amplitude, ratio, low, high = np.transpose(rows)
    sd, each = (high - low) / (2 * NORMAL_95), np.ones(len(rows))
    return LawFreeDamping(amplitude, ratio, sd, hertz * each, half / NORMAL_95 * each, each)


def test_a_law_that_contradicts_the_measured_damping_is_not_named() -> None:
    """Control: without the law-free damping the exponent of the law is remarked on."""
    given = {"exponent": Quantity(1.0, 0.9, 1.1), "undetermined": ("rest_angle",)}
    assert any("grows as v" in remark for remark in verdict_of(**given).remarks)
    verdict = verdict_of(**given, law_free=law_free((0.0150, 0.0148, 0.0152)))
    assert (verdict.grade, verdict.contradicted, verdict.decided) == (Grade.DEVIATES, True, False)
    assert [r.value for r in verdict.damping_ratio] == [0.0101, 0.0150, 0.0103]
    assert (verdict.frequency, verdict.frequency_at.value) == (None, 0.7118)
    assert verdict.frequency_at.high == pytest.approx(0.7119)
    assert verdict.energy == verdict.other_forms == verdict.coefficients == ()
    assert not any("grows as v" in remark for remark in verdict.remarks)
    assert "so none is named" in verdict.sentence
    assert "(probability" not in verdict.sentence
    without = tuple(Ratio(a, *(np.nan,) * 5) for a in (0.3, 0.1, 0.03))  # the law has no such oscillation
    assert verdict_of(ratios=without, curve=(), law_free=law_free()).contradicted


def test_energy_is_not_stated_where_the_damping_is_measured_without_a_law() -> None:
    """Control: the same findings without a law-free damping."""
    far = Quantity(0.4, 0.3, 0.5)
    assert verdict_of(deviation=far).energy
    verdict = verdict_of(deviation=far, law_free=law_free())
    assert verdict.law_free
    assert verdict.energy == verdict.other_forms == ()
    assert verdict.coefficients


def test_amplitudes_beyond_one_end_of_the_measurement_are_one_row() -> None:
    rows = [(0.2, 0.0101, 0.0099, 0.0103)] * 2 + [(0.03, 0.0103, 0.0098, 0.0108)]
    verdict = verdict_of(deviation=Quantity(0.4, 0.3, 0.5), law_free=measured(rows, 0.7118))
    assert [r.amplitude for r in verdict.damping_ratio] == [0.2, 0.03]


@pytest.mark.parametrize("middle", [(0.0150, 0.0103, 0.0197), (0.0106, 0.0105, 0.0107)])
def test_a_law_is_named_if_intervals_meet_or_differ_by_less_than_5_percent(middle: tuple) -> None:
    verdict = verdict_of(law_free=law_free(middle))
    assert (verdict.decided, verdict.contradicted) == (True, False)
    assert verdict.sentence == verdict_of().sentence


def test_a_law_is_compared_at_the_amplitude_that_was_measured() -> None:
    """For drag, 4 % less damping at a 4 % smaller amplitude, and 2 % of error, contradict nothing. Control: 6 % less
    damping at the same amplitude."""
    steep = tuple(Ratio(a, 0.1 * a, 0.0997 * a, 0.1003 * a, 1e-6, 1e-6) for a in (0.3, 0.27, 0.1, 0.03))
    rows = [(a, 0.098 * a, 0.0977 * a, 0.0983 * a) for a in (0.288, 0.1, 0.03)]
    for scale, contradicted in ((1.0, False), (1 / 0.96, True)):
        free = measured([(scale * a, *of_ratio) for a, *of_ratio in rows], 0.7118)
        verdict = verdict_of(ratios=(steep[0], *steep[2:]), curve=steep, law_free=free)
        assert verdict.contradicted is contradicted


def test_a_frequency_that_the_restoring_law_contradicts_is_the_measured_one() -> None:
    """Control: a measured frequency that agrees leaves the natural frequency."""
    assert verdict_of(frequency_at=HERTZ, law_free=law_free()).frequency is not None
    verdict = verdict_of(frequency_at=HERTZ, law_free=law_free(hertz=0.72))
    assert (verdict.decided, verdict.contradicted, verdict.frequency) == (False, False, None)
    assert "frequency 0.720000 ± 0.000100 Hz at 0.03 rad" in verdict.sentence
    assert any("contradicts the measured frequency: at the same amplitude" in r for r in verdict.remarks)


def test_the_fall_of_the_amplitude_follows_from_the_damping_ratio() -> None:
    """A damping ratio of 0.05 % over 5 cycles: exp(−2π · 0.0005 · 5) = 0.9844. Noise changes the amplitudes."""
    for amplitudes in ((0.3, 0.31), (0.3, 0.27)):
        determined = Ratio(0.3, 0.0005, 0.00047, 0.00053, 1e-5, 1e-5)
        remarks = verdict_of(amplitudes=amplitudes, cycles=5.0, ratios=(determined,)).remarks
        assert remarks[0].startswith("The amplitude falls by only 1.6 %, so damping models")
    far = Quantity(0.4, 0.3, 0.5)  # the law does not hold, so its ratio does not count
    for free, is_remarked in ((None, True), (law_free(), False)):
        verdict = verdict_of(cycles=5.0, ratios=(determined,), deviation=far, law_free=free)
        assert any("falls by only" in remark for remark in verdict.remarks) is is_remarked
    vague = Ratio(0.3, 0.0005, -0.001, 0.002, 1e-3, 1e-5)
    remarks = verdict_of(amplitudes=(0.3, 0.31), cycles=5.0, ratios=(vague,)).remarks
    assert remarks[0].startswith("The amplitude does not fall, so damping models")


def test_amplitudes_that_are_equal_in_print_are_one() -> None:
    near = (Ratio(1.0, 0.01, 0.0099, 0.0101, 1e-5, 1e-5), Ratio(1.001, 0.01, 0.0099, 0.0101, 1e-5, 1e-5))
    assert verdict_of(ratios=near).sentence.count("at 1 rad") == 1


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (thresholds.AVERAGED, "moves no parameter by more than 0.1 of its standard deviation"),
        (0.5, "this approximation moves parameters by up to 0.5 of their standard deviations"),
        (math.inf, "the equation of motion could not be solved to check this approximation"),
    ],
)
def test_a_remark_states_how_far_averaging_moves_parameters(error: float, text: str) -> None:
    (remark,) = verdict_of(averages=Averages(2000.0, error)).remarks
    assert remark.startswith("Amplitude and phase of 2,000 cycles were averaged over blocks of cycles")
    assert text in remark


LIMIT, NEAR = 1 + thresholds.DEVIATES, Quantity(1.0, 0.9, 1.1)


@pytest.mark.parametrize(
    ("first", "second", "amplitude"),
    [
        (NEAR, Quantity(3.0, LIMIT + 0.01, 4.0), 0.1), (NEAR, Quantity(3.0, LIMIT - 0.01, 4.0), None),
        (NEAR, Quantity(0.3, 0.2, 1 / (LIMIT + 0.01)), 0.1), (Quantity(0.1, 0.05, 0.2), Quantity(3.0, 2.0, 4.0), 0.3),
    ],
)  # fmt: skip
def test_the_largest_ratio_of_damping_to_its_law_is_given_where_it_is_certain(
    first: Quantity, second: Quantity, amplitude: float | None
) -> None:
    """Certain: the whole interval is further from 1 than a law may deviate, above or below it."""
    worst = {0.3: first, 0.1: second}.get(amplitude or 0.0)
    expected = OverLaw(amplitude, "rad", worst.value, worst.low, worst.high) if worst else None
    assert verdict_of(over_law=(first, second, NEAR)).over_law == expected


@pytest.mark.parametrize(
    ("half", "amplitude", "chosen"), [(0.5e-4, 0.03, True), (2e-4, 0.03, False), (5e-5, 0.05, False)]
)
def test_the_narrower_frequency_at_the_same_amplitude_is_given(
    half: float, amplitude: float, chosen: bool
) -> None:
    free = measured([(amplitude, 0.0103, 0.0098, 0.0108)], 0.7118, half)
    verdict = verdict_of(frequency_at=HERTZ, law_free=free)
    assert (verdict.frequency_at.high - verdict.frequency_at.low == pytest.approx(2 * half)) is chosen


def test_numbers_are_passed_on_in_their_units() -> None:
    window = UsedWindow(1.0, 41.0, 30.0, "after the release")
    verdict = verdict_of(other_forms={"power": 0.3}, midline=-0.0123, unit="m", window=window)
    assert (verdict.restoring, verdict.restoring_probability) == ("linear", 0.8)
    percentages = (verdict.unexplained_pct, verdict.noise_pct, verdict.midline_drift_pct)
    assert percentages == pytest.approx((0.1, 0.4, -1.23))
    assert [(r.damping, r.probability) for r in verdict.rivals] == [("power", 0.3), ("viscous+coulomb", 0.03)]
    assert verdict.window == window
    assert verdict.damping_ratio[0] == DampingRatio(0.3, "m", 0.0101, 1e-5, 1e-4, 0.0099, 0.0103)
    (zeta,) = verdict.coefficients
    assert (zeta.name, zeta.sd_noise, zeta.sd_law, zeta.unit) == ("zeta", 1e-4, 4e-4, "1/s")


def test_a_frequency_without_a_damping_ratio_has_no_amplitude() -> None:
    assert verdict_of(ratios=(), frequency_at=HERTZ).frequency_at is None
