"""Terms with parameters of their own, on records of the validation's solver: found again, or refused."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.findings import as_wide
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.interface.answer import answer
from bayesdamp.physics.damping import TERMS, all_sums, others
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogUniform, Normal, Uniform
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import InputError, Signal
from bayesdamp.verdict.types import Verdict
from tests.validation.laws import case

SEEDS = {
    "cubic": 1001,
    "displacement": 1000,
    "power": 1000,
    "structural": 1009,
    "stribeck": 1001,
    "dry_position": 1000,
}


@lru_cache
def found(term: str) -> tuple[Verdict, dict[str, float], float]:
    """Return the verdict on a record of a term among five candidates, its true parameters, and its share of the
    energy."""
    made = case(term, SEEDS[term])
    damping = ["viscous", "coulomb", "quadratic", term, f"viscous+{term}"]
    return answer(made.signal, damping=damping, restoring=["linear"]).verdict, made.values, made.share


@pytest.mark.parametrize(
    "term", ["cubic", *(pytest.param(n, marks=pytest.mark.slow) for n in others() if n != "cubic")]
)
def test_a_term_is_found_again(term: str) -> None:
    """Its parameters are within twice the reach of their 95 % intervals, with their own names and units.

    These are four standard deviations, a false alarm once in 16,000 seeds for each. `tests.validation.laws` counts
    how often the intervals contain the truth.
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
    assert len(verdict.damping_ratio) == 3
    assert all(0 < r.low < r.value < r.high for r in verdict.damping_ratio)


def test_what_is_there_already_is_not_bounded() -> None:
    verdict, *_ = found("cubic")
    assert "cubic" not in {b.form for b in verdict.other_forms}
    assert "structural" in {b.form for b in verdict.other_forms}


def test_terms_that_a_record_cannot_tell_are_said() -> None:
    """Where only five per cent of the amplitude is lost the exponent is not determined, and a remark states it."""
    osc, k = Oscillator(("power",), "linear"), 20.0
    p = {
        "c_power": 0.003,
        "exponent": 1.4,
        "stiffness": k,
        "rest_angle": 0.0,
        "theta0": 0.3,
        "omega0": 0.0,
        "epsilon": 0.001,
    }
    signal = simulate_signal(
        osc, p, duration=25.0, samples=900, noise_sd=0.006, rng=np.random.default_rng(1), name="weak"
    )
    verdict = answer(signal, damping=["power"], restoring=["linear"]).verdict
    assert any("does not determine the exponent" in remark for remark in verdict.remarks)
    sure, *_ = found("cubic")
    assert not any("does not determine" in remark for remark in sure.remarks)  # control


def test_an_interval_as_wide_as_the_prior() -> None:
    for prior in (
        Uniform(low=0, high=3),
        Normal(mean=0, sd=0.5),
        LogUniform(low=0.1, high=2),
        HalfNormal(scale=1),
    ):
        low, high = (0.05, 2.2) if prior.reflected else (-1.9, 1.9)
        ends = [float(prior.value(np.asarray(z))) for z in (low, high)]
        assert as_wide(prior, *ends)
        half = [float(prior.value(np.asarray(z))) for z in (low / 2, high / 2)]
        assert not as_wide(prior, *half)


def test_two_terms_with_one_parameter_are_refused() -> None:
    from bayesdamp.physics.damping import DampingTerm, parse_model

    other = type("Other", (type(TERMS.get("power")),), {"name": "other", "parameter": "c_other"})()
    assert isinstance(other, DampingTerm)
    TERMS.add("other", other, "")
    try:
        with pytest.raises(InputError, match="power and other both have a parameter 'exponent'"):
            parse_model("power+other")
    finally:
        TERMS.remove("other")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [83101, 83401])
def test_what_loses_alike_is_not_named_outright(seed: int) -> None:
    """For viscous and structural damping together, Occam's razor prefers one of them: it is named with reservation,
    and the statement on the other is true."""
    made = case("structural", seed)
    assert made.damping == "viscous+structural"
    damping = [*all_sums(), "structural", "viscous+structural"]
    verdict = answer(made.signal, damping=damping, restoring=["linear"]).verdict
    if verdict.damping == made.damping:
        return
    assert not verdict.decided
    other = {"structural": "viscous", "viscous": "structural"}[verdict.damping]
    bound = next(b.share_below for b in verdict.other_forms if b.form == other)
    share = made.share if other == "structural" else 1 - made.share
    assert any("differ only within a cycle" in remark for remark in verdict.remarks)
    assert share < bound + 0.05


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_damping_by_displacement_is_no_viscous_damping_where_the_zero_is_not_recorded(quantity: str) -> None:
    """For a viscous decay in closed form: about a zero far from rest, (x - x0)²v would be viscous damping."""
    w, ratio = 2 * np.pi * 3.1, 0.028
    pole = complex(-ratio * w, w * np.sqrt(1 - ratio**2))
    t = np.arange(150) / 20
    order = {"velocity": 1, "acceleration": 2}[quantity]
    clean = (0.003 * pole**order * np.exp(pole * t)).real
    noise = 0.05 * np.abs(clean).max() * np.random.default_rng(50).standard_normal(t.size)
    weighing = weighing_of(
        Signal(t, clean + noise, quantity=quantity), damping=["viscous", "displacement", "cubic"],
        restoring=["linear"],
    )  # fmt: skip
    logs = {r.candidate.damping[0]: r.log_evidence for r in weighing.results}
    assert logs["viscous"] - logs["displacement"] > 20
    assert abs(logs["displacement"] - logs["cubic"]) < 0.5 * (logs["viscous"] - logs["cubic"])
