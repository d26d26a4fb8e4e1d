"""Decisions are a pure function of findings: grades, what is decided, and the facts of the sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.findings import Findings, Quantity
from bayesdamp.types import Ratio
from bayesdamp.verdict import Verdict, thresholds
from bayesdamp.verdict.decide import decide
from bayesdamp.verdict.parts import (
    Averages,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    LawFreeAt,
    OverLaw,
    UsedWindow,
)

TINY = 1e-6
HERTZ = Quantity(0.7118, 0.7117, 0.7119)


def deviation(low: float = 0.0, value: float = 0.01, high: float = 0.02) -> Quantity:
    return Quantity(value, low, high)


def findings(**changed: object) -> Findings:
    """Viscous damping that is decided, of a law that holds."""
    given: dict[str, object] = {
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
        "deviation": deviation(),
        "restoring_deviation": deviation(0, 0.001, 0.003),
        "other": 0.02,
        "coefficients": {"zeta": Quantity(0.045, 0.044, 0.046, 1e-4, 4e-4)},
        "best": MotionCandidate(("viscous",), "linear"),
        "unexplained": 0.001,
        "noise": 0.004,
        "amplitudes": (0.31, 0.028),
        "cycles": 30.0,
    }  # fmt: skip
    return Findings(**(given | changed))


def decided(found: Findings | None = None, **how: object) -> Verdict:
    return decide(found or findings(), record="rig", **how)


def two(p: float, exact: Mapping[str, float] | None = None) -> Findings:
    damping = {"viscous": p, "coulomb": 1 - p}
    return findings(damping=damping, damping_if_exact=exact or damping)


def test_grades() -> None:
    cases = [
        ({"deviation": deviation(high=thresholds.EXACT)}, Grade.EXACT),
        ({"deviation": deviation(high=thresholds.EXACT + TINY)}, Grade.APPROXIMATE),
        ({"deviation": deviation(0.1, thresholds.DEVIATES, 0.6)}, Grade.APPROXIMATE),
        ({"deviation": deviation(0.1, thresholds.DEVIATES + TINY, 0.6)}, Grade.DEVIATES),
        ({"restoring_deviation": deviation(thresholds.RESTORING_DEVIATES, 0.06, 0.1)}, Grade.EXACT),
        ({"restoring_deviation": deviation(thresholds.RESTORING_DEVIATES + TINY, 0.06, 0.1)}, Grade.DEVIATES),
        ({"unexplained": thresholds.UNEXPLAINED}, Grade.EXACT),
        ({"unexplained": thresholds.UNEXPLAINED + TINY}, Grade.DEVIATES),
    ]
    for changed, grade in cases:
        found = decided(findings(**changed))
        assert found.grade is grade
        assert found.decided is (grade is not Grade.DEVIATES)
        said = found.sentence.lower()
        assert ("the nearest law of damping is" in said) is (grade is Grade.DEVIATES)


def test_under_exact_laws_the_grade_is_exact() -> None:
    found = decided(findings(deviation=deviation(0.4, 0.5, 0.6)), approximate=False)
    assert found.grade is Grade.EXACT
    assert found.deviation is None
    assert "holds within" not in found.sentence
    assert "any other form" not in {b.form for b in found.other_forms}


def test_decided() -> None:
    cases = [
        (thresholds.DECIDED, None, True),
        (thresholds.DECIDED - TINY, None, False),
        (0.9999, {"coulomb": 0.6, "viscous": 0.4}, False),
        (0.9999, {"viscous": 0.6, "coulomb": 0.4}, True),
    ]
    for p, exact, outright in cases:
        found = decided(two(p, exact))
        assert found.decided is outright
        assert found.damping == "viscous"
        assert found.sentence.startswith("Viscous damping") is outright
        another = any("would be the most probable" in remark for remark in found.remarks)
        assert another is (exact is not None and not outright)


def test_probabilities_of_measured_records_are_capped() -> None:
    for measured, approximate, cap in [(True, True, thresholds.CAP), (False, True, 1), (True, False, 1)]:
        found = decided(two(0.99999), measured=measured, approximate=approximate)
        assert found.probability == min(0.99999, cap)
        assert ("> 0.999" in found.sentence) is (cap == 1)
        low = decided(two(thresholds.CAP - 0.01), measured=measured)
        assert low.probability == thresholds.CAP - 0.01


OPEN = {"viscous": 0.9 - thresholds.NAMED, "coulomb": 0.1, "quadratic": thresholds.NAMED}
BOTH = {"viscous+coulomb": 0.6, "viscous": 0.4}
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
            "; it surely contains viscous damping",
        ),
        ({"unexplained": thresholds.REMARK}, {"unexplained": thresholds.REMARK - TINY}, "explained neither by"),
        ({"midline": -0.0123}, {"midline": 0.5 * thresholds.MIDLINE}, "The midline drifts by 1.2 % of the first"),
        ({"amplitudes": (0.31, 0.31 * 0.71)}, {"amplitudes": (0.31, 0.31 * 0.69)}, "hard to distinguish"),
        (
            {"inseparable": (("zeta", "mu_q"),)}, {"inseparable": ()},
            "Only a combination of the coefficient of viscous damping and the coefficient of quadratic (drag) damping",
        ),
        ({"inseparable": (("mu_k", "stribeck_velocity"),)}, {"inseparable": ()}, "the stribeck velocity is determined"),
    ],
)  # fmt: skip
def test_what_is_said_beyond_a_threshold(changed: dict, control: dict, text: str) -> None:
    """In the sentence or a remark; and not where the finding is below its threshold."""
    for given, said in ((changed, True), ({**changed, **control}, False)):
        verdict = decided(findings(**given))
        assert (text in " ".join([verdict.sentence, *verdict.remarks])) is said


def test_a_frequency_beyond_the_record_follows_one_of_the_record() -> None:
    for natural, beyond in [(0.7118, False), (0.7118 * 1.006, True)]:
        interval = Quantity(natural, natural - 1e-4, natural + 1e-4)
        found = decided(findings(frequency=interval, frequency_at=HERTZ))
        assert ("frequency 0.711800 ± 0.000100 Hz at 0.03 rad (extrapolated" in found.sentence) is beyond
        assert ("natural frequency" in found.sentence) is not beyond
        assert found.frequency_at == FrequencyAt(0.03, "rad", 0.7118, 0.7117, 0.7119)


def test_facts_of_a_budget() -> None:
    damping = {"viscous+coulomb": 0.98, "viscous": 0.02}
    energy = {
        "viscous": Quantity(0.3, 0.25, 0.35), "coulomb": Quantity(0.7, 0.65, 0.75), "quadratic": Quantity(0, 0, 0.02),
    }  # fmt: skip
    found = decided(findings(damping=damping, damping_if_exact=damping, energy=energy))
    assert "Coulomb (dry friction) 70 % (65 to 75), viscous 30 % (25 to 35)" in found.sentence
    assert [s.term for s in found.energy] == ["coulomb", "viscous", "quadratic"]
    assert [b.form for b in found.other_forms] == ["quadratic", "any other form"]


def test_a_twin_that_is_not_excluded_leaves_it_open() -> None:
    """Structural damping loses like viscous at every amplitude: where both were weighed and the record allows much of
    one beside the other, neither is named without reservation, and it is said."""
    for share, decided in [(0.45, False), (0.05, True)]:
        term = {"viscous": 1.0, "coulomb": 0.03, "quadratic": 0.01, "structural": 0.02}
        found = findings(term=term, bound={"coulomb": 0.05, "quadratic": 0.02, "structural": share})
        verdict = decide(found, record="rig")
        assert verdict.decided is decided
        said = [r for r in verdict.remarks if "cannot distinguish viscous damping from structural" in r]
        assert bool(said) is not decided
        assert all("p to 45 % of the loss" in r for r in said)
        alone = findings(bound={"coulomb": 0.05, "quadratic": 0.02, "structural": share})
        assert decide(alone, record="rig").decided, "control: structural damping was not asked for"


def measured(
    middle: tuple[float, float, float] = (0.0102, 0.0101, 0.0103), hertz: float = 0.7118
) -> LawFreeAt:
    """What is measured without a law at the amplitudes of the findings."""
    rows = [(0.3, 0.0101, 0.0099, 0.0103), (0.1, *middle), (0.03, 0.0103, 0.0098, 0.0108)]
    ratios = tuple(DampingRatio(a, "rad", v, 1e-4, 0.0, low, high) for a, v, low, high in rows)
    return LawFreeAt(ratios, FrequencyAt(0.03, "rad", hertz, hertz - 1e-4, hertz + 1e-4))


def test_a_law_that_contradicts_the_measured_damping_is_not_named() -> None:
    told = findings(exponent=Quantity(1.0, 0.9, 1.1), undetermined=("rest_angle",))
    found = decided(told, law_free=measured((0.0150, 0.0148, 0.0152)))
    assert any("grows as v" in remark for remark in decided(told).remarks)  # the control
    assert found.grade is Grade.DEVIATES
    assert found.contradicted
    assert not found.decided
    assert [r.value for r in found.damping_ratio] == [0.0101, 0.0150, 0.0103]
    assert found.frequency is None
    assert found.frequency_at == measured().frequency
    assert found.energy == found.other_forms == found.coefficients == ()
    assert not any("grows as v" in remark for remark in found.remarks)
    assert "so none is named" in found.sentence
    assert "(probability" not in found.sentence


def test_energy_is_not_stated_where_the_damping_is_measured_without_a_law() -> None:
    far = findings(deviation=deviation(0.4, 0.3, 0.5))
    assert decided(far).energy  # the control: nothing is measured without a law
    verdict = decided(far, law_free=measured())
    assert verdict.law_free
    assert verdict.energy == verdict.other_forms == ()
    assert verdict.coefficients


def test_a_law_that_agrees_with_the_measured_damping_stays() -> None:
    """Where intervals meet, or differ by less than 5 %."""
    for middle in [(0.0102, 0.0101, 0.0103), (0.0150, 0.0103, 0.0197), (0.0106, 0.0105, 0.0107)]:
        found = decided(law_free=measured(middle))
        assert found.decided
        assert not found.contradicted
        assert found.sentence == decided().sentence


def test_a_law_is_compared_at_the_amplitude_that_was_measured() -> None:
    """For drag, 4 % less damping at a 4 % smaller amplitude, and 2 % of error, contradict nothing."""
    steep = tuple(Ratio(a, 0.1 * a, 0.0997 * a, 0.1003 * a, 1e-6, 1e-6) for a in (0.3, 0.27, 0.1, 0.03))
    rows = [(a, 0.098 * a, 0.0977 * a, 0.0983 * a) for a in (0.288, 0.1, 0.03)]
    own = tuple(DampingRatio(a, "rad", v, 1e-6, 0.0, low, high) for a, v, low, high in rows)
    drag = findings(ratios=(steep[0], *steep[2:]), curve=steep)
    assert not decided(drag, law_free=replace(measured(), ratios=own)).contradicted
    moved = tuple(
        replace(r, amplitude=r.amplitude / 0.96) for r in own
    )  # the control: 6 % less at the same amplitude
    assert decided(drag, law_free=replace(measured(), ratios=moved)).contradicted


def test_a_frequency_that_the_restoring_law_contradicts_is_the_measured_one() -> None:
    by_law = findings(frequency_at=HERTZ)
    found = decided(by_law, law_free=measured(hertz=0.72))
    assert found.decided
    assert not found.contradicted
    assert found.frequency is None
    assert "frequency 0.720000 ± 0.000100 Hz at 0.03 rad" in found.sentence
    assert any("contradicts the measured frequency" in remark for remark in found.remarks)
    assert decided(by_law, law_free=measured()).frequency is not None  # the control


def test_a_natural_frequency_that_is_not_determined_is_left_out() -> None:
    wide = decided(findings(frequency=Quantity(0.7, 0.3, 0.8), frequency_at=HERTZ))
    assert wide.frequency is None
    assert "extrapolated" not in wide.sentence
    assert "frequency 0.711800 ± 0.000100 Hz at 0.03 rad" in wide.sentence


def test_the_largest_reservation_comes_first() -> None:
    """Another damping under exact laws, a twin, what is not determined, a shallow decay, a small misfit; then facts."""
    told = findings(
        damping={"viscous": 0.97, "coulomb": 0.03},
        damping_if_exact={"coulomb": 0.6, "viscous": 0.4},
        term={"viscous": 1.0, "coulomb": 0.03, "quadratic": 0.01, "structural": 0.02},
        bound={"coulomb": 0.05, "quadratic": 0.02, "structural": 0.45},
        undetermined=("rest_angle",),
        amplitudes=(0.3, 0.27),
        unexplained=0.02,
        midline=0.004,
        exponent=Quantity(1.0, 0.9, 1.1),
    )
    said = decided(told, notes=["Given a note."]).remarks
    starts = [
        "If damping and spring followed their laws exactly, Coulomb (dry friction) would be",
        "The record cannot distinguish viscous damping from structural",
        "The record does not determine the rest angle; its interval is just the prior.",
        "The amplitude falls by only 10 %, so damping models are hard to distinguish.",
        "A residual of 2 % of the amplitude is explained neither by the law nor by the noise.",
        "The midline drifts by 0.4 % of the first amplitude over the record.",
        "Given a note.",
        "Fitted as a power law, the damping force grows as v^(1.00 ± 0.10), which is viscous.",
    ]
    assert [line[: len(start)] for line, start in zip(said, starts, strict=True)] == starts
    grown = decided(findings(amplitudes=(0.3, 0.31))).remarks
    assert grown == ("The amplitude does not fall, so damping models are hard to distinguish.",)


def test_averages_are_a_reservation_where_they_move_a_parameter() -> None:
    for error, text in [
        (thresholds.AVERAGED, "moves no parameter by more than 0.1 of its standard deviation"),
        (0.5, "this approximation moves parameters by up to 0.5 of their standard deviations"),
        (math.inf, "the equation of motion could not be solved to check this approximation"),
    ]:
        (remark,) = decided(averages=Averages(2000.0, error)).remarks
        assert remark.startswith("Amplitude and phase were averaged over 2,000 cycles")
        assert text in remark


def test_the_damping_over_its_law_where_it_is_worst() -> None:
    """Only where it surely is further away than a law may be; above or below it."""
    limit = 1 + thresholds.DEVIATES
    near = Quantity(1.0, 0.9, 1.1)
    for worst, shown in [
        ((3.0, limit + 0.01, 4.0), True), ((3.0, limit - 0.01, 4.0), False), ((0.3, 0.2, 1 / (limit + 0.01)), True),
    ]:  # fmt: skip
        over = decided(findings(over_law=(near, Quantity(*worst), near))).over_law
        assert over == (OverLaw(0.1, "rad", *worst) if shown else None)
    two_off = (Quantity(0.1, 0.05, 0.2), Quantity(3.0, 2.0, 4.0), near)
    assert decided(findings(over_law=two_off)).over_law.amplitude == 0.3


def test_the_narrower_frequency_at_one_amplitude_is_given() -> None:
    by_law = findings(frequency_at=HERTZ)
    for half, own in [(0.5e-4, True), (2e-4, False)]:
        free = measured()
        interval = FrequencyAt(0.03, "rad", 0.7118, 0.7118 - half, 0.7118 + half)
        verdict = decided(by_law, law_free=replace(free, frequency=interval))
        assert (verdict.frequency_at == interval) is own
        elsewhere = replace(interval, amplitude=0.05)
        assert decided(by_law, law_free=replace(free, frequency=elsewhere)).frequency_at != elsewhere


def test_numbers_are_passed_on_in_their_units() -> None:
    told = findings(unnamed=Quantity(0.1, 0.0, 0.2), other_forms={"power": 0.3}, midline=-0.0123)
    window = UsedWindow(1.0, 41.0, 30.0, "after the release")
    verdict = decided(told, unit="m", window=window)
    assert (verdict.restoring, verdict.restoring_probability) == ("linear", 0.8)
    given = (verdict.unexplained_pct, verdict.noise_pct, verdict.midline_drift_pct)
    assert given == pytest.approx((0.1, 0.4, -1.23))
    assert [(r.damping, r.probability) for r in verdict.rivals] == [("power", 0.3), ("viscous+coulomb", 0.03)]
    assert verdict.unnamed == Interval(0.1, 0.0, 0.2)
    assert verdict.damping_ratio[0] == DampingRatio(0.3, "m", 0.0101, 1e-5, 1e-4, 0.0099, 0.0103)
    assert {r.unit for r in verdict.damping_ratio} == {"m"}
    (coefficient,) = verdict.coefficients
    assert (coefficient.name, coefficient.sd_noise, coefficient.sd_law) == ("zeta", 1e-4, 4e-4)
    assert coefficient.unit == "1/s"
    assert verdict.window == window
