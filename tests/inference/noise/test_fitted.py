"""Noise fitted to residuals: its evidence, and the variances and working residuals of repeated least squares."""

import numpy as np
import pytest
from scipy import optimize, stats

from bayesdamp.inference.noise import FittedNoise, SampleNoise, fit_noise
from bayesdamp.priors import LogNormal
from bayesdamp.types import Signal
from tests.inference.problems import FEATURES

GAPS = np.full(1999, 0.01)
T = 0.01 * np.arange(2000)
SD = 0.004


def straight_line(noise: FittedNoise, y: np.ndarray, columns: np.ndarray, rounds: int) -> np.ndarray:
    """Return coefficients by repeated least squares to working residuals."""
    c = np.linalg.lstsq(columns, y, rcond=None)[0]
    for _ in range(rounds):
        r = y - columns @ c
        working = columns @ c + noise.working_residuals(r, GAPS, noise.variance(r, columns[:, 0], GAPS))
        c = np.linalg.lstsq(columns, working, rcond=None)[0]
    return c


def test_working_residuals_lead_to_the_mode_of_the_density():
    """Student's likelihood, whose maximum SciPy finds. Control: one fit to the record itself is far from it."""
    columns = np.column_stack([np.cos(4 * T), np.sin(4 * T)])
    y = columns @ [1.0, 0.5] + 0.05 * np.random.default_rng(1).standard_t(2.0, T.size)
    noise = FittedNoise("student_t", {"noise_sd": 0.05, "noise_dof": 2.0})

    def negative_log_likelihood(c: np.ndarray) -> float:
        return -float(np.sum(stats.t.logpdf((y - columns @ c) / 0.05, 2.0)))

    fine = {"xatol": 1e-9, "fatol": 1e-9}
    best = optimize.minimize(negative_log_likelihood, [1.0, 0.5], method="Nelder-Mead", options=fine).x
    sd = 0.05 * np.sqrt(2 / T.size)
    assert np.abs(straight_line(noise, y, columns, 20) - best).max() < 1e-3 * sd
    assert np.abs(straight_line(noise, y, columns, 0) - best).max() > 0.3 * sd


def test_the_variance_of_heavy_tails_is_the_inverse_of_students_information():
    """Fisher's information is (ν + 1)/(ν + 3)/σ², to a few per cent with 2,000 samples. Far out, where the density is
    convex and the observed information negative, 0.3 of it is used."""
    noise = FittedNoise("student_t", {"noise_sd": 0.1, "noise_dof": 3.0})
    r = 0.1 * np.random.default_rng(2).standard_t(3.0, T.size)
    assert noise.variance(r, np.cos(4 * T), GAPS) == pytest.approx(0.1**2 * 6 / 4, rel=0.1)
    far = 50.0 * np.ones(T.size)
    assert noise.variance(far, np.cos(4 * T), GAPS) == pytest.approx(0.1**2 * 6 / 4 / 0.3, rel=1e-9)


@pytest.mark.parametrize("frequency", [0.5, 4.0, 30.0])
def test_the_variance_of_correlated_noise_is_its_power_at_the_frequency_of_the_shift(frequency: float):
    """The noise is an autoregressive process of order 1."""
    rho = np.exp(-0.01 / 0.05)
    power = (1 - rho**2) / (1 - 2 * rho * np.cos(0.01 * frequency) + rho**2)
    noise = FittedNoise("correlated", {"noise_sd": 1.0, "noise_time": 0.05})
    assert noise.variance(np.ones(T.size), np.cos(frequency * T), GAPS) == pytest.approx(power, rel=0.05)


def test_evidence_and_mode_against_quadrature():
    """On a grid of the score of the sd, and for Student's t on one of both scores. Control: another prior and a known
    parameter give another evidence."""
    signal, z = Signal(T[:301], np.zeros(301)), np.linspace(-3.0, 3.0, 2001)
    rng = np.random.default_rng(3)
    r = SD * rng.standard_normal(301)

    def integral(log: np.ndarray, *steps: float) -> float:
        return float(log.max() + np.log(np.sum(np.exp(log - log.max())) * np.prod(steps)))

    result = fit_noise("gaussian", r, signal, FEATURES)
    sd = FEATURES.roughness * np.exp(z)
    log = stats.norm.logpdf(z) + np.array([stats.norm.logpdf(r, scale=s).sum() for s in sd])
    assert result.log_evidence == pytest.approx(integral(log, z[1] - z[0]), abs=0.01)
    assert result.values["noise_sd"] == pytest.approx(sd[np.argmax(log)], rel=0.004)

    r = SD * rng.standard_t(3.0, 301)
    axes = np.linspace(-1.6, -0.4, 61), np.linspace(-2.5, 1.5, 61)
    sd_scores, dof_scores = np.meshgrid(*axes, indexing="ij")
    sd, dof = FEATURES.roughness * np.exp(sd_scores), 6.0 * np.exp(0.8 * dof_scores)
    log = stats.t.logpdf(r, dof[..., None], scale=sd[..., None]).sum(axis=-1)
    log += stats.norm.logpdf(sd_scores) + stats.norm.logpdf(dof_scores)
    result = fit_noise("student_t", r, signal, FEATURES)
    assert result.log_evidence == pytest.approx(integral(log, 1.2 / 60, 4.0 / 60), abs=0.05)
    best = np.unravel_index(np.argmax(log), log.shape)
    assert result.values["noise_sd"] == pytest.approx(sd[best], rel=0.02)
    assert result.values["noise_dof"] == pytest.approx(dof[best], rel=0.06)
    known = fit_noise("student_t", r, signal, FEATURES, known={"noise_dof": 3.0, "zeta": 1.0})
    assert known.values["noise_dof"] == 3.0
    assert set(known.values) == {"noise_sd", "noise_dof"}
    assert known.log_evidence > result.log_evidence + 0.5
    wide = fit_noise("student_t", r, signal, FEATURES, priors={"noise_sd": LogNormal(median=1.0, sigma=1.0)})
    expected = stats.norm.logpdf(np.log(SD)) - stats.norm.logpdf(np.log(SD / FEATURES.roughness))
    assert wide.log_evidence - result.log_evidence == pytest.approx(expected, abs=0.6)


def test_the_most_probable_noise_is_ahead_by_the_difference_in_evidence():
    models = (FittedNoise("gaussian", {}, -3.0), FittedNoise("student_t", {}, 4.0))
    noise = SampleNoise(FittedNoise("student_t", {}, 4.0), models)
    assert (noise.name, noise.likeliest, noise.ahead) == ("student_t", "student_t", 7.0)
    assert SampleNoise(models[0]).likeliest == "gaussian"
    assert np.isnan(SampleNoise(models[0]).ahead)


def test_a_known_noise_under_which_the_residuals_are_impossible_has_no_evidence() -> None:
    n = 100
    signal = Signal(np.arange(float(n)), np.zeros(n))
    result = fit_noise("gaussian", np.full(n, 1e150), signal, FEATURES, {"noise_sd": 1e-9})
    assert result.log_evidence == -np.inf
