"""The noise of a record's samples, and how it reaches an answer. Truth by SciPy's own densities and closed forms."""

import numpy as np
import pytest
from scipy import optimize, stats

import bayesdamp as bd
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.deviation.weighing import weigh_all
from bayesdamp.inference.noise import FittedNoise
from tests.physics.independent import viscous

GAPS = np.full(1999, 0.01)
T = 0.01 * np.arange(2000)
MADE = {"stiffness": 20.0, "duration": 12.0, "samples": 600, "noise_sd": 0.002}
ASKED = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "sample": False}
RATIO = 0.05 / 20.0**0.5


def straight_line(noise: FittedNoise, y: np.ndarray, columns: np.ndarray, rounds: int) -> np.ndarray:
    """Return coefficients by repeated least squares to working residuals."""
    c = np.linalg.lstsq(columns, y, rcond=None)[0]
    for _ in range(rounds):
        r = y - columns @ c
        variance = noise.variance(r, columns[:, 0], GAPS)
        working = columns @ c + noise.working_residuals(r, GAPS, variance)
        c = np.linalg.lstsq(columns, working, rcond=None)[0]
    return c


def test_working_residuals_lead_to_the_mode_of_the_density():
    """SciPy's maximum of Student's likelihood; one fit to the record itself is far from it."""
    rng = np.random.default_rng(1)
    columns = np.column_stack([np.cos(4 * T), np.sin(4 * T)])
    y = columns @ [1.0, 0.5] + 0.05 * rng.standard_t(2.0, T.size)
    noise = FittedNoise("student_t", {"noise_sd": 0.05, "noise_dof": 2.0})

    def depth(c: np.ndarray) -> float:
        return -float(np.sum(stats.t.logpdf((y - columns @ c) / 0.05, 2.0)))

    best = optimize.minimize(
        depth, [1.0, 0.5], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-9}
    ).x
    sd = 0.05 * np.sqrt(2 / T.size)
    assert np.abs(straight_line(noise, y, columns, 20) - best).max() < 1e-3 * sd
    assert np.abs(straight_line(noise, y, columns, 0) - best).max() > 0.3 * sd


def test_variance_of_heavy_tails():
    """Student's Fisher information is (ν + 1)/(ν + 3)/σ²; 2000 samples leave a few per cent."""
    r = 0.1 * np.random.default_rng(2).standard_t(3.0, T.size)
    noise = FittedNoise("student_t", {"noise_sd": 0.1, "noise_dof": 3.0})
    assert noise.variance(r, np.cos(4 * T), GAPS) == pytest.approx(0.1**2 * 6 / 4, rel=0.1)


@pytest.mark.parametrize("frequency", [0.5, 4.0, 30.0])
def test_variance_of_correlated_noise(frequency: float):
    """It is the power of an autoregressive process of order 1 at the frequency of the shift."""
    rho = np.exp(-0.01 / 0.05)
    power = (1 - rho**2) / (1 - 2 * rho * np.cos(0.01 * frequency) + rho**2)
    noise = FittedNoise("correlated", {"noise_sd": 1.0, "noise_time": 0.05})
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


@pytest.mark.parametrize(("noise_time", "white"), [(None, True), (0.1, False)])
def test_white_noise_is_white_under_exact_laws(noise_time: float | None, white: bool):
    """For four records each; with correlated noise, the control, the variance near the oscillation is larger."""
    own = {} if noise_time is None else {"noise": "correlated", "noise_time": noise_time}
    factors = []
    for seed in range(4):
        signal = bd.simulate({"viscous": 0.05}, "linear", seed=seed, theta0=0.3, **MADE, **own)
        asked = [MotionCandidate(("viscous",), "linear")]
        factors.append(weigh_all(prepared(signal), asked, approximate=False).inflation)
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
    own, plain = (weighing_of(heavy, noises=noises_of(noise), **asked) for noise in ("auto", "gaussian"))
    assert own.noise.name == "student_t"
    assert own.variance == pytest.approx(0.5 * plain.variance, rel=0.25)
    assert own.best.fit.parameters.named(own.best.z)["zeta"] / frequency == pytest.approx(ratio, rel=0.01)
    even = bd.signal(t, motion + 0.003 * rng.standard_normal(t.size))
    assert weighing_of(even, noises=noises_of("auto"), **asked).noise.name == "gaussian"
    assert weighing_of(even, noises=("student_t",), **asked).noise.name == "student_t"


def test_a_fit_to_amplitudes_and_phases_has_its_noise_from_a_file(tmp_path):
    """One sample in fifty is off by many times the noise; the interval contains the truth."""
    made = {"stiffness": 900.0, "duration": 100.0, "samples": 15_000, "noise_sd": 0.003, "outliers": 0.02}
    signal = bd.simulate({"viscous": 0.02}, seed=3, **made)
    fit = bd.fit(signal, bd.Model("viscous", restoring="linear", deviation="law"))
    assert fit.noise == "student_t"
    assert fit.intervals["zeta"][0] < 0.02 < fit.intervals["zeta"][1]
    fit.save(tmp_path / "fit.npz")
    assert bd.load(tmp_path / "fit.npz").intervals == fit.intervals
