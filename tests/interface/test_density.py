"""The posterior as plain functions, against the closed form and finite differences."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

import bayesdamp as bd
from bayesdamp.inference.mode import find_mode
from bayesdamp.types import Refusal
from tests.interface.problems import MODEL, fit, not_refused, record
from tests.physics.independent import trajectory


@pytest.mark.parametrize(
    ("damping", "true", "priors", "known"),
    [
        ({"quadratic": 0.15}, {"theta0": 1.0}, {}, {}),
        (
            {"coulomb": 0.05},
            {"theta0": 0.3, "epsilon": 0.01},
            {"epsilon": bd.Uniform(0.0005, 0.07)},
            {"noise_sd": 0.005, "rest_angle": 0.0},
        ),
    ],
    ids=["drag", "friction of unknown width"],
)
def test_the_log_likelihood_is_that_of_an_independent_solver(damping, true, priors, known) -> None:
    """Within 1e-3 nats up to three sds from the mode; for friction also where its width is a fiftieth of the mode's."""
    signal = bd.simulate(damping, stiffness=20.0, duration=6.0, samples=200, noise_sd=0.005, seed=3, **true)
    density = bd.Model(*damping, noise="gaussian", priors=priors, known=known).bind(signal)
    towards = np.random.default_rng(1).standard_normal((6, len(density.names)))
    away = towards / np.linalg.norm(towards, axis=1)[:, None] * [[0], [1], [2], [3], [3], [3]]
    scores = density.mode.z + away @ density.mode.factor.T
    if priors:
        scores[-1, density.names.index("epsilon")] = priors["epsilon"].score(0.0008)
    logs = []
    for z in scores:
        x = np.array([float(v) for v in density.target.values(z).values()])
        p = {**density.known, **dict(zip(density.names, x, strict=True))}
        motion = trajectory("linear", p, signal.t)[:, 0]
        logs.append(density.log_likelihood(x))
        assert logs[-1] == pytest.approx(stats.norm.logpdf(signal.y, motion, p["noise_sd"]).sum(), abs=1e-3)
    assert logs[0] - min(logs) > 1.0


@pytest.mark.parametrize("noise", ["gaussian", "correlated", "student_t"])
def test_the_gradient_is_that_of_finite_differences(noise: str) -> None:
    """At points about the best fit, none below zero. Control: the gradient a tenth of an sd away."""
    fitted = bd.fit(record(), bd.Model("viscous", "linear", noise=noise))
    density, sds = fitted.density, np.array([fitted.sd[n] for n in fitted.density.names])
    steps = 1e-3 * np.diag(sds)
    points = density.vector() + 0.5 * sds * np.random.default_rng(5).standard_normal((3, sds.size))
    assert density.log_posteriors(points) == pytest.approx([density.log_posterior(x) for x in points])
    for x in points:
        differences = (density.log_posteriors(x + steps) - density.log_posteriors(x - steps)) / 2e-3
        assert density.gradient(x) * sds == pytest.approx(differences, abs=1e-5)
        assert density.gradient(x + 0.1 * sds) * sds != pytest.approx(differences, abs=1e-2)


def test_the_gradient_is_a_number_where_powers_of_the_noise_overflow() -> None:
    """A diverging step of a sampler may lead to such points."""
    density = fit().density
    for noise_sd in (1e-120, 1e200):
        assert not np.isnan(density.gradient(density.vector({"noise_sd": noise_sd}))).any()


def test_the_density_is_zero_outside_the_support_of_the_prior() -> None:
    density = fit().density
    x = density.vector()
    outside = {"zeta": (-0.01, np.nan, np.inf), "noise_sd": (-1.0, 0.0)}
    for name, value in ((name, value) for name, values in outside.items() for value in values):
        y = x.copy()
        y[density.names.index(name)] = value
        assert density.log_prior(y) == density.log_posterior(y) == density.log_likelihood(y) == -np.inf
        assert np.array_equal(density.gradient(y), np.zeros(x.size))


def test_a_motion_that_escapes_has_no_likelihood() -> None:
    """A softening spring that is released beyond its maximum of potential energy."""
    truth = {"stiffness": 20.0, "cubic": -60.0, "theta0": 0.3}
    signal = bd.simulate({"viscous": 0.05}, "duffing", duration=6.0, samples=150, noise_sd=0.003, **truth)
    known = {"rest_angle": 0.0, "omega0": 0.0}
    density = bd.Model("viscous", "duffing", noise="gaussian", known=known).bind(signal)
    x = density.vector({"theta0": 0.65, "cubic": -60.0})
    assert np.isfinite(density.log_prior(x))
    assert density.log_likelihood(x) == density.log_posterior(x) == -np.inf
    assert np.isfinite(density.log_posterior(density.vector()))
    assert np.all(np.isfinite(density.gradient(x)))
    with pytest.raises(Refusal, match="finite likelihood"):
        find_mode(density.target, [density.values | {"theta0": 0.65}], noise_level=0.003)


def test_a_wrong_vector_is_refused() -> None:
    density = MODEL.bind(record())
    assert density.vector() == pytest.approx(fit().density.vector())
    wrong = (partial(density.log_posterior, x) for x in (np.zeros(3), 0.0, "abc", np.zeros((2, 6))))  # type: ignore[arg-type]
    assert not_refused((call, "6 numbers: zeta, stiffness") for call in wrong) == []
    assert not_refused([(lambda: density.vector({"zeda": 1.0}), "did you mean 'zeta'")]) == []
