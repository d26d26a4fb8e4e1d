"""The NumPyro model of a density: its value, its gradients, and a user's own prior."""

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
    """The density of two points differs as under the joint prior of two terms. Control: priors with separate scales."""
    density = bd.Model("viscous+coulomb", noise="gaussian", known={"rest_angle": 0.0}).bind(record())
    model, d, mode = density.numpyro(), len(density.names), density.mode
    assert density.target.shared.sum() == 2
    logs = []
    for u in (np.zeros(d), 0.5 * np.ones(d)):
        z = mode.z + np.linalg.cholesky(mode.factor @ mode.factor.T) @ u
        x = np.array([float(p.value(v)) for p, v in zip(density.priors.values(), z, strict=True)])
        own = log_density(model, (), {}, {"whitened": jnp.asarray(u)})[0]
        priors = (float(m.log_prior(z)) for m in (mode.likelihood, mode.likelihood.with_scale(1.0)))
        logs.append([float(own), *(density.log_likelihood(x) + prior for prior in priors)])
    own, joint, separate = np.subtract(*logs)
    assert own == pytest.approx(joint, abs=1e-6)
    assert abs(separate - own) > 1e-3


def test_a_user_s_own_prior_replaces_that_of_its_parameter_only() -> None:
    density, prior = fit().density, dist.Normal(0.05, 0.001)

    def model() -> None:
        density.numpyro()(**{n: numpyro.sample(n, prior) if n == "zeta" else v for n, v in values.items()})

    values = dict(density.values)
    sites = {"zeta": jnp.asarray(0.0503)}
    expected = float(prior.log_prob(0.0503)) + density.log_likelihood(density.vector({"zeta": 0.0503}))
    assert float(log_density(model, (), {}, sites)[0]) == pytest.approx(expected, abs=1e-6)


def test_forward_and_backward_gradients_are_those_of_finite_differences() -> None:
    density = fit().density
    model, d = density.numpyro(), len(density.names)

    def log(u):
        return log_density(model, (), {}, {"whitened": u})[0]

    at, h = 0.3 * jnp.ones(d), 1e-5
    backward, forward = jax.grad(log)(at), jax.jacfwd(log)(at)
    assert np.asarray(backward) == pytest.approx(np.asarray(forward), rel=1e-9)
    differences = [float(log(at + h * e) - log(at - h * e)) / (2 * h) for e in np.eye(d)]
    assert np.asarray(backward) == pytest.approx(differences, abs=1e-4)
