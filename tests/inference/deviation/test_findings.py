"""The numbers of an answer on a record of viscous and Coulomb damping with a linear spring, by SciPy's solver."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import halfnorm, lognorm, uniform

from bayesdamp import machine
from bayesdamp.inference.deviation import sampling
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.draws import CandidateDraws, midline_drift
from bayesdamp.inference.deviation.findings import (
    candidate_probabilities,
    compute_findings,
    frequency_of_draws,
    sum_probabilities,
)
from bayesdamp.inference.deviation.model_comparison import NO_LARGEST, ModelComparison
from bayesdamp.physics.damping import others
from bayesdamp.priors import HalfNormal, LogNormal, Uniform
from bayesdamp.types import Signal
from tests.inference.deviation.decays import A, W, decay
from tests.physics.independent import trajectory

ZETA, MU, SD, EPSILON = 0.04, 0.04, 0.002, 0.02
P = {
    "zeta": ZETA, "mu_c": MU, "epsilon": EPSILON, "stiffness": W**2, "rest_angle": 0.1, "theta0": 0.1 + A,
    "omega0": 0.0,
}  # fmt: skip
TIMES = np.arange(1000) * 2 * math.pi / W / 40
SHORT = Signal(
    TIMES[:200],
    trajectory("linear", {**P, "zeta": 0.07, "mu_c": 0.0}, TIMES[:200])[:, 0]
    + 0.03 * A * np.random.default_rng(5).standard_normal(200),
)


@pytest.fixture(scope="module")
def comparison() -> ModelComparison:
    y = trajectory("linear", P, TIMES)[:, 0] + SD * np.random.default_rng(5).standard_normal(TIMES.size)
    known = {"linear": {"epsilon": EPSILON}, "duffing": {"epsilon": EPSILON, "cubic": -1e5}}
    return compare_signal(Signal(TIMES, y), restoring=list(known), known=known.__getitem__)


def ratio(amplitude: float) -> float:
    """Return ζ/ω + 2μ/(πω²A); the width ε reduces it by less than a thousandth."""
    return ZETA / W + 2 * MU / (math.pi * W**2 * amplitude)


def test_probabilities_of_candidates_sums_and_terms_are_consistent(comparison: ModelComparison) -> None:
    probabilities = candidate_probabilities(comparison, False)
    assert len(probabilities) == len(comparison.results) + len(comparison.forms)
    assert len(comparison.results) + len(comparison.refused) == 14
    assert comparison.refused[MotionCandidate(("viscous",), "duffing")] == NO_LARGEST
    assert {"displacement", "stribeck", "power"} <= {r.candidate.damping[-1] for r in comparison.forms}
    assert sum(probabilities.values()) == pytest.approx(1.0)
    by_sum = sum_probabilities({c.name: p for c, p in probabilities.items()})
    assert next(iter(by_sum)) == "viscous+coulomb"
    assert MotionCandidate(("quadratic",), "linear") in comparison.refused
    findings = compute_findings(comparison)
    sums = {**findings.damping, **findings.other_forms}
    assert findings.term["coulomb"] == pytest.approx(sum(p for s, p in sums.items() if "coulomb" in s))
    assert findings.restoring == pytest.approx({"linear": 1.0})
    assert sum(findings.damping_if_exact.values()) == pytest.approx(1.0, abs=1e-12)
    assert findings.best.damping == ("viscous", "coulomb")


def test_expected_evidence_is_near_that_of_a_fit(comparison: ModelComparison) -> None:
    """Within 3 nats for the sums that were fitted. Control: that of a sum with other terms is tens of nats smaller."""
    whole = next(r for r in comparison.results if len(r.candidate.damping) == 3)
    hopeless, fitted = MotionCandidate(("quadratic",), "linear"), [r.candidate for r in comparison.results]
    expected = comparison.expected_evidences([hopeless, *fitted], whole.linearisation)
    for r in comparison.results:
        assert expected[r.candidate] == pytest.approx(r.log_evidence, abs=3.0)
    assert expected[hopeless] < comparison.best.log_evidence - 20


@pytest.mark.parametrize(("wrong", "left_out"), [(0.0, True), (2.0, False)])
def test_predictions_are_checked(monkeypatch: pytest.MonkeyPatch, wrong: float, left_out: bool) -> None:
    """The prediction for one sum is lowered to 15 nats behind, and that for another one is wrong by so many nats."""
    predict = ModelComparison.expected_evidences
    far, near = (MotionCandidate((term,), "linear") for term in ("quadratic", "coulomb"))

    def changed(*of: Any) -> dict[MotionCandidate, float]:
        expected = predict(*of)
        own = {far: max(expected.values()) - 15.0, near: expected.get(near, 0.0) - wrong}
        return expected | own if near in expected else expected

    monkeypatch.setattr(ModelComparison, "expected_evidences", changed)
    comparison = compare_signal(SHORT, restoring=["linear"], known={"epsilon": EPSILON})
    assert (far in comparison.refused) is left_out
    assert near not in comparison.refused


def test_a_prior_changes_evidence_by_its_density_and_no_sum_is_left_out() -> None:
    """A record of five cycles determines a coefficient much better than these priors, so that the log evidence of its
    term changes by that of the prior density at the estimate (closed form). Control: 0 is the median of neither prior's
    scores, and a sum without the term would be hopeless if the term had its median coefficient."""
    asked = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "known": {"epsilon": EPSILON}}
    logs, densities = [], []
    for prior, density in (
        (HalfNormal(0.3), halfnorm(scale=0.3)),
        (Uniform(0.0, 0.5), uniform(0.0, 0.5)),
        (LogNormal(0.1, 1.0), lognorm(1.0, scale=0.1)),
    ):
        priors = {"zeta": prior, "mu_c": HalfNormal(0.3)}
        result = compare_signal(SHORT, **asked, priors=priors, approximate=False)
        viscous, coulomb = sorted(result.results, key=lambda r: "coulomb" in r.candidate.damping)
        logs.append(viscous.log_evidence - coulomb.log_evidence)
        densities.append(density.logpdf(viscous.fit.values[0]))
        assert max(compute_findings(result).bound.values()) < 0.9
    assert np.diff(logs) == pytest.approx(np.diff(densities), abs=0.03)


def test_a_prior_of_the_restoring_law_counts_for_rivals_too() -> None:
    """A sharp prior of the stiffness changes the log evidence of every sum by its density at the estimate, also that of
    rivals. Control: the change is several nats."""
    free, given = (
        compare_signal(SHORT, restoring=["linear"], known={"epsilon": EPSILON}, noises=["gaussian"], priors=p)
        for p in ({}, {"stiffness": LogNormal(P["stiffness"], 0.01)})
    )
    rises = [given.result(r.candidate).log_evidence - r.log_evidence for r in (*free.results, *free.forms)]
    assert rises == pytest.approx([rises[0]] * (len(free.results) + 9), abs=0.05)
    assert rises[0] > 2


def test_intervals_contain_the_truth(comparison: ModelComparison) -> None:
    """Ten intervals of 95 %, which are wider by the error of the sensor: each has a false-alarm rate below 5 %.

    The posterior is a mixture with heavier tails than a normal distribution: for seeds 0 to 7, the sd is 0.99 to 1.19
    times the half width of the interval divided by 1.96."""
    findings = compute_findings(comparison, amplitudes=[0.25, 0.15, 0.08])
    for r in findings.ratios:
        assert r.low < ratio(r.amplitude) < r.high
        assert not r.low < 1.1 * ratio(r.amplitude) < r.high  # control
        assert 0 < r.sd_noise < 0.05 * r.value
        assert np.hypot(r.sd_noise, r.sd_law) == pytest.approx((r.high - r.low) / 3.92, rel=0.25)
    for name, value in (("zeta", ZETA), ("mu_c", MU), ("stiffness", W**2)):
        assert findings.coefficients[name].low < value < findings.coefficients[name].high
    assert findings.frequency.low <= W / (2 * math.pi) * (1 + 1e-3)
    assert findings.frequency.high >= W / (2 * math.pi) * (1 - 1e-3)
    at = [compute_findings(comparison, amplitudes).frequency_at for amplitudes in ([0.2, 0.1], [0.1, 0.2])]
    assert at[0].value == at[1].value
    assert findings.noise == pytest.approx(SD / A, rel=0.1)
    assert findings.unexplained < 0.3 * findings.noise
    assert findings.amplitudes[0] == pytest.approx(A, rel=0.02)
    assert findings.cycles == pytest.approx(comparison.data.t[-1] * W / (2 * math.pi), rel=0.01)


def test_shares_of_the_lost_energy_are_those_of_the_power_of_each_force(comparison: ModelComparison) -> None:
    """Along SciPy's motion. Terms of the answer have no bound, and a power of the velocity has an exponent instead."""
    v = trajectory("linear", P, TIMES)[:, 1]
    power = {"viscous": np.mean(2 * ZETA * v * v), "coulomb": np.mean(MU * v * np.tanh(v / EPSILON))}
    findings = compute_findings(comparison)
    for term, q in findings.energy.items():
        truth = power.get(term, 0.0) / sum(power.values())
        assert q.low - 0.01 <= truth <= q.high + 0.01
    assert sum(q.value for q in findings.energy.values()) == pytest.approx(1.0, abs=0.05)
    assert findings.bound["quadratic"] < 0.3
    assert set(findings.bound) == {"quadratic", *others()} - {"power"}


