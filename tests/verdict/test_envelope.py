"""Verdicts on envelopes: simulated ring-downs and closed forms, alone and as repeats of one specimen."""

from dataclasses import replace

import numpy as np
import pytest

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
    result = verdict(ringdown(rates, 11, fall=30.0 if damping == "quadratic" else 45.0)[0])
    assert result.damping == damping
    assert result.probability > 0.7
    if power is not None:
        assert result.exponent.low - 0.02 <= power <= result.exponent.high + 0.02
    assert sum(result.probabilities.values()) == pytest.approx(1.0, abs=0.011)  # no more than 0.99 is claimed
    assert sum(item.share for item in result.energy) == pytest.approx(1.0, abs=0.05)


def test_a_drive_within_the_window_is_not_called_exact_and_widens_the_rate():
    """Control: the window that the program chooses leaves the drive out."""
    record, truth = ringdown({"viscous": 0.2}, 5, drop=0.0, before=20.0, hold=0.3)
    window = window_between(record.t, record.level, truth.release - 6.0, None)
    clean, driven = verdict(record), verdict(record, window)
    assert (clean.grade == "exact", driven.grade == "exact") == (True, False)
    assert clean.probability_exact > 0.5
    assert driven.deviation.value > 0.05
    width = [np.hypot(v.rate.sd_noise, v.rate.sd_law) for v in (clean, driven)]
    assert width[1] > 2 * width[0]


def test_damping_that_deviates_is_not_called_exact_and_the_curve_follows_it():
    """The true decay is within the band. Control: a straight line misses the decay by more than three times as much."""
    record, truth = ringdown({"viscous": 0.2}, 6, deviation=0.15, deviation_length=0.3)
    answer = analyse(record)
    result, curve = answer.verdict, answer.curve
    assert result.probability_exact < 0.5
    assert result.grade != "exact"
    assert result.deviation.high > 0.05
    assert "the law holds within" in result.sentence
    left = np.isfinite(truth.x)
    true = -40.0 + NEPER * np.interp(curve.t, truth.t[left], truth.x[left])
    early = curve.fit > -40.0 - 30.0
    assert np.mean(np.abs(true - curve.fit)[early] < 2 * curve.fit_sd[early] + 0.05) > 0.9
    line = np.polynomial.Polynomial.fit(curve.t[early], true[early], 1)(curve.t[early])
    by_curve, by_line = (np.median(np.abs(true[early] - x)) for x in (curve.fit[early], line))
    assert by_line > 3 * by_curve


@pytest.mark.parametrize("friction", [False, True])
def test_a_short_table_is_cut_at_its_release_and_its_noise_floor(friction):
    """Closed forms: four readings before the release, 16 of the decay, ten of noise at -32 dB. Control: the decay alone
    is not cut."""
    t = np.arange(30.0) - 4.0
    x = 1 - np.maximum(t, 0.0) / 17 if friction else np.exp(-0.2 * np.maximum(t, 0.0))
    noise = 10 ** (-35 / 20) * np.random.default_rng(1).standard_normal((2, t.size))
    readings = np.abs(np.maximum(x, 0.0) + noise[0] + 1j * noise[1])
    result = verdict(make_record("x", t, readings, "V"))
    assert 0.0 <= result.window.start <= 1.0
    assert 9.0 <= result.window.stop <= 16.0
    assert result.window.floor_db == pytest.approx(-32.0, abs=3.0)
    assert any("frequency is not known" in line for line in result.remarks)
    middle = result.decay_rate[1]
    true = 1 / (17 * middle.amplitude) if friction else 0.2
    assert middle.low <= true <= middle.high
    alone = verdict(make_record("x", t[4:20], readings[4:20], "V"))
    assert (alone.window.start, alone.window.stop) == (0.0, 15.0)


@pytest.mark.parametrize("frequency", [50.0, None])
def test_repeats_with_drag_are_pooled_at_amplitudes_that_all_reach(frequency):
    """The same drag, dA/dt = -0.5 A², recorded over falls of 10, 16 and 24 dB: the rate at amplitude A is 0.5 A."""
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
    next_low, next_high = common.next_value.low, common.next_value.high
    assert next_high / next_low < 1.05  # control: 8.5 for means over each record's own fall
    assert f" at {middle.amplitude:.3g} V" in common.sentence


