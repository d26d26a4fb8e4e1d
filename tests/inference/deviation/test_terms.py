"""Damping terms with parameters of their own, on records of the validation's solver."""

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.physics.damping import TERMS, others
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict
from validation.experiments.laws import case


@lru_cache
def answer_on(term: str) -> tuple[Verdict, dict[str, float], float]:
    """Return the verdict on a record of a term among five candidates, its true parameters, and its share of the
    energy."""
    simulated = case(term, {"structural": 1009}.get(term, 1001 if term in ("cubic", "stribeck") else 1000))
    damping = ["viscous", "coulomb", "quadratic", term, f"viscous+{term}"]
    comparison = compare_models(simulated.signal, damping=damping, restoring=["linear"])
    return answer(simulated.signal, comparison).verdict, simulated.parameters, simulated.shares[term]


@pytest.mark.parametrize(
    "term", ["cubic", *(pytest.param(n, marks=pytest.mark.slow) for n in others() if n != "cubic")]
)
def test_a_term_is_identified(term: str) -> None:
    """Its parameters are the true ones within four standard deviations (a false alarm in 16,000 seeds for each), with
    their own names and units. `validation.experiments.laws` counts how often the intervals contain the truth."""
    verdict, truth, share = answer_on(term)
    assert term in verdict.damping.split("+")
    coefficients = {c.name: c for c in verdict.coefficients if c.name in truth}
    assert TERMS.get(term).parameter in coefficients
    assert set(coefficients) >= {p.name for p in TERMS.get(term).inferred}
    for name, c in coefficients.items():
        assert 2 * c.low - c.value <= truth[name] <= 2 * c.high - c.value, name
        assert c.unit
    energy = next(s for s in verdict.energy if s.term == term)
    assert energy.low - 0.05 <= share <= energy.high + 0.05
    assert term not in {b.form for b in verdict.other_forms}


def test_an_exponent_that_is_not_determined_is_reported() -> None:
    """The record loses only five per cent of its amplitude."""
    osc, k = Oscillator(("power",), "linear"), 20.0
    p = {"c_power": 0.003, "exponent": 1.4, "stiffness": k, "rest_angle": 0.0, "theta0": 0.3}
    p |= {"omega0": 0.0, "epsilon": 0.001}
    signal = simulate_signal(osc, p, duration=25.0, samples=900, noise_sd=0.006, rng=np.random.default_rng(1))
    verdict = answer(signal, compare_models(signal, damping=["power"], restoring=["linear"])).verdict
    assert any("does not determine the exponent" in remark for remark in verdict.remarks)
    assert not any("does not determine" in remark for remark in answer_on("cubic")[0].remarks)  # control


def test_damping_by_displacement_is_not_compared_if_the_record_has_no_displacement() -> None:
    """A viscous decay in closed form: with a zero far from rest, (x - x0)²v would be the same as viscous damping."""
    w, ratio = 2 * np.pi * 3.1, 0.028
    pole = complex(-ratio * w, w * np.sqrt(1 - ratio**2))
    t = np.arange(150) / 20
    clean = (0.003 * pole * np.exp(pole * t)).real
    noise = 0.05 * np.abs(clean).max() * np.random.default_rng(50).standard_normal(t.size)
    signal, damping = Signal(t, clean + noise, quantity="velocity"), ["viscous", "displacement", "cubic"]
    comparison = compare_signal(signal, damping=damping, restoring=["linear"])
    assert [r.candidate.damping for r in comparison.results] == [("viscous",)]
    assert {c.damping for c in comparison.refused} == {("displacement",), ("cubic",)}