def test_damping_ratios_are_averaged_over_other_forms_too() -> None:
    """Intervals contain the truth for damping x²v, whose ratio is c A²/8ω, and which none of the sums contains.

    Control: at the last amplitude the intervals of the sums alone do not.
    """
    extra = 4.0
    y = 0.1 + decay(lambda _, x, v: (2 * 0.02 + extra * x * x) * v, TIMES)[0]
    y += SD * np.random.default_rng(6).standard_normal(TIMES.size)
    compared = compare_signal(Signal(TIMES, y), restoring=["linear"], known={"epsilon": EPSILON})
    amplitudes = [0.27, 0.15, 0.07]
    truth = [(0.02 + extra * a * a / 8) / W for a in amplitudes]
    findings = compute_findings(compared, amplitudes)
    assert sum(findings.other_forms.values()) > 0.9
    assert all(r.low < true < r.high for r, true in zip(findings.ratios, truth, strict=True))
    assert not compute_findings(replace(compared, forms=()), amplitudes).ratios[-1].high > truth[-1]


def test_models_sampled_at_once_have_their_own_draws(comparison: ModelComparison, monkeypatch) -> None:
    """The draws are those of models that are sampled one after another. Control: another seed gives other draws."""

    def draws(seed: int) -> list[np.ndarray]:
        return [r.sampled.draws for r in sampling.with_samples(comparison, seed).results if r.sampled]

    monkeypatch.setattr(machine, "cores", lambda: 4)
    at_once, other = draws(1), draws(2)
    monkeypatch.setattr(sampling, "at_once", lambda function, items: [function(item) for item in items])
    assert len(at_once) > 1
    assert all(map(np.array_equal, at_once, draws(1)))
    assert not any(map(np.array_equal, at_once, other))


