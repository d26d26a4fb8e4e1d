"""Checks of a fit: their p values under true and wrong models, and draws of the Laplace approximation."""

from functools import lru_cache
from itertools import count
from typing import Any

import numpy as np
import pytest

from bayesdamp.inference import checks
from bayesdamp.inference.checks import check_fit, laplace_draws
from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator, simulate
from bayesdamp.types import FitCheck, Refusal
from tests.inference.problems import linear_target

TIMES = np.linspace(0.0, 8.0, 240)
NOISE = 0.004
PERIOD = 1.405
TRUTHS = {"viscous": ("zeta", 0.08), "quadratic": ("mu_q", 0.3)}
RECORDS = 12


@lru_cache
def clean(damping: str) -> np.ndarray:
    name, value = TRUTHS[damping]
    p = {name: value, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
    return simulate(Oscillator((damping,), "linear"), p, TIMES)


def mode_of(
    truth: str, model: str, seed: int, dof: float = np.inf, noise: str = "gaussian"
) -> tuple[Target, Mode]:
    """Return the mode of a model, with unknown coefficient, start and noise, on a record of a true damping.

    dof: degrees of freedom of the noise of the record, Student's t. noise: the noise of the model.
    """
    rng = np.random.default_rng(seed)
    drawn = rng.standard_normal(TIMES.size) if np.isinf(dof) else rng.standard_t(dof, TIMES.size)
    y = clean(truth) + NOISE * drawn
    name, value = TRUTHS[model]
    target = linear_target(TIMES, y, model, {"stiffness": 20.0}, noise)
    return target, find_mode(target, [{name: value, "theta0": 0.3, "omega0": 0.0}], noise_level=NOISE)


def fit(truth: str, model: str, seed: int, **noise: Any) -> tuple[Target, FitCheck, dict[str, np.ndarray]]:
    """Return the checks of this mode."""
    target, mode = mode_of(truth, model, seed, **noise)
    return target, *check_fit(target, mode, PERIOD, seed)


def test_predictive_p_values_of_true_models_are_uniform():
    """Of twelve records at most 4 have a p value below 0.05, at most 2 below 0.01, and at least 1 below 0.5 (false
    alarm 2e-4 each). The largest of three shifts between windows and the whole record, in its own sd, has a median
    near 1.2, and hardly any is above 4."""
    fits = [fit("viscous", "viscous", seed)[1] for seed in range(RECORDS)]
    p = np.array([f.predictive_p for f in fits])
    assert np.sum(p < 0.05) <= 4
    assert np.sum(p < 0.01) <= 2
    assert np.sum(p < 0.5) >= 1
    assert sum(f.verdict == "fits" for f in fits) >= RECORDS - 2
    assert np.mean([f.rms for f in fits]) == pytest.approx(NOISE, rel=0.03)
    assert abs(np.mean([f.residual_autocorrelation for f in fits])) < 0.05
    shifts = np.array([f.window_spread for f in fits])
    assert 0.6 < np.median(shifts) < 1.9
    assert np.sum(shifts > 4) <= 1


def test_wrong_damping_is_detected():
    """Negative control: a viscous model of a quadratic record does not fit. Its coefficient depends on the window."""
    target, result, arrays = fit("quadratic", "viscous", 1)
    assert result.predictive_p < 0.01
    assert result.verdict.startswith("does not fit")
    assert result.window_spread > 4
    assert arrays["fit"] == pytest.approx(target.signal.y - arrays["residual"])


def test_a_half_without_a_covariance_does_not_count_as_a_test(monkeypatch):
    """Two of the three halves have shifts, so that Bonferroni's factor is 2."""
    factor, calls = checks.covariance_factor, count()

    def last_half_refused(information):
        if next(calls) == 3:  # after the whole record, the first and the middle half
            raise Refusal("")
        return factor(information)

    monkeypatch.setattr(checks, "covariance_factor", last_half_refused)
    largest, number = checks._largest_shift(*mode_of("viscous", "viscous", 0))
    assert np.isfinite(largest)
    assert number == 2


def test_outliers_are_reported_under_gaussian_noise():
    """Noise with two degrees of freedom has a sample beyond six robust sds with a probability above 0.998. Negative
    control: the same record under Student's t."""
    for seed in range(2):
        assert "outliers" in fit("viscous", "viscous", seed, dof=2.0)[1].verdict
    _, check, arrays = fit("viscous", "viscous", 0, dof=2.0, noise="student_t")
    assert check.verdict == "fits"
    assert checks.kurtosis(arrays["whitened"]) < 1.0


def test_laplace_draws_near_a_wall_have_the_mean_of_the_truncated_posterior():
    """An oscillation that grows a little has no damping, and a normal posterior with a mean below zero, truncated. The
    mean is a sum over a grid. The error of 20,000 draws is 0.7 %. Control: half a normal has a mean a tenth larger."""
    y = 0.3 * np.exp(0.004 * TIMES) * np.cos(np.sqrt(20.0) * TIMES)
    y = y + NOISE * np.random.default_rng(3).standard_normal(TIMES.size)
    known = {"stiffness": 20.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": NOISE}
    mode = find_mode(linear_target(TIMES, y, "viscous", known), [{"zeta": 0.01}], noise_level=NOISE)
    assert abs(mode.z[0]) < 1e-6
    grid = np.linspace(0.0, 8 * float(mode.sd()[0]), 2001)
    height = mode.likelihood.log_posteriors(grid[:, None])
    mean = np.average(grid, weights=np.exp(height - height.max()))
    assert laplace_draws(mode, 20_000, 1).mean() == pytest.approx(mean, rel=0.05)
    assert np.sqrt(2 / np.pi) * float(mode.sd()[0]) > 1.1 * mean
