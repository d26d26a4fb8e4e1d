"""One damping for several records: probabilities and sizes by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import DampingRatio, Grade, Interval, Share
from bayesdamp.verdict.pooled import pooled
from bayesdamp.verdict.specimen import Answered, OtherForm, at_amplitude, specimen
from bayesdamp.verdict.types import Verdict

AMPLITUDE = np.array([0.1, 0.2, 0.4])


def answered(
    name: str,
    ratio: float,
    log_evidence: dict[tuple[str, str], float],
    grade: Grade = Grade.EXACT,
    unnamed: Interval | None = None,
    spread: float = 1.02,
) -> Answered:
    """A record whose damping ratio is the same at all amplitudes, known to ±1.96 ln(spread)/1.96."""
    shares = (Share("viscous", 0.6, 0.5, 0.7, 1.0), Share("quadratic", 0.4, 0.3, 0.5, 1.0))
    verdict = Verdict(
        name,
        grade,
        True,
        max(log_evidence, key=lambda k: log_evidence[k])[0],
        0.9,
        energy=shares,
        damping_ratio=(DampingRatio(0.2, "deg", ratio, 0, 0, 0, 0),),
        frequency=Interval(2.0, 1.9, 2.1, "Hz"),
        deviation=Interval(0.02 * len(name), 0.0, 0.1),
        unnamed=unnamed,
    )
    flat = np.full(3, ratio)
    curve = {"amplitude": AMPLITUDE, "ratio": flat, "low": flat / spread, "high": flat * spread}
    return Answered(verdict, log_evidence, curve)


V, Q = ("viscous", "linear"), ("quadratic", "linear")


def test_probabilities_are_those_of_the_summed_log_evidence() -> None:
    found = specimen("rig", [answered("a", 0.01, {V: 0.0, Q: -1.0}), answered("b", 0.01, {V: -0.5, Q: 0.0})])
    assert found.damping == "viscous"
    assert found.probability == pytest.approx(1 / (1 + np.exp(-0.5)))
    assert [(r.damping, pytest.approx(r.probability)) for r in found.rivals] == [
        ("quadratic", 1 / (1 + np.exp(0.5)))
    ]
    assert not found.decided
    assert "Records by themselves are likeliest: viscous 1, quadratic (drag) 1." in found.remarks


def test_how_far_a_law_holds_is_the_specimens_not_the_records() -> None:
    """By hand: four records, each of which prefers another law by a nat to viscous damping with deviations of one size.
    That this size was unlikely counts once. Control: it counts four times where the records do not say it."""
    prior = grid_of(4).log_prior
    size = int(np.argmin(prior))
    told = np.where(np.arange(prior.size) == size, -prior[size], -np.inf)
    logs = {V: 0.0, Q: 1.0}
    each = [replace(answered(n, 0.01, logs), sizes={V: told, Q: np.zeros(prior.size)}) for n in "abcd"]
    ahead = -3 * prior[size] - 4
    assert ahead > 20
    found = specimen("rig", each)
    assert found.damping == "viscous"
    assert found.rivals[0].probability == pytest.approx(np.exp(-ahead), rel=1e-6)
    assert "Records by themselves are likeliest: quadratic (drag) 4." in found.remarks
    apart = specimen("rig", [replace(one, sizes={}) for one in each])
    assert apart.damping == "quadratic"
    assert apart.rivals[0].probability == pytest.approx(1 / (1 + np.exp(4)))


def test_a_sum_of_three_is_half_as_likely_before() -> None:
    three = ("viscous+coulomb+quadratic", "linear")
    found = specimen("rig", [answered("a", 0.01, {V: 0.0, three: 0.0})])
    assert found.probability == pytest.approx(2 / 3)


def test_a_damping_that_a_record_did_not_weigh_is_far_behind() -> None:
    found = specimen("rig", [answered("a", 0.01, {V: 0.0, Q: 2.0}), answered("b", 0.01, {V: 0.0})])
    assert found.damping == "viscous"
    assert found.probability == thresholds.CAP
    assert found.decided


def test_another_form_that_is_ahead_in_every_record_is_ahead_of_all() -> None:
    """By hand: in two records 3 nats ahead of viscous damping, with a tenth of its prior shared by two forms; in one
    of them under another law, that is as good."""
    hard = "viscous", "duffing"
    power, stribeck = OtherForm("power", "linear", 3.0), OtherForm("stribeck", "linear", -2.0, "coulomb")
    one = replace(answered("a", 0.01, {V: 0.0, hard: -40.0}), others=(power, stribeck))
    two = replace(answered("b", 0.01, {V: 0.0, hard: -40.0}), others=(power,))
    found = specimen("rig", [one, two])
    alone = math.exp(6) * 0.05
    assert found.damping == "viscous"
    assert found.probability == pytest.approx(1 / (1 + alone), rel=1e-6)
    assert found.rivals[0].damping == "power"
    assert not found.decided
    elsewhere = replace(power, restoring="duffing", log_evidence=-37.0)
    moved = specimen("rig", [one, replace(two, others=(elsewhere,))])
    assert moved.probability == pytest.approx(found.probability)
    behind = specimen("rig", [one, replace(two, others=())])
    assert behind.probability == pytest.approx(1.0, abs=0.02)
    assert behind.rivals == () or behind.rivals[0].probability < 1e-10


def test_another_form_that_was_not_weighed_is_the_sum_that_it_comes_to() -> None:
    """Friction that rises near rest, weighed in one record of two."""
    c = "coulomb", "linear"
    stribeck = OtherForm("stribeck", "linear", 5.0, "coulomb")
    one = replace(answered("a", 0.01, {c: 0.0, V: -9.0}), others=(stribeck,))
    found = specimen("rig", [one, answered("b", 0.01, {c: -1.0, V: 0.0})])
    assert found.damping == "coulomb"
    weights = {"coulomb": math.exp(-1), "viscous": math.exp(-9), "stribeck": 0.1 * math.exp(5 - 1)}
    assert found.probability == pytest.approx(weights["coulomb"] / sum(weights.values()))


def test_sizes_are_pooled_in_the_logarithm() -> None:
    records = [answered(n, r, {V: 0.0}) for n, r in (("a", 0.010), ("b", 0.012), ("c", 0.011))]
    found = specimen("rig", records)
    sd = 2 * np.log(1.02) / 3.92
    p = pooled(np.log([0.010, 0.012, 0.011]), np.full(3, sd))
    for one in found.damping_ratio:
        value = np.exp(p.mean)
        assert (one.value, one.low, one.high) == pytest.approx((value, np.exp(p.low), np.exp(p.high)))
        assert (one.sd_noise, one.sd_law) == pytest.approx((value * p.sd, value * p.spread))
        assert 0.1 < one.amplitude < 0.4
        assert one.unit == "deg"
    assert found.damping_ratio[1].amplitude == pytest.approx(0.2)
    assert f"{100 * p.spread:.2g} %" in found.remarks[0]
    assert found.frequency is not None
    assert found.frequency.value == pytest.approx(2.0)


def test_the_worst_grade_and_the_largest_deviation_are_the_specimens() -> None:
    records = [
        answered("a", 0.01, {V: 0.0}, unnamed=Interval(0.1, 0.0, 0.2)),
        answered("bb", 0.01, {V: 0.0}, grade=Grade.DEVIATES, unnamed=Interval(0.3, 0.2, 0.4)),
    ]
    found = specimen("rig", records)
    assert found.grade is Grade.DEVIATES
    assert not found.decided
    assert found.deviation == Interval(0.04, 0.0, 0.1)
    assert found.unnamed == Interval(0.3, 0.2, 0.4)
    assert [(s.term, s.share, s.low, s.high) for s in found.energy] == [
        ("viscous", 0.6, 0.5, 0.7),
        ("quadratic", 0.4, 0.3, 0.5),
    ]


def test_no_record_is_a_fault() -> None:
    with pytest.raises(ValueError, match="needs a record"):
        specimen("rig", [])


def test_a_curve_is_read_in_the_logarithm() -> None:
    """A power law is a straight line there, whatever the order of its points."""
    curve = {"amplitude": AMPLITUDE[::-1], "ratio": AMPLITUDE[::-1], "low": AMPLITUDE[::-1] / 1.1,
             "high": AMPLITUDE[::-1] * 1.1}  # fmt: skip
    value, sd = at_amplitude(curve, 0.3)
    assert value == pytest.approx(np.log(0.3))
    assert sd == pytest.approx(2 * np.log(1.1) / 3.92)