def test_the_interval_of_the_frequency_is_that_of_all_draws(comparison: ModelComparison) -> None:
    """1 % of the draws with a frequency 5 % higher do not widen a 95 % interval. Control: 4 % of them do."""

    def draws(count: int, frequency: float) -> CandidateDraws:
        law = np.tile([(2 * math.pi * frequency) ** 2, 0.0], (count, 1))
        empty = np.zeros((count, 5))
        return CandidateDraws(comparison.best, empty, empty, law, empty, empty)

    high = [frequency_of_draws([draws(4000 - n, 1.0), draws(n, 1.05)], None).high for n in (40, 160)]
    assert high == pytest.approx([1.0, 1.05], rel=1e-6)


@pytest.mark.parametrize("steps", [1, 4])
def test_deviations_between_knots_are_those_of_a_random_walk(comparison: ModelComparison, steps: int) -> None:
    """Of which every eighth step is known. Three standard errors of 20,000 draws are 3 %. At a knot, and on a straight
    line of any slope, nothing is added."""
    rng = np.random.default_rng(3)

    def draws_of(g: np.ndarray) -> CandidateDraws:
        return CandidateDraws(comparison.best, *[np.zeros((len(g), 0))] * 3, g, g)

    walk = np.cumsum(rng.standard_normal((20000, 97)), axis=1)
    knots, fraction = walk[:, ::8], (40 + steps) / 96
    linear = knots[:, 5] + steps / 8 * (knots[:, 6] - knots[:, 5])
    drawn = draws_of(knots).between_knots(fraction, rng)
    assert np.mean(drawn**2) == pytest.approx(np.mean((walk[:, 40 + steps] - linear) ** 2), rel=0.05)
    assert np.abs(draws_of(knots).between_knots(40 / 96, rng)).max() < 1e-6
    straight = np.linspace(-1, 1, 9)[None] + np.zeros((5, 1))
    assert np.abs(draws_of(straight).between_knots(fraction, rng)).max() < 1e-12


def test_the_drift_of_the_midline_is_measured(comparison: ModelComparison) -> None:
    """1 % of the amplitude, within five standard errors, also with a gap. Control: without a drift it is 0."""
    best, t = comparison.best, comparison.data.t
    assert midline_drift(best) == 0
    residual = best.fit.residual + A * np.linspace(0.1, 0.11, t.size)
    for kept in (t >= 0, np.abs(t - 0.6 * t[-1]) > 0.1 * t[-1]):
        fit, data = replace(best.fit, residual=residual[kept]), replace(best.data, t=t[kept])
        drift = midline_drift(replace(best, fit=fit, data=data))
        assert drift == pytest.approx(0.01, abs=5 * SD / A * np.sqrt(12 / TIMES.size) + 1e-4)
