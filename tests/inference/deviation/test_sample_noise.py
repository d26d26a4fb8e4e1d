"""The noise of a record's samples, and how it reaches an answer. Truth by SciPy's own densities and closed forms."""

import numpy as np
import pytest
from scipy.stats import t as student_t

import bayesdamp as bd
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.model_comparison import compare_candidates
from bayesdamp.inference.deviation.quick import compare_signal
from bayesdamp.inference.deviation.sample_noise import noises_of, prepare_for_noises
from tests.physics.independent import viscous

MADE = {"stiffness": 20.0, "duration": 12.0, "samples": 600, "noise_sd": 0.002}
ASKED = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "sample": False}
RATIO = 0.05 / 20.0**0.5


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


@pytest.mark.parametrize(("noise_time", "white"), [(None, True), (0.1, False)])
def test_white_noise_is_white_under_exact_laws(noise_time: float | None, white: bool):
    """For four records each; with correlated noise, the control, the variance near the oscillation is larger."""
    own = {} if noise_time is None else {"noise": "correlated", "noise_time": noise_time}
    factors = []
    for seed in range(4):
        signal = bd.simulate({"viscous": 0.05}, "linear", seed=seed, theta0=0.3, **MADE, **own)
        asked = [MotionCandidate(("viscous",), "linear")]
        factors.append(compare_candidates(prepare_data(signal), asked, approximate=False).inflation)
    assert all((one == 1.0) == white for one in factors)


def test_what_a_wrong_law_leaves_is_no_heavy_tail():
    """For a stiffening spring under a linear law, residuals are large only at first, and smooth."""
    signal = bd.simulate({"viscous": 0.05}, "duffing", cubic=3.0, seed=5, theta0=0.5, **MADE)
    verdict, _ = first_ratio(signal)
    assert not any("ahead of Gaussian noise" in remark for remark in verdict.remarks)


@pytest.mark.parametrize("cycles", [450, 3000])
def test_heavy_tails_over_very_many_cycles_count_for_little(cycles: int):
    """Student's Fisher information is (ν + 1)/(ν + 3)/σ²: with ν = 3 amplitudes and phases vary half as much as
    under least squares, as the samples' variance is 3σ². Both variances are known from 190 values, to a tenth.

    Control: Gaussian noise stays Gaussian, and what is asked for is used.
    """
    frequency = 30.0
    t = np.linspace(0, 2 * np.pi * cycles / frequency, 25 * cycles)
    rng, ratio = np.random.default_rng(7), 1.5 / (2 * np.pi * cycles)
    motion = viscous(t, ratio * frequency, frequency, 0.3)
    asked = {"damping": ["viscous"], "restoring": ["linear"], "approximate": False}
    heavy = bd.signal(t, motion + 0.003 * rng.standard_t(3.0, t.size))
    own, plain = (compare_signal(heavy, noises=noises_of(noise), **asked) for noise in ("auto", "gaussian"))
    assert own.noise.name == "student_t"
    assert own.variance == pytest.approx(0.5 * plain.variance, rel=0.25)
    assert own.best.fit.parameters.named(own.best.z)["zeta"] / frequency == pytest.approx(ratio, rel=0.01)
    even = bd.signal(t, motion + 0.003 * rng.standard_normal(t.size))
    assert compare_signal(even, noises=noises_of("auto"), **asked).noise.name == "gaussian"
    assert compare_signal(even, noises=("student_t",), **asked).noise.name == "student_t"


def test_a_fit_to_amplitudes_and_phases_has_its_noise_from_a_file(tmp_path):
    """One sample in fifty is off by many times the noise; the interval contains the truth."""
    made = {"stiffness": 900.0, "duration": 100.0, "samples": 15_000, "noise_sd": 0.003, "outliers": 0.02}
    signal = bd.simulate({"viscous": 0.02}, seed=3, **made)
    fit = bd.fit(signal, bd.Model("viscous", restoring="linear", deviation="law"))
    assert fit.noise == "student_t"
    assert fit.intervals["zeta"][0] < 0.02 < fit.intervals["zeta"][1]
    fit.save(tmp_path / "fit.npz")
    assert bd.load(tmp_path / "fit.npz").intervals == fit.intervals


def test_the_noise_of_amplitudes_and_phases_is_fitted_again_to_their_own_residual():
    """SciPy's fit to the residual of the final amplitudes and phases. Control: the scale in the residual of least
    squares, to which the noise is fitted first, is 5 % larger."""
    cycles, frequency = 450, 30.0
    t = np.linspace(0, 2 * np.pi * cycles / frequency, 25 * cycles)
    y = viscous(t, 1.5 / t[-1], frequency, 0.3) + 0.003 * np.random.default_rng(7).standard_t(3.0, t.size)
    data = prepare_for_noises(bd.signal(t, y), ("gaussian", "student_t"), {}, {}, average=True)
    first = prepare_data(bd.signal(t, y))
    scales = [student_t.fit(d.averaged.residual, floc=0.0)[2] for d in (data, first)]
    assert data.noise_model.fitted.values["noise_sd"] == pytest.approx(scales[0], rel=0.015)
    assert scales[1] > 1.05 * scales[0]
