"""Noise models against SciPy's densities, and what whitening does."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.noise import NOISES, NoiseModel

from .problems import FEATURES

RNG = np.random.default_rng(5)
T = np.sort(np.concatenate([RNG.uniform(0, 3, 60), RNG.uniform(4.5, 6, 40)]))
"""A jittered clock with a gap."""
GAPS = np.diff(T)
P = {"noise_sd": 0.02, "noise_time": 0.13, "noise_dof": 3.5}
KERNEL = P["noise_sd"] ** 2 * np.exp(-np.abs(T[:, None] - T[None]) / P["noise_time"])
NAMES = NOISES.names()


def drawn(name: str, rng: np.random.Generator, size: int = 1) -> np.ndarray:
    """Noise of this model at T, by SciPy and NumPy alone, shape (size, n)."""
    if name == "gaussian":
        return P["noise_sd"] * rng.standard_normal((size, T.size))
    if name == "student_t":
        return P["noise_sd"] * rng.standard_t(P["noise_dof"], (size, T.size))
    return rng.standard_normal((size, T.size)) @ np.linalg.cholesky(KERNEL).T


def density(name: str, r: np.ndarray) -> float:
    if name == "gaussian":
        return float(stats.norm.logpdf(r, scale=P["noise_sd"]).sum())
    if name == "student_t":
        return float(stats.t.logpdf(r, P["noise_dof"], scale=P["noise_sd"]).sum())
    return float(stats.multivariate_normal.logpdf(r, cov=KERNEL))


def test_every_noise_has_an_independent_density():
    assert NAMES == ["correlated", "gaussian", "student_t"]


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
