"""The numbers of a weighing, on a record of SciPy's solver under a linear spring with viscous and Coulomb damping."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.draws import CandidateDraws, between_knots, midline_drift
from bayesdamp.inference.deviation.findings import (
    candidate_probabilities,
    compute_findings,
    frequency_of_draws,
    sum_probabilities,
)
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.inference.deviation.quick import compare_signal
from bayesdamp.physics.damping import others
from bayesdamp.types import Signal
from tests.inference.deviation.decays import A, W, decay
from tests.physics.independent import trajectory

ZETA, MU, SD, EPSILON = 0.04, 0.04, 0.002, 0.02
P = {
    "zeta": ZETA, "mu_c": MU, "epsilon": EPSILON, "stiffness": W**2, "rest_angle": 0.1, "theta0": 0.1 + A,
    "omega0": 0.0,
}  # fmt: skip
TIMES = np.arange(1000) * 2 * math.pi / W / 40


@pytest.fixture(scope="module")
def comparison() -> ModelComparison:
    y = trajectory("linear", P, TIMES)[:, 0] + SD * np.random.default_rng(5).standard_normal(TIMES.size)
    return compare_signal(Signal(TIMES, y), restoring=["linear"], known={"epsilon": EPSILON})


def ratio(amplitude: float) -> float:
    """Return ζ/ω + 2μ/(πω²A); the width ε reduces it by less than a thousandth."""
    return ZETA / W + 2 * MU / (math.pi * W**2 * amplitude)


def test_probabilities_are_probabilities(comparison: ModelComparison) -> None:
    each = candidate_probabilities(comparison, False)
    assert len(each) == len(comparison.results) + len(comparison.forms)
    assert len(comparison.results) + len(comparison.refused) == 7
    assert {"displacement", "stribeck", "power"} <= {r.candidate.damping[-1] for r in comparison.forms}
    assert sum(each.values()) == pytest.approx(1.0)
    by_sum = sum_probabilities({c.name: p for c, p in each.items()})
    assert next(iter(by_sum)) == "viscous+coulomb"
    assert MotionCandidate(("quadratic",), "linear") in comparison.refused
    found = compute_findings(comparison)
    every = {**found.damping, **found.other_forms}
    assert found.term["coulomb"] == pytest.approx(sum(p for s, p in every.items() if "coulomb" in s))
    assert found.restoring == pytest.approx({"linear": 1.0})
    assert found.best.damping == ("viscous", "coulomb")


def test_expected_evidence_is_near_that_of_a_fit(comparison: ModelComparison) -> None:
    """Over the sums that were fitted, within 3 nats; control: that of a sum with other terms is tens of nats away."""
    whole = next(r for r in comparison.results if len(r.candidate.damping) == 3)
    for r in comparison.results:
        expected = comparison.expected_evidence(r.candidate, whole.linearisation)
        assert expected == pytest.approx(r.log_evidence, abs=3.0)
    hopeless = comparison.expected_evidence(MotionCandidate(("quadratic",), "linear"), whole.linearisation)
    assert hopeless < comparison.best.log_evidence - 20


def test_numbers_are_the_truth(comparison: ModelComparison) -> None:
    """The 95 % intervals are wider by the sensor's error: the false-alarm rate of each of ten is below 5 %."""
    found = compute_findings(comparison, amplitudes=[0.25, 0.15, 0.08])
    for r in found.ratios:
        assert r.low < ratio(r.amplitude) < r.high
        assert not r.low < 1.1 * ratio(r.amplitude) < r.high  # control
        assert 0 < r.sd_noise < 0.05 * r.value
        assert np.hypot(r.sd_noise, r.sd_law) == pytest.approx((r.high - r.low) / 3.92, rel=0.1)
    truth = {"zeta": ZETA, "mu_c": MU, "stiffness": W**2}
    for name, value in truth.items():
        assert found.coefficients[name].low < value < found.coefficients[name].high
    assert found.frequency.low <= W / (2 * math.pi) * (1 + 1e-3)
    assert found.frequency.high >= W / (2 * math.pi) * (1 - 1e-3)
    assert found.noise == pytest.approx(SD / A, rel=0.1)
    assert found.unexplained < 0.3 * found.noise
    assert found.amplitudes[0] == pytest.approx(A, rel=0.02)
    assert found.cycles == pytest.approx(comparison.data.t[-1] * W / (2 * math.pi), rel=0.01)


