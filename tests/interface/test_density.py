"""The posterior as plain functions, against the closed form and finite differences."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

import bayesdamp as bd
from tests.interface.problems import MODEL, fit, not_refused, record


def points(count: int, spread: float = 2.0) -> np.ndarray:
    """x about the best fit, (count, d), where nothing is below zero."""
    density = fit().density
    sds = np.array([fit().sd[n] for n in density.names])
    return density.vector() + spread * sds * np.random.default_rng(5).standard_normal((count, sds.size))


def solved(osc: bd.Oscillator, p: Mapping[str, float], times: np.ndarray) -> np.ndarray:
    """The motion of a damping with a kernel on a linear spring, by SciPy."""

    def slope(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        force = sum(p[t.parameter] * t.kernel(x, v, p.get("epsilon", 1.0)) for t in osc.terms)
        return [v, -force - p["stiffness"] * (x - p["rest_angle"])]

    begin = [p["theta0"], p["omega0"]]
    return solve_ivp(slope, times[[0, -1]], begin, "DOP853", times, rtol=1e-10, atol=1e-12).y[0]


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
def test_log_likelihood_is_the_one_worked_out_by_hand(damping, true, priors, known) -> None:
    """Within 1e-3 nats at points three sds and less from the best; of friction also where its width is a fiftieth."""
    made = bd.simulate(damping, stiffness=20.0, duration=6.0, samples=200, noise_sd=0.005, seed=3, **true)
    density = bd.Model(*damping, noise="gaussian", priors=priors, known=known).bind(made)
    towards = np.random.default_rng(1).standard_normal((6, len(density.names)))
    away = towards / np.linalg.norm(towards, axis=1)[:, None] * [[0], [1], [2], [3], [3], [3]]
    scores = density.mode.z + away @ density.mode.factor.T
    if priors:
        scores[-1, density.names.index("epsilon")] = priors["epsilon"].score(0.0008)
    depths = []
    for z in scores:
        x = np.array([float(v) for v in density.target.values(z).values()])
        p = {**density.known, **dict(zip(density.names, x, strict=True))}
        motion = solved(density.target.oscillator, p, made.t)
        by_hand = float(np.sum(stats.norm.logpdf(made.y, motion, p["noise_sd"])))
        depths.append(density.log_likelihood(x))
        assert depths[-1] == pytest.approx(by_hand, abs=1e-3)
    assert depths[0] - min(depths) > 1.0


def differences(x: np.ndarray) -> np.ndarray:
    """The gradient by central differences of the closed form's posterior."""
    density = fit().density
    found = np.empty(x.size)
    for i, name in enumerate(density.names):
        step = 1e-3 * fit().sd[name]
        up, down = (x + s * step * np.eye(x.size)[i] for s in (1, -1))
        found[i] = (density.log_posterior(up) - density.log_posterior(down)) / (2 * step)
    return found


def test_gradient() -> None:
    density = fit().density
    sds = np.array([fit().sd[n] for n in density.names])
    assert density.log_posteriors(points(3)) == pytest.approx([density.log_posterior(x) for x in points(3)])
    for x in points(3):
        assert density.gradient(x) * sds == pytest.approx(differences(x) * sds, abs=1e-4)
    # The negative control: a tenth of an sd away.
    assert density.gradient(x + 0.1 * sds) * sds != pytest.approx(differences(x) * sds, abs=1e-4)


def test_gradient_far_out() -> None:
    """A sampler's step that diverges may come there: powers of the noise's scale overflow."""
    density = fit().density
    for noise_sd in (1e-120, 1e200):
        assert not np.isnan(density.gradient(density.vector({"noise_sd": noise_sd}))).any()


def test_outside_the_support() -> None:
    density = fit().density
    x = density.vector()
    for name, value in (
        ("zeta", -0.01),
        ("noise_sd", -1.0),
        ("noise_sd", 0.0),
        ("zeta", np.nan),
        ("zeta", np.inf),
    ):
        outside = x.copy()
        outside[density.names.index(name)] = value
        assert density.log_prior(outside) == density.log_posterior(outside) == -np.inf
        assert density.log_likelihood(outside) == -np.inf
        assert np.array_equal(density.gradient(outside), np.zeros(x.size))


def test_a_motion_that_escapes_has_no_likelihood() -> None:
    """A softening spring let go beyond its hill."""
    truth = {"stiffness": 20.0, "cubic": -60.0, "theta0": 0.3}
    made = bd.simulate({"viscous": 0.05}, "duffing", duration=6.0, samples=150, noise_sd=0.003, **truth)
    known = {"rest_angle": 0.0, "omega0": 0.0}
    density = bd.Model("viscous", "duffing", noise="gaussian", known=known).bind(made)
    x = density.vector({"theta0": 0.65, "cubic": -60.0})
    assert np.isfinite(density.log_prior(x))
    assert density.log_likelihood(x) == density.log_posterior(x) == -np.inf
    assert np.isfinite(density.log_posterior(density.vector()))


def test_a_vector_that_is_none_is_refused() -> None:
    density = MODEL.bind(record())
    assert density.vector() == pytest.approx(fit().density.vector())
    wrong = (partial(density.log_posterior, x) for x in (np.zeros(3), 0.0, "abc", np.zeros((2, 6))))  # type: ignore[arg-type]
    assert not_refused((call, "6 numbers: zeta, stiffness") for call in wrong) == []
    assert not_refused([(lambda: density.vector({"zeda": 1.0}), "did you mean 'zeta'")]) == []
