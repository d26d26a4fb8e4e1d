"""Noise models: densities and derivatives against SciPy's, drawn noise, whitened noise and information."""

import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.noise import NOISES, IndependentNoise, NoiseModel
from bayesdamp.types import Refusal, Signal
from tests.inference.problems import FEATURES

RNG = np.random.default_rng(5)
T = np.sort(np.concatenate([RNG.uniform(0, 3, 60), RNG.uniform(4.5, 6, 40)]))
"""A jittered clock with a gap."""
GAPS = np.diff(T)
P = {"noise_sd": 0.02, "noise_time": 0.13, "noise_dof": 3.5, "noise_step": 0.03}
KERNEL = P["noise_sd"] ** 2 * np.exp(-np.abs(T[:, None] - T[None]) / P["noise_time"])
NAMES = NOISES.names()


def drawn(name: str, rng: np.random.Generator, size: int = 1) -> np.ndarray:
    """Return noise of this model at T, by SciPy and NumPy alone, shape (size, n)."""
    if name == "gaussian":
        return P["noise_sd"] * rng.standard_normal((size, T.size))
    if name == "student_t":
        return P["noise_sd"] * rng.standard_t(P["noise_dof"], (size, T.size))
    if name == "quantised":
        # The motion is uniform between two steps.
        step, motion = P["noise_step"], rng.uniform(-1, 1, (size, T.size))
        return step * np.round((motion + P["noise_sd"] * rng.standard_normal((size, T.size))) / step) - motion
    return rng.standard_normal((size, T.size)) @ np.linalg.cholesky(KERNEL).T


def density(name: str, r: np.ndarray, p: dict[str, float] = P) -> np.ndarray:
    """Return the log densities of independent residuals, (n,), or that of correlated ones, (), by SciPy."""
    sd = p["noise_sd"]
    if name == "gaussian":
        return stats.norm.logpdf(r, scale=sd)
    if name == "student_t":
        return stats.t.logpdf(r, p["noise_dof"], scale=sd)
    if name == "quantised":
        ends = stats.norm.sf(np.abs(r)[:, None] + p["noise_step"] * np.array([-0.5, 0.5]), scale=sd)
        return np.log(-np.diff(ends)[:, 0] / p["noise_step"])
    covariance = sd**2 * np.exp(-np.abs(T[:, None] - T) / p["noise_time"])
    return np.asarray(stats.multivariate_normal.logpdf(r, cov=covariance))