def test_energy_by_term(comparison: ModelComparison) -> None:
    """The shares are those of the power of each force along SciPy's motion."""
    v = trajectory("linear", P, TIMES)[:, 1]
    power = {"viscous": np.mean(2 * ZETA * v * v), "coulomb": np.mean(MU * v * np.tanh(v / EPSILON))}
    found = compute_findings(comparison)
    for term, q in found.energy.items():
        truth = power.get(term, 0.0) / sum(power.values())
        assert q.low - 0.01 <= truth <= q.high + 0.01
    assert sum(q.value for q in found.energy.values()) == pytest.approx(1.0, abs=0.05)
    assert found.bound["quadratic"] < 0.3
    # What the sum has is no bound, and of a power of the velocity the exponent says more.
    assert set(found.bound) == {"quadratic", *others()} - {"power"}


def test_rates_are_averaged_over_other_forms_too() -> None:
    """For damping x²v, whose ratio is c A²/8ω and which none of the sums contains, the intervals contain the truth.

    Control: at the last amplitude the intervals of the sums alone do not.
    """
    extra = 4.0
    y = 0.1 + decay(lambda _, x, v: (2 * 0.02 + extra * x * x) * v, TIMES)[0]
    y += SD * np.random.default_rng(6).standard_normal(TIMES.size)
    made = compare_signal(Signal(TIMES, y), restoring=["linear"], known={"epsilon": EPSILON})
    asked = [0.27, 0.15, 0.07]
    truth = [(0.02 + extra * a * a / 8) / W for a in asked]
    found = compute_findings(made, asked)
    assert sum(found.other_forms.values()) > 0.9
    assert all(r.low < wanted < r.high for r, wanted in zip(found.ratios, truth, strict=True))
    assert not compute_findings(replace(made, forms=()), asked).ratios[-1].high > truth[-1]


def test_a_candidate_counts_in_a_frequency_by_its_probability(comparison: ModelComparison) -> None:
    """1 % of the draws, 5 % higher, do not widen a 95 % interval; 4 % of them (control) do."""

    def draws(count: int, frequency: float) -> CandidateDraws:
        law = np.tile([(2 * math.pi * frequency) ** 2, 0.0], (count, 1))
        empty = np.zeros((count, 5))
        return CandidateDraws(comparison.best, empty, empty, law, empty, empty)

    high = [frequency_of_draws([draws(4000 - n, 1.0), draws(n, 1.05)], None).high for n in (40, 160)]
    assert high == pytest.approx([1.0, 1.05], rel=1e-6)


@pytest.mark.parametrize("steps", [1, 4, 7])
def test_between_knots_deviations_are_a_bridge(steps: int) -> None:
    """For a random walk that is known at every eighth step; three standard errors of 20,000 draws are 3 %.

    At a knot nothing is added, nor to a straight line, however steep it is.
    """
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.standard_normal((20000, 97)), axis=1)
    knots, fraction = walk[:, ::8], (40 + steps) / 96
    linear = knots[:, 5] + steps / 8 * (knots[:, 6] - knots[:, 5])
    drawn = between_knots(knots, fraction, rng)
    assert np.mean(drawn**2) == pytest.approx(np.mean((walk[:, 40 + steps] - linear) ** 2), rel=0.05)
    assert np.abs(between_knots(knots, 40 / 96, rng)).max() < 1e-6
    assert np.abs(between_knots(np.linspace(-1, 1, 9)[None] + np.zeros((5, 1)), fraction, rng)).max() < 1e-12


def test_a_midline_that_drifts_has_a_size(comparison: ModelComparison) -> None:
    """A drift of 1 % of the amplitude is measured within five standard errors of its 35 means. Control: without it,
    0."""
    best = max(comparison.results, key=lambda r: r.log_evidence)
    assert midline_drift(best) == 0
    line = 0.01 * A * np.linspace(-0.5, 0.5, comparison.data.t.size)
    moved = replace(best, fit=replace(best.fit, residual=best.fit.residual + line))
    assert midline_drift(moved) == pytest.approx(0.01, abs=5 * SD / A * np.sqrt(12 / TIMES.size) + 1e-4)
