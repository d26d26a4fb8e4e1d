"""The NumPyro model of a density: its value, its gradients, a prior of the user's own."""

from __future__ import annotations

import jax
import numpy as np
import numpyro
import pytest
from jax import numpy as jnp
from numpyro import distributions as dist
from numpyro.infer.util import log_density

import bayesdamp as bd
from tests.interface.problems import fit, record


def test_coefficients_share_their_scale() -> None:
    """Of two terms: density differences per score are those of the joint prior. Control: of one scale for each."""
    density = bd.Model("viscous+coulomb", noise="gaussian", known={"rest_angle": 0.0}).bind(record())
    model, d = density.numpyro(), len(density.names)
    assert density.target.shared.sum() == 2
    found, expected, separate = [], [], []
    for u in (np.zeros(d), 0.5 * np.ones(d)):
        found.append(float(log_density(model, (), {}, {"whitened": jnp.asarray(u)})[0]))
        z = density.mode.z + np.linalg.cholesky(density.mode.factor @ density.mode.factor.T) @ u
        x = np.array([float(p.value(v)) for p, v in zip(density.priors.values(), z, strict=True)])
        expected.append(density.log_likelihood(x) + float(density.mode.likelihood.log_prior(z)))
        separate.append(
            density.log_likelihood(x) + float(density.mode.likelihood.with_scale(1.0).log_prior(z))
        )
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=1e-6)
    assert abs(separate[1] - separate[0] - found[1] + found[0]) > 1e-3


def test_a_prior_of_ones_own() -> None:
    """A parameter that is passed in has no other prior, and the others keep theirs."""
    density, prior = fit().density, dist.Normal(0.05, 0.001)

    def model() -> None:
        density.numpyro()(**{n: numpyro.sample(n, prior) if n == "zeta" else v for n, v in values.items()})

    values = dict(density.values)
    sites = {"zeta": jnp.asarray(0.0503)}
    expected = float(prior.log_prob(0.0503)) + density.log_likelihood(density.vector({"zeta": 0.0503}))
    assert float(log_density(model, (), {}, sites)[0]) == pytest.approx(expected, abs=1e-6)


def test_gradients_both_ways_are_the_densitys() -> None:
    density = fit().density
    model, d = density.numpyro(), len(density.names)

    def height(u):
        return log_density(model, (), {}, {"whitened": u})[0]

    at = 0.3 * jnp.ones(d)
    backward, forward = jax.grad(height)(at), jax.jacfwd(height)(at)
    assert np.asarray(backward) == pytest.approx(np.asarray(forward), rel=1e-9)
    h = 1e-5
    apart = [float(height(at + h * e) - height(at - h * e)) / (2 * h) for e in np.eye(d)]
    assert np.asarray(backward) == pytest.approx(apart, abs=1e-4)