@pytest.mark.parametrize("name", NAMES)
def test_the_log_likelihood_is_that_of_scipy(name):
    model = NOISES.get(name)
    for r in drawn(name, np.random.default_rng(1), 3):
        expected = density(name, r)
        np.testing.assert_allclose(model.log_likelihood(r, GAPS, P), expected.sum(), rtol=1e-10)
        if isinstance(model, IndependentNoise):
            np.testing.assert_allclose(model.log_likelihoods(r, GAPS, P), expected, rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_slope_is_that_of_scipys_density(name):
    """By central differences for one residual at a time. Control: the slope at other residuals is another one."""
    r = drawn(name, np.random.default_rng(1))[0]
    step = 1e-4 * P["noise_sd"]
    moved = [(density(name, r + e), density(name, r - e)) for e in step * np.eye(r.size)]
    expected = [(up.sum() - down.sum()) / (2 * step) for up, down in moved]
    atol = 1e-6 / P["noise_sd"]
    np.testing.assert_allclose(NOISES.get(name).slope(r, GAPS, P), expected, rtol=1e-6, atol=atol)
    assert not np.allclose(NOISES.get(name).slope(1.01 * r, GAPS, P), expected, rtol=1e-6, atol=atol)


@pytest.mark.parametrize("name", [n for n in NAMES if n != "correlated"])
def test_the_default_slope_of_a_users_noise_is_the_closed_form(name):
    """The default uses differences of the density; the included models have closed forms."""
    model, r = NOISES.get(name), drawn(name, np.random.default_rng(1))[0]
    assert isinstance(model, IndependentNoise)
    expected = model.slope(r, GAPS, P)
    np.testing.assert_allclose(IndependentNoise.slope(model, r, GAPS, P), expected, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("share", [1e-3, 1.0, 1e3])
def test_slopes_by_parameters_are_those_of_differences(name, share):
    """For correlation times that are short, long and in between."""
    model, p = NOISES.get(name), {**P, "noise_time": share * P["noise_time"]}
    r = drawn(name, np.random.default_rng(1))[0]
    expected = NoiseModel.parameter_slopes(model, r, GAPS, p)
    for parameter, slope in model.parameter_slopes(r, GAPS, p).items():
        assert slope * p[parameter] == pytest.approx(expected[parameter] * p[parameter], rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "method", ["log_likelihood", "slope", "information_root", "whiten", "log_likelihoods"]
)
def test_several_records_at_once_have_the_values_of_single_ones(name, method):
    """Six records, whose parameters differ or are the same. Control: different records have different values."""
    model, rng = NOISES.get(name), np.random.default_rng(7)
    r = drawn(name, rng, 6).reshape(2, 3, T.size)
    p = {n: P[n] * rng.uniform(0.5, 2.0, (2, 3)) for n in (*model.parameters, *model.constants)}
    together = getattr(model, method)(r, GAPS, p)
    for i in np.ndindex(2, 3):
        own = {n: float(v[i]) for n, v in p.items()}
        np.testing.assert_allclose(together[i], getattr(model, method)(r[i], GAPS, own), rtol=1e-12)
    shared = getattr(model, method)(r, GAPS, {n: float(v[0, 0]) for n, v in p.items()})
    assert shared.shape == together.shape
    np.testing.assert_allclose(shared[0, 0], together[0, 0], rtol=1e-12)
    assert not np.allclose(shared[0, 1], together[0, 1], rtol=1e-6)


def test_a_small_recording_step_changes_neither_density_nor_slope():
    """Up to 300 sds away. Control: a larger step does change the slope."""
    r = np.array([-6.0, -0.5, -0.001, 0.0, 0.001, 0.5, 6.0])
    gaps = np.ones(r.size - 1)
    gaussian, quantised = NOISES.get("gaussian"), NOISES.get("quantised")
    fine, coarse = ({**P, "noise_step": step} for step in (1e-7, 1e-2))
    expected = gaussian.slope(r, gaps, P)
    np.testing.assert_allclose(quantised.slope(r, gaps, fine), expected, rtol=1e-7)
    each = quantised.log_likelihoods(r, gaps, fine)
    np.testing.assert_allclose(each, gaussian.log_likelihoods(r, gaps, P), rtol=1e-6)
    assert not np.allclose(quantised.slope(r, gaps, coarse), expected, rtol=1e-3)


def is_white(scores: np.ndarray) -> bool:
    """Return whether scores are normal (Kolmogorov–Smirnov) and uncorrelated. False alarms: 1e-3 and 1e-4."""
    lag = np.mean(scores[:, 1:] * scores[:, :-1]) * np.sqrt(scores[:, 1:].size)
    return bool(abs(lag) < 3.9 and stats.kstest(scores.ravel(), "norm").pvalue > 1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_noise_is_drawn_and_whitened_to_white_noise(name):
    """4,000 scores of SciPy's noise, and of the model's own. Rounded noise has the variance of Sheppard's correction.
    Control: residuals that are only divided by their sd are not white."""
    model, rng = NOISES.get(name), np.random.default_rng(6)
    many = drawn(name, np.random.default_rng(2), 40)
    own = np.array([model.draw(rng, GAPS, P) for _ in range(40)])
    assert own.shape == many.shape
    assert is_white(model.whiten(many, GAPS, P))
    if name in ("correlated", "student_t"):
        assert not is_white(NOISES.get("gaussian").whiten(many, GAPS, P))
    if name == "quantised":
        assert np.var(own) == pytest.approx(P["noise_sd"] ** 2 + P["noise_step"] ** 2 / 12, rel=0.1)
    else:
        assert is_white(model.whiten(own, GAPS, P))


def test_log_densities_of_correlated_residuals_are_those_given_all_others():
    """By the conditional normal distributions of the dense covariance."""
    r, precision = drawn("correlated", np.random.default_rng(1))[0], np.linalg.inv(KERNEL)
    sd = np.diag(precision) ** -0.5
    expected = stats.norm.logpdf(r, r - precision @ r * sd**2, sd)
    np.testing.assert_allclose(NOISES.get("correlated").log_likelihoods(r, GAPS, P), expected, rtol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_information_is_the_mean_curvature(name):
    """RᵀR is the mean of −∂² log density over 40,000 drawn residuals, within 5 %: Student's scatters by 0.4 %."""
    model = NOISES.get(name)
    v, step = np.sin(3 * T), 1e-4 * P["noise_sd"]
    many = drawn(name, np.random.default_rng(3), 400)
    slopes = [model.slope(many + sign * step * v, GAPS, P) @ v for sign in (1, -1)]
    curvature = float(np.mean(slopes[1] - slopes[0]) / (2 * step))
    root = model.information_root(v, GAPS, P)
    assert root @ root == pytest.approx(curvature, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_the_start_is_near_the_truth_and_names_are_consistent(name):
    model = NOISES.get(name)
    assert isinstance(model, NoiseModel)
    assert model.name == name
    assert set(model.priors(FEATURES)) == set(model.parameters)
    start = model.start(drawn(name, np.random.default_rng(4), 1)[0], GAPS)
    assert set(start) == set(model.parameters)
    for n, value in start.items():
        assert 1 / 3 < value / P[n] < 3, n


def test_quantised_noise_needs_a_recording_step():
    t = np.linspace(0.0, 5.0, 50)
    with pytest.raises(Refusal, match="recording step"):
        NOISES.get("quantised").read(Signal(t, np.cos(t)))
    assert NOISES.get("quantised").read(Signal(t, np.cos(t), step=0.1)) == {"noise_step": 0.1}
