"""Terms with parameters of their own, on records of the validation's solver: found again, or refused."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.quick import compare_signal
from bayesdamp.interface.answer import answer
from bayesdamp.physics.damping import TERMS, others
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict
from validation.experiments.laws import case


@lru_cache
def found(term: str) -> tuple[Verdict, dict[str, float], float]:
    """Return the verdict on a record of a term among five candidates, its true parameters, and its share of the
    energy."""
    made = case(term, {"structural": 1009}.get(term, 1001 if term in ("cubic", "stribeck") else 1000))
    damping = ["viscous", "coulomb", "quadratic", term, f"viscous+{term}"]
    return (
        answer(made.signal, damping=damping, restoring=["linear"]).verdict,
        made.parameters,
        made.shares[term],
    )


@pytest.mark.parametrize(
    "term", ["cubic", *(pytest.param(n, marks=pytest.mark.slow) for n in others() if n != "cubic")]
)
def test_a_term_is_found_again(term: str) -> None:
    """Its parameters are within twice the reach of their 95 % intervals, with their own names and units.

    These are four standard deviations, a false alarm once in 16,000 seeds for each. `validation.experiments.laws`
    counts how often the intervals contain the truth.
    """
    verdict, truth, share = found(term)
    assert term in verdict.damping.split("+")
    held = {c.name: c for c in verdict.coefficients if c.name in truth}
    assert TERMS.get(term).parameter in held
    assert set(held) >= {p.name for p in TERMS.get(term).inferred}
    for name, c in held.items():
        assert 2 * c.low - c.value <= truth[name] <= 2 * c.high - c.value, name
        assert c.unit
    own = next(s for s in verdict.energy if s.term == term)
    assert own.low - 0.05 <= share <= own.high + 0.05
    assert term not in {b.form for b in verdict.other_forms}


def test_terms_that_a_record_cannot_tell_are_said() -> None:
    """Where only five per cent of the amplitude is lost the exponent is not determined, and a remark states it."""
    osc, k = Oscillator(("power",), "linear"), 20.0
    p = {"c_power": 0.003, "exponent": 1.4, "stiffness": k, "rest_angle": 0.0, "theta0": 0.3}
    p |= {"omega0": 0.0, "epsilon": 0.001}
    rng = np.random.default_rng(1)
    signal = simulate_signal(osc, p, duration=25.0, samples=900, noise_sd=0.006, rng=rng)
    verdict = answer(signal, damping=["power"], restoring=["linear"]).verdict
    assert any("does not determine the exponent" in remark for remark in verdict.remarks)
    sure, *_ = found("cubic")
    assert not any("does not determine" in remark for remark in sure.remarks)  # control


def test_damping_by_displacement_is_no_viscous_damping_where_the_zero_is_not_recorded() -> None:
    """For a viscous decay in closed form: about a zero far from rest, (x - x0)²v would be viscous damping."""
    w, ratio = 2 * np.pi * 3.1, 0.028
    pole = complex(-ratio * w, w * np.sqrt(1 - ratio**2))
    t = np.arange(150) / 20
    clean = (0.003 * pole * np.exp(pole * t)).real
    noise = 0.05 * np.abs(clean).max() * np.random.default_rng(50).standard_normal(t.size)
    signal, asked = Signal(t, clean + noise, quantity="velocity"), ["viscous", "displacement", "cubic"]
    comparison = compare_signal(signal, damping=asked, restoring=["linear"])
    assert [r.candidate.damping for r in comparison.results] == [("viscous",)]
    assert {c.damping for c in comparison.refused} == {("displacement",), ("cubic",)}
