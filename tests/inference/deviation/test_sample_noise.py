"""The noise of the samples and its effect on answers, against closed forms."""

import numpy as np
import pytest
from scipy.stats import t as student_t

import bayesdamp as bd
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.model_comparison import compare_candidates
from bayesdamp.inference.deviation.sample_noise import noises_of, prepare_for_noises
from tests.physics.independent import viscous

SIMULATED = {"stiffness": 20.0, "duration": 12.0, "samples": 600, "noise_sd": 0.002}
OPTIONS = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "sample": False}
RATIO = 0.05 / 20.0**0.5


def first_ratio(signal: bd.Signal, **options: object):
    verdict = bd.compare(signal, **{**OPTIONS, **options}).verdict
    return verdict, verdict.damping_ratio[0]


def test_outliers_are_reported_and_have_little_influence():
    """With 2 % of the samples far off, the interval contains the truth and is at most half as wide as with Gaussian
    noise."""
    rng = np.random.default_rng(3)
    signal = bd.simulate({"viscous": 0.05}, "linear", seed=3, theta0=0.3, **SIMULATED)
    is_outlier = rng.random(signal.t.size) < 0.02
    signal = bd.signal(signal.t, signal.y + is_outlier * 0.1 * rng.standard_normal(signal.t.size))
    verdict, own = first_ratio(signal)
    _, plain = first_ratio(signal, noise="gaussian")
    models = {name: OPTIONS[name] for name in ("damping", "restoring")}
    noise = compare_signal(signal, noises=noises_of("auto"), **models).noise
    freedom = f"(student_t, {noise.fitted.values['noise_dof']:.2g} degrees of freedom)"
    assert any(f"{freedom} is {noise.ahead:.0f} nats ahead of" in remark for remark in verdict.remarks)
    assert own.low < RATIO < own.high
    assert own.high - own.low < 0.5 * (plain.high - plain.low)


def test_refits_find_the_noise_of_a_short_record_with_outliers():
    """Five of 80 samples are 20 to 50 sds off. The scale of Student's t is less than twice the sd of the other samples.

    The log of their ratio is −0.44 ± 0.15 in 64 such records: the false-alarm rate is below 1e-8. Control: in the
    residual of least squares the sd is more than five times as large."""
    sd, rng, t = 0.001, np.random.default_rng(99), np.linspace(0.0, 6.0, 80)
    y = viscous(t, 0.16, 20.0**0.5, 0.2) + sd * rng.standard_normal(80)
    y[rng.choice(80, 5, replace=False)] += sd * rng.uniform(20.0, 50.0, 5) * rng.choice([-1, 1], 5)
    candidate, data = MotionCandidate(("viscous", "coulomb"), "linear"), prepare_data(bd.signal(t, y))
    noise = compare_candidates(data, [candidate], known={"epsilon": 1e-3}).noise
    assert noise.fitted.values["noise_sd"] < 2 * sd
    assert noise.weighed[0].values["noise_sd"] > 5 * sd


@pytest.mark.parametrize(("noise_time", "white"), [(None, True), (0.1, False)])
def test_the_variance_near_the_oscillation_is_larger_only_for_correlated_noise(
    noise_time: float | None, white: bool
):
    """In four records, under exact laws."""
    own = {} if noise_time is None else {"noise": "correlated", "noise_time": noise_time}
    factors = []
    for seed in range(4):
        signal = bd.simulate({"viscous": 0.05}, "linear", seed=seed, theta0=0.3, **SIMULATED, **own)
        candidates = [MotionCandidate(("viscous",), "linear")]
        factors.append(compare_candidates(prepare_data(signal), candidates, approximate=False).inflation)
    assert all((factor == 1.0) == white for factor in factors)


def test_residuals_of_a_wrong_law_are_not_taken_for_heavy_tails():
    """For a stiffening spring under a linear law, whose residuals are smooth, and large only at first."""
    signal = bd.simulate({"viscous": 0.05}, "duffing", cubic=3.0, seed=5, theta0=0.5, **SIMULATED)
    assert not any("ahead of Gaussian noise" in remark for remark in first_ratio(signal)[0].remarks)


@pytest.mark.parametrize("cycles", [450, 3000])
def test_heavy_tails_over_very_many_cycles_have_little_influence(cycles: int):
    """Student's Fisher information is (ν + 1)/(ν + 3)/σ²: with ν = 3 amplitudes and phases vary half as much as
    with least squares, because the variance of the samples is 3σ². Both variances are determined to a tenth.

    Control: Gaussian noise is identified as such, and a noise model that is requested is used.
    """
    frequency = 30.0
    t = np.linspace(0, 2 * np.pi * cycles / frequency, 25 * cycles)
    rng, ratio = np.random.default_rng(7), 1.5 / (2 * np.pi * cycles)
    motion = viscous(t, ratio * frequency, frequency, 0.3)
    options = {"damping": ["viscous"], "restoring": ["linear"], "approximate": False}
    heavy = bd.signal(t, motion + 0.003 * rng.standard_t(3.0, t.size))
    own, plain = (compare_signal(heavy, noises=noises_of(noise), **options) for noise in ("auto", "gaussian"))
    assert own.noise.name == "student_t"
    assert own.variance == pytest.approx(0.5 * plain.variance, rel=0.25)
    assert own.best.fit.parameters.named(own.best.z)["zeta"] / frequency == pytest.approx(ratio, rel=0.01)
    normal = bd.signal(t, motion + 0.003 * rng.standard_normal(t.size))
    assert compare_signal(normal, noises=noises_of("auto"), **options).noise.name == "gaussian"
    assert compare_signal(normal, noises=("student_t",), **options).noise.name == "student_t"


def test_a_fit_to_amplitudes_and_phases_is_the_same_after_saving_and_loading(tmp_path):
    """One sample in fifty is an outlier. The interval contains the truth."""
    options = {"stiffness": 900.0, "duration": 100.0, "samples": 15_000, "noise_sd": 0.003, "outliers": 0.02}
    signal = bd.simulate({"viscous": 0.02}, seed=3, **options)
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
    scales = [student_t.fit(d.averaged.residual, floc=0.0)[2] for d in (data, prepare_data(bd.signal(t, y)))]
    assert data.noise_model.fitted.values["noise_sd"] == pytest.approx(scales[0], rel=0.015)
    assert scales[1] > 1.05 * scales[0]
