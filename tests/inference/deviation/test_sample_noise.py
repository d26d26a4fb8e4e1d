"""The noise of a record's samples, and how it reaches an answer. Truth by SciPy's own densities and closed forms."""

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.sample_noise import noises_of, prepared_for
from bayesdamp.inference.deviation.weighing import weigh_all
from bayesdamp.inference.noise._residuals import FittedNoise

GAPS = np.full(1999, 0.01)
T = 0.01 * np.arange(2000)
MADE = {"stiffness": 20.0, "duration": 12.0, "samples": 600, "noise_sd": 0.002}
ASKED = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "sample": False}
RATIO = 0.05 / 20.0**0.5


def test_variance_of_heavy_tails():
    """Student's Fisher information is (ν + 1)/(ν + 3)/σ²; 2000 samples leave a few per cent."""
    r = 0.1 * np.random.default_rng(2).standard_t(3.0, T.size)
    noise = FittedNoise("student_t", {"noise_sd": 0.1, "noise_dof": 3.0})
    assert noise.variance(r, np.cos(4 * T), GAPS) == pytest.approx(0.1**2 * 6 / 4, rel=0.1)


def test_variance_of_correlated_noise():
    """It is the power of an autoregressive process of order 1 at the frequency of the shift."""
    noise, rho = FittedNoise("correlated", {"noise_sd": 1.0, "noise_time": 0.05}), np.exp(-0.01 / 0.05)
    for frequency in (0.5, 30.0):
        power = (1 - rho**2) / (1 - 2 * rho * np.cos(0.01 * frequency) + rho**2)
        found = noise.variance(np.ones(T.size), np.cos(frequency * T), GAPS)
        assert found == pytest.approx(power, rel=0.05)


def spoilt(seed: int = 3) -> bd.Signal:
    """Return a record with 2 % of its samples far off."""
    rng = np.random.default_rng(seed)
    signal = bd.simulate({"viscous": 0.05}, "linear", seed=seed, theta0=0.3, **MADE)
    hit = rng.random(signal.t.size) < 0.02
    return bd.signal(signal.t, signal.y + hit * 0.1 * rng.standard_normal(signal.t.size))


def first_ratio(signal: bd.Signal, **asked: object):
    verdict = bd.compare(signal, **{**ASKED, **asked}).verdict
    return verdict, verdict.damping_ratio[0]


def test_outliers_are_seen_and_count_for_little():
    """The interval contains the truth and is at most half as wide as under Gaussian noise."""
    signal = spoilt()
    verdict, own = first_ratio(signal)
    _, plain = first_ratio(signal, noise="gaussian")
    assert any("student_t" in remark for remark in verdict.remarks)
    assert own.low < RATIO < own.high
    assert own.high - own.low < 0.5 * (plain.high - plain.low)


def test_gaussian_noise_stays_gaussian():
    signal = bd.simulate({"viscous": 0.05}, "linear", seed=4, theta0=0.3, **MADE)
    verdict, own = first_ratio(signal)
    _, plain = first_ratio(signal, noise="gaussian")
    assert not any("ahead of Gaussian noise" in remark for remark in verdict.remarks)
    assert (own.value, own.low, own.high) == (plain.value, plain.low, plain.high)


def test_white_noise_is_white_under_exact_laws():
    """For two records each; with correlated noise, the control, the variance near the oscillation is larger."""
    asked = [MotionCandidate(("viscous",), "linear")]
    for own in ({}, {"noise": "correlated", "noise_time": 0.1}):
        for seed in range(2):
            signal = bd.simulate({"viscous": 0.05}, "linear", seed=seed, theta0=0.3, **MADE, **own)
            assert (weigh_all(prepared(signal), asked, approximate=False).inflation == 1.0) == (not own)


def test_outliers_reach_the_answer_on_a_record_of_very_many_cycles():
    """One in fifty samples is off by many times the noise, which amplitudes and phases, as means over cycles, would
    show as Gaussian noise.

    Control: a record without outliers is averaged.
    """
    made = {"stiffness": 900.0, "duration": 100.0, "samples": 15_000, "noise_sd": 0.003, "seed": 3}
    for outliers, averages in ((0.0, True), (0.02, False)):
        signal = bd.simulate({"viscous": 0.02}, outliers=outliers, **made)
        data = prepared_for(signal, noises_of("auto"), {}, {}, average=True)
        assert (data.averaged is not None) == averages
