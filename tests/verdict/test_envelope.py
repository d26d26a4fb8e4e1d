"""Dampings recovered from simulated envelopes, coverage, and what a drive or a wrong cut does to a verdict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import EnvelopeRecord, make_record
from bayesdamp.records.envelope.window import EnvelopeWindow, window_between
from bayesdamp.types import InputError
from bayesdamp.verdict import Verdict
from bayesdamp.verdict.envelope import specimen
from bayesdamp.verdict.specimen import pool_records
from validation.truth.ringdowns import NEPER, Ringdown, simulate

RING = {"fall": 45.0, "scatter": 0.02, "scatter_time": 0.5, "behind": 15.0}


def ringdown(rates, seed, **more):
    result = simulate(Ringdown(rates, **{**RING, **more}), np.random.default_rng(seed))
    return make_record("x", result.t, result.level, "dBm", 1e6), result


def verdict(record: EnvelopeRecord, window: EnvelopeWindow | None = None) -> Verdict:
    return analyse(record, window).verdict


@pytest.mark.parametrize(
    ("rates", "damping", "power"),
    [
        ({"viscous": 0.2}, "viscous", 1.0),
        ({"quadratic": 1.5}, "quadratic", 2.0),
        ({"viscous": 0.1, "coulomb": 0.02}, "viscous+coulomb", None),
    ],
)
def test_the_damping_that_made_a_record_is_named(rates, damping, power):
    fall = 30.0 if damping == "quadratic" else 45.0
    result = verdict(ringdown(rates, 11, fall=fall)[0])
    assert result.damping == damping
    assert result.probability > 0.7
    if power is not None:
        assert result.exponent.low - 0.02 <= power <= result.exponent.high + 0.02
    assert sum(result.probabilities.values()) == pytest.approx(1.0, abs=0.011)  # no more than 0.99 is claimed
    assert sum(item.share for item in result.energy) == pytest.approx(1.0, abs=0.05)


def test_a_drive_that_is_left_in_is_seen():
    """Negative control: the held drive within the bounds that are asked for."""
    record, truth = ringdown({"viscous": 0.2}, 5, drop=0.0, before=20.0, hold=0.3)
    window = window_between(record.t, record.level, truth.release - 6.0, None)
    clean, driven = verdict(record), verdict(record, window)
    assert (clean.grade == "exact", driven.grade == "exact") == (True, False)
    assert clean.probability_exact > 0.5
    assert driven.deviation.value > 0.05
    width = [np.hypot(v.rate.sd_noise, v.rate.sd_law) for v in (clean, driven)]
    assert width[1] > 2 * width[0]


def test_a_law_that_bends_is_not_called_exact_and_its_curve_is_followed():
    """The true decay is within its band. Negative control: the straight line of the law misses it by thrice as much."""
    record, truth = ringdown({"viscous": 0.2}, 6, deviation=0.15, deviation_length=0.3)
    answer = analyse(record)
    result, curve = answer.verdict, answer.curve
    assert result.probability_exact < 0.5  # 0.8 before
    assert result.grade != "exact"
    assert result.deviation.high > 0.05
    assert "the law holds within" in result.sentence
    left = np.isfinite(truth.x)
    true = -40.0 + NEPER * np.interp(curve.t, truth.t[left], truth.x[left])
    early = curve.fit > -40.0 - 30.0
    assert np.mean(np.abs(true - curve.fit)[early] < 2 * curve.fit_sd[early] + 0.05) > 0.9
    line = np.polynomial.Polynomial.fit(curve.t[early], true[early], 1)(curve.t[early])
    missed, by_line = (np.median(np.abs(true[early] - x)) for x in (curve.fit[early], line))
    assert by_line > 3 * missed


def test_a_table_of_half_lives():
    """Ten readings, one a half-life, to 2 %: the rate is ln 2 over 12 s."""
    readings = 3.0 * 0.5 ** np.arange(10) * np.exp(0.02 * np.random.default_rng(2).standard_normal(10))
    result = verdict(make_record("x", 12.0 * np.arange(10), readings, "mm"))
    assert result.rate.low <= np.log(2) / 12 <= result.rate.high
    assert result.rate.high / result.rate.low < 1.3
    assert result.quality_factor is None
    assert result.decay_rate[0].unit == "mm"
    assert any("frequency is not known" in line for line in result.remarks)


@pytest.mark.parametrize("friction", [False, True])
def test_a_short_table_is_cut_at_its_release_and_its_floor(friction):
    """Closed forms: four readings before the release, 16 of the decay, ten of noise at -32 dB. Control: the decay."""
    t = np.arange(30.0) - 4.0
    x = 1 - np.maximum(t, 0.0) / 17 if friction else np.exp(-0.2 * np.maximum(t, 0.0))
    noise = 10 ** (-35 / 20) * np.random.default_rng(1).standard_normal((2, t.size))
    readings = np.abs(np.maximum(x, 0.0) + noise[0] + 1j * noise[1])
    result = verdict(make_record("x", t, readings, "V"))
    assert 0.0 <= result.window.start <= 1.0
    assert 9.0 <= result.window.stop <= 16.0
    assert result.window.floor_db == pytest.approx(-32.0, abs=3.0)
    middle = result.decay_rate[1]
    true = 1 / (17 * middle.amplitude) if friction else 0.2
    assert middle.low <= true <= middle.high
    alone = verdict(make_record("x", t[4:20], readings[4:20], "V"))
    assert (alone.window.start, alone.window.stop) == (0.0, 15.0)


def test_repeats_are_pooled():
    answers = [analyse(ringdown({"viscous": 0.2}, seed)[0]) for seed in (1, 2, 3)]
    common = specimen("x", answers)
    assert common.records == 3
    assert common.quality_factor.low <= np.pi * 1e6 / 0.2 <= common.quality_factor.high
    assert common.next_value.low < common.quality_factor.low
    assert common.standardised < 5
    assert common.sentence.startswith("3 records: Viscous damping")
    # Negative control: one record of another specimen.
    other = analyse(ringdown({"viscous": 0.25}, 4)[0])
    mixed = specimen("x", [*answers, other])
    assert mixed.standardised > 10
    assert mixed.spread.value > 0.05
    assert specimen("x", answers[:1]) is None
    # Sums whose terms have parameters beside coefficients cannot be joined: the specimen has a size alone.
    sized = specimen("x", [replace(item, likelihoods={}) for item in answers])
    assert (sized.damping, sized.decided) == ("", False)
    assert sized.sentence.startswith("3 records: Q = ")


@pytest.mark.parametrize("frequency", [50.0, None])
def test_repeats_that_are_not_viscous_are_pooled_at_amplitudes_that_they_share(frequency):
    """One drag, dA/dt = -0.5 A², recorded over falls of 10, 16 and 24 dB: its rate at A is 0.5 A."""
    answers = []
    for seed, fall in ((1, 10.0), (2, 16.0), (3, 24.0)):
        t = np.linspace(0.0, (10 ** (fall / 20) - 1) / 0.5, 200)
        noise = 0.01 * np.random.default_rng(seed).standard_normal(t.size)
        answers.append(analyse(make_record("x", t, np.exp(noise) / (1 + 0.5 * t), "V", frequency)))
    common = specimen("x", answers)
    assert common.damping == "quadratic"
    assert len(common.decay_rate) == 3
    for row in common.decay_rate:
        assert row.low <= 0.5 * row.amplitude <= row.high
    for row in common.quality_factor_at:
        assert row.low <= np.pi * 50 / (0.5 * row.amplitude) <= row.high
    middle = common.decay_rate[1]
    true = np.pi * 50 / (0.5 * middle.amplitude) if frequency else 0.5 * middle.amplitude
    assert common.next_value.low <= true <= common.next_value.high
    assert common.standardised < 5  # 3,400 for the means over each record's own fall
    assert f" at {middle.amplitude:.3g} V" in common.sentence


def test_what_is_no_envelope_is_refused():
    t = np.linspace(0.0, 10.0, 200)
    with pytest.raises(InputError, match="have both signs"):
        make_record("x", t, np.cos(9 * t), "V")
    with pytest.raises(InputError, match="time goes back at reading 3"):
        make_record("x", np.array([0.0, 2.0, 1.0]), np.ones(3), "V")
    flat = make_record("x", t, -50.0 + 0.1 * np.random.default_rng(0).random(200), "dBm")
    assert verdict(flat).grade == "no_free_decay"


def test_two_dampings_that_an_envelope_cannot_tell_are_not_decided():
    """A fall of 6 dB in two seconds. Control: of 35 dB."""
    t = 0.02 * np.arange(600)
    readings = 5.0 * np.exp(-0.35 * t) * np.exp(0.03 * np.random.default_rng(5).standard_normal(t.size))
    for count, decided in ((100, False), (600, True)):
        result = verdict(make_record("x", t[:count], readings[:count], "V", 3.0))
        assert (result.probability >= 0.95) is result.decided is decided
        assert any("falls by only" in line for line in result.remarks) is not decided


def test_no_rate_is_known_better_than_the_sensor():
    """Its error alone: the linearity, and of a record in dB the drift of its gain over half of the decay; both within a
    fifth, where the law holds exactly and the readings are good."""
    t = 0.02 * np.arange(400)
    readings = 5.0 * np.exp(-0.5 * t + 0.002 * np.random.default_rng(3).standard_normal(t.size))
    decibels = 20 * np.log10(readings)
    for level, unit, fall in ((readings, "V", np.inf), (decibels, "dBV", 20 * np.log10(np.exp(0.5 * t[-1])))):
        result = verdict(make_record("x", t, level, unit, 3.0))
        (_, middle, _) = result.decay_rate
        assert middle.value == pytest.approx(0.5, rel=0.01)
        assert middle.sd_law == pytest.approx(0.5 * np.hypot(0.002, 0.1 / (0.5 * fall)), rel=0.2)
        assert result.window.cycles == pytest.approx(3.0 * (result.window.stop - result.window.start))
        ratio = middle.value / (2 * np.pi * 3.0)
        assert result.damping_ratio[1].value == pytest.approx(ratio, rel=1e-3)
        assert result.quality_factor_at[1].value == pytest.approx(0.5 / ratio, rel=1e-3)
        assert middle.amplitude == pytest.approx(level[np.argmin(np.abs(t - 0.5 * t[-1]))], rel=0.05)


def test_coefficients_have_the_unit_of_the_readings_amplitude():
    """Friction takes a fixed amplitude a second, 2μ/πω: in volts, in the root of a power, or in shares of the start."""
    t = 0.02 * np.arange(400)
    readings = (5.0 - 0.5 * t) * np.exp(0.003 * np.random.default_rng(4).standard_normal(t.size))
    mu = 0.5 * np.pi * (2 * np.pi * 3.0) / 2
    for level, unit, named, size in (
        (readings, "V", "V/s²", mu),
        (readings**2, "mW", "√mW/s²", mu),
        (readings**2, "V^2", "V/s²", mu),
        (20 * np.log10(readings), "dBV", "A_start/s²", mu / 5.0),
    ):
        result = verdict(make_record("x", t, level, unit, 3.0))
        assert result.damping == "coulomb"
        (coefficient,) = result.coefficients
        assert (coefficient.name, coefficient.unit) == ("mu_c", named)
        assert coefficient.value == pytest.approx(size, rel=0.02)


def test_the_head_states_another_quality():
    record = replace(ringdown({"viscous": 0.2}, 1)[0], facts={"Quality factor": "2e7 (supplier)"})
    result = verdict(record)
    own = result.quality_factor
    off = (2e7 - own.value) / np.hypot(own.sd_noise, own.sd_law)
    assert (
        f"states Q = 2 × 10⁷, which is {off:.1f} standard deviations above the Q of this result."
        in " ".join(result.remarks)
    )


@pytest.mark.parametrize("frequency", [1e6, None])
def test_numbers_of_repeats_are_pooled_as_logarithms(frequency):
    """By hand: of records with stated rates and sds. Without a frequency the rates are pooled, and the damping too."""
    answers = []
    for seed, scale in ((1, 1.0), (2, 1.03), (3, 0.98)):
        answer = analyse(replace(ringdown({"viscous": 0.2}, seed)[0], frequency=frequency))
        rate, quality = answer.verdict.rate, answer.verdict.quality_factor
        changed = replace(answer.verdict, rate=replace(rate, value=0.2 * scale))
        if quality is not None:
            changed = replace(changed, quality_factor=replace(quality, value=1.5e7 * scale))
        answers.append(replace(answer, verdict=changed))
    found = specimen("x", answers)
    each = [a.verdict.quality_factor if frequency else a.verdict.rate for a in answers]
    x = np.log([e.value for e in each])
    sd = np.array([np.hypot(e.sd_noise, e.sd_law) / e.value for e in each])
    p, common = pool_records(x, sd), found.quality_factor if frequency else found.rate
    assert (found.rate is None, found.quality_factor is None) == (bool(frequency), not frequency)
    assert common.value == pytest.approx(np.exp(p.mean), rel=1e-9)
    assert common.sd_noise == pytest.approx(common.value * np.sum(sd**-2.0) ** -0.5, rel=1e-9)
    assert np.hypot(common.sd_noise, common.sd_law) == pytest.approx(common.value * p.sd, rel=1e-9)
    assert (common.low, common.high) == pytest.approx(tuple(np.exp(norm.interval(0.95, p.mean, p.sd))))
    assert (found.next_value.low, found.next_value.high) == pytest.approx((np.exp(p.low), np.exp(p.high)))
    middle = np.sum(x / sd**2) / np.sum(sd**-2.0)
    assert found.standardised == pytest.approx(np.sum(((x - middle) / sd) ** 2) / 2, rel=1e-9)
    assert found.damping == "viscous"
    assert found.probability > 0.9