def test_what_is_not_an_envelope_is_refused():
    t = np.linspace(0.0, 10.0, 200)
    with pytest.raises(InputError, match="below zero"):
        make_record("x", t, np.cos(9 * t), "V")
    with pytest.raises(InputError, match="time goes back at reading 3"):
        make_record("x", np.array([0.0, 2.0, 1.0]), np.ones(3), "V")
    flat = make_record("x", t, -50.0 + 0.1 * np.random.default_rng(0).random(200), "dBm")
    assert verdict(flat).grade == "no_free_decay"


def test_a_damping_is_not_decided_after_a_fall_of_a_few_decibels():
    """A fall of 6 dB in two seconds. Control: of 35 dB in twelve seconds."""
    t = 0.02 * np.arange(600)
    readings = 5.0 * np.exp(-0.35 * t) * np.exp(0.03 * np.random.default_rng(5).standard_normal(t.size))
    for count, decided in ((100, False), (600, True)):
        result = verdict(make_record("x", t[:count], readings[:count], "V", 3.0))
        assert (result.probability >= 0.95) is result.decided is decided
        assert any("falls by only" in line for line in result.remarks) is not decided


def test_the_error_of_a_rate_contains_that_of_the_sensor():
    """By hand: the linearity, and for a record in dB the drift of the gain over half of the decay.

    The law holds exactly and the noise is small, so nothing else contributes much: within a fifth."""
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


def test_coefficients_are_in_the_unit_of_the_amplitude():
    """Friction μ takes 2μ/πω of the amplitude a second: in volts, in the root of a power, or relative to the start."""
    t = 0.02 * np.arange(400)
    readings = (5.0 - 0.5 * t) * np.exp(0.003 * np.random.default_rng(4).standard_normal(t.size))
    mu = 0.5 * np.pi * (2 * np.pi * 3.0) / 2
    for level, unit, name, size in (
        (readings, "V", "V/s²", mu),
        (readings**2, "mW", "√mW/s²", mu),
        (readings**2, "V^2", "V/s²", mu),
        (20 * np.log10(readings), "dBV", "A_start/s²", mu / 5.0),
    ):
        result = verdict(make_record("x", t, level, unit, 3.0))
        assert result.damping == "coulomb"
        (coefficient,) = result.coefficients
        assert (coefficient.name, coefficient.unit) == ("mu_c", name)
        assert coefficient.value == pytest.approx(size, rel=0.02)


def test_a_record_of_another_specimen_increases_the_spread():
    """Its damping is 25 % larger. By hand for the others: the standard deviations due to the noise and to the law."""
    answers = [analyse(ringdown({"viscous": 0.2}, seed)[0]) for seed in (1, 2, 3)]
    other = analyse(ringdown({"viscous": 0.25}, 4)[0])
    same, mixed = specimen("x", answers), specimen("x", [*answers, other])
    assert same.spread.value < 0.05
    assert mixed.spread.value > 0.05
    number, each = same.quality_factor, [a.verdict.quality_factor for a in answers]
    sd = np.array([np.hypot(e.sd_noise, e.sd_law) / e.value for e in each])
    p = pool_records(np.log([e.value for e in each]), sd)
    assert number.value == pytest.approx(np.exp(p.mean), rel=1e-9)
    assert number.sd_noise == pytest.approx(number.value * np.sum(sd**-2.0) ** -0.5, rel=1e-9)
    assert np.hypot(number.sd_noise, number.sd_law) == pytest.approx(number.value * p.sd, rel=1e-9)
    assert same.sentence.startswith("3 records: Viscous damping")
    without_likelihoods = specimen("x", [replace(item, likelihoods={}) for item in answers])
    assert (without_likelihoods.damping, without_likelihoods.decided) == ("", False)
    assert specimen("x", answers[:1]) is None
    for sums, damping in (([("power",)], "power"), ([("power",), ("viscous",)], "")):
        pair = [analyse(ringdown({"viscous": 0.2}, seed)[0], sums=sums) for seed in (1, 2)]
        verdict = specimen("x", pair)
        has_none = np.isnan([share.probability for share in verdict.energy]).all()
        assert (verdict.damping, has_none) == (damping, not damping)
