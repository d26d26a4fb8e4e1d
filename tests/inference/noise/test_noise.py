"""Noise models against SciPy's densities, and what whitening does."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.noise import NOISES, NoiseModel
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
    """Noise of this model at T, by SciPy and NumPy alone, shape (size, n)."""
    if name == "gaussian":
        return P["noise_sd"] * rng.standard_normal((size, T.size))
    if name == "student_t":
        return P["noise_sd"] * rng.standard_t(P["noise_dof"], (size, T.size))
    if name == "quantised":
        # Of a motion that passes over the steps, so that its values have any place between two of them.
        step, motion = P["noise_step"], rng.uniform(-1, 1, (size, T.size))
        return step * np.round((motion + P["noise_sd"] * rng.standard_normal((size, T.size))) / step) - motion
    return rng.standard_normal((size, T.size)) @ np.linalg.cholesky(KERNEL).T


def density(name: str, r: np.ndarray) -> float:
    if name == "gaussian":
        return float(stats.norm.logpdf(r, scale=P["noise_sd"]).sum())
    if name == "student_t":
        return float(stats.t.logpdf(r, P["noise_dof"], scale=P["noise_sd"]).sum())
    if name == "quantised":
        ends = stats.norm.sf(
            np.abs(r)[:, None] + P["noise_step"] * np.array([-0.5, 0.5]), scale=P["noise_sd"]
        )
        return float(np.log(-np.diff(ends) / P["noise_step"]).sum())
    return float(stats.multivariate_normal.logpdf(r, cov=KERNEL))


def test_every_noise_has_an_independent_density():
    assert NAMES == ["correlated", "gaussian", "quantised", "student_t"]


@pytest.mark.parametrize("name", NAMES)
def test_log_likelihood(name):
    model = NOISES.get(name)
    for r in drawn(name, np.random.default_rng(1), 3):
        found = float(model.log_likelihood(jnp.asarray(r), jnp.asarray(GAPS), P))
        assert found == pytest.approx(density(name, r), rel=1e-10)


def test_negative_control_the_wrong_clock():
    """The kernel under jitter and a gap is not that of a uniform clock of the same mean."""
    r = drawn("correlated", np.random.default_rng(1))[0]
    uniform = jnp.full(GAPS.shape, GAPS.mean())
    found = float(NOISES.get("correlated").log_likelihood(jnp.asarray(r), uniform, P))
    assert abs(found - density("correlated", r)) > 1.0


@pytest.mark.parametrize("name", NAMES)
def test_whitened_noise_is_white(name):
    """4,000 scores: normal (Kolmogorov–Smirnov) and uncorrelated. False alarms: 1e-3 and 1e-4 a model."""
    model = NOISES.get(name)
    many = drawn(name, np.random.default_rng(2), 40)
    white = np.asarray(jax.vmap(lambda r: model.whiten(r, jnp.asarray(GAPS), P))(jnp.asarray(many)))
    assert white.shape == many.shape
    assert stats.kstest(white.ravel(), "norm").pvalue > 1e-3
    lag = np.mean(white[:, 1:] * white[:, :-1]) * np.sqrt(white[:, 1:].size)
    assert abs(lag) < 3.9


@pytest.mark.parametrize("name", ["correlated", "student_t"])
def test_negative_control_white_residuals(name):
    """Divided by their sd alone such residuals are not white normal scores."""
    many = drawn(name, np.random.default_rng(2), 40)
    white = np.asarray(NOISES.get("gaussian").whiten(jnp.asarray(many), jnp.asarray(GAPS), P))
    lag = np.mean(white[:, 1:] * white[:, :-1]) * np.sqrt(white[:, 1:].size)
    assert abs(lag) > 3.9 or stats.kstest(white.ravel(), "norm").pvalue < 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_information_is_the_mean_curvature(name):
    """RᵀR against the mean of −∂² log density over 4,000 drawn residuals, in a direction; within 5 %.

    The curvature of the normal models does not depend on the draw; that of the t scatters by 0.4 % here.
    """
    model = NOISES.get(name)
    v = jnp.asarray(np.sin(3 * T))

    @jax.jit
    @jax.vmap
    def curvature(r):
        along = lambda s: model.log_likelihood(r + s * v, jnp.asarray(GAPS), P)  # noqa: E731
        return -jax.grad(jax.grad(along))(0.0)

    found = float(jnp.mean(curvature(jnp.asarray(drawn(name, np.random.default_rng(3), 400)))))
    root = np.asarray(model.information_root(v, jnp.asarray(GAPS), P))
    assert float(root @ root) == pytest.approx(found, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_start_is_near_and_contract(name):
    model = NOISES.get(name)
    assert isinstance(model, NoiseModel)
    assert model.name == name
    assert set(model.priors(FEATURES)) == set(model.parameters)
    start = model.start(drawn(name, np.random.default_rng(4), 1)[0], GAPS)
    assert set(start) == set(model.parameters)
    for n, value in start.items():
        assert 1 / 3 < value / P[n] < 3, n


def test_a_fine_step_is_gaussian_noise_and_a_coarse_one_is_not():
    r = jnp.asarray(drawn("gaussian", np.random.default_rng(6))[0])
    gaussian = float(NOISES.get("gaussian").log_likelihood(r, jnp.asarray(GAPS), P))
    by_step = [
        float(NOISES.get("quantised").log_likelihood(r, jnp.asarray(GAPS), {**P, "noise_step": step}))
        for step in (1e-4, 0.1)
    ]
    assert by_step[0] == pytest.approx(gaussian, abs=1e-3)
    assert abs(by_step[1] - gaussian) > 10


def test_a_record_without_steps_has_no_quantised_noise():
    t = np.linspace(0.0, 5.0, 50)
    with pytest.raises(Refusal, match="recording step"):
        NOISES.get("quantised").read(Signal(t, np.cos(t)))
    assert NOISES.get("quantised").read(Signal(t, np.cos(t), step=0.1)) == {"noise_step": 0.1}
