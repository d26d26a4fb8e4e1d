"""SINDy and weak SINDy: the terms they select, the paper's figures, noise, sign against tanh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.methods.weak_sindy import _column, _prepare
from bayesdamp.estimators.regression.library import candidates
from bayesdamp.estimators.regression.weak import test_function_weights as weights_of
from bayesdamp.estimators.shared import checked_features
from tests.estimators.truths import PAPER, error, initial, pendulum

BOTH = ("sindy", "weak_sindy")
WRITTEN = {"zeta": "2θ̇", "mu_c": "tanh(θ̇/ε)", "mu_q": "θ̇|θ̇|"}
PUBLISHED = {
    "sindy": {"zeta": 0.15, "mu_c": 2.2, "mu_q": 0.24},
    "weak_sindy": {"zeta": 0.15, "mu_c": 0.39, "mu_q": 0.07},
}


@pytest.mark.parametrize(
    ("name", "damping"), [*(("sindy", d) for d in PAPER), ("weak_sindy", PAPER[1])], ids=str
)
def test_the_papers_pendulum_and_the_term_that_is_there(name, damping):
    ((parameter, truth),) = damping.items()
    estimate = initial(name, *pendulum(damping))
    assert estimate.outcome == "ok"
    assert estimate.details["selected"] == [WRITTEN[parameter]]
    assert estimate.details["coefficients"] == pytest.approx([truth], rel=1e-4)
    assert error(estimate.values[parameter], truth) < PUBLISHED[name][parameter]
    assert len(estimate.details["path_threshold"]) == len(estimate.details["path_terms"])


@pytest.mark.parametrize("name", BOTH)
def test_a_sum_is_discovered(name):
    estimate = initial(name, *pendulum({"zeta": 0.05, "mu_c": 0.03}))
    assert estimate.details["selected"] == ["2θ̇", "tanh(θ̇/ε)"]


def test_a_term_that_is_not_there_is_told():
    """A clean record of dry friction asked for its viscous damping."""
    signal, problem = pendulum({"mu_c": 0.06}, model=("viscous",))
    first, refined = run("sindy", signal, problem, seed=1)
    assert first.outcome == (
        "the sparse regression selects tanh(θ̇/ε): without 2θ̇, which the model has; "
        "with tanh(θ̇/ε), which the model does not have"
    )
    assert first.values["zeta"] > 0.0
    assert refined.outcome != "ok"


def test_free_restoring_terms_are_discovered():
    free = ("stiffness", "gravity", "spring_angle")
    estimate = initial("weak_sindy", *pendulum({"zeta": 0.05}, free=free))
    assert estimate.details["selected"] == ["2θ̇", "θ", "cos θ"]
    assert estimate.values["stiffness"] == pytest.approx(20.0, rel=1e-3)
    assert estimate.values["gravity"] == pytest.approx(1.0, rel=1e-2)


def test_weak_sindy_is_efficient_in_noise():
    """Standard errors as stated and near the bound for an unknown start, 0.47 % of ζ."""
    off, stated = [], []
    for seed in range(12):
        signal, problem = pendulum({"zeta": 0.05}, noise=0.003, samples=1000, seed=seed)
        estimate = initial("weak_sindy", signal, problem)
        off.append(100 * (estimate.values["zeta"] / 0.05 - 1))
        stated.append(100 * estimate.stderr["zeta"] / 0.05)
    assert np.mean(stated) == pytest.approx(0.47, rel=0.2)
    assert np.sqrt(np.mean(np.square(off))) < 1.0  # twice the bound: a chance of 10⁻⁵
    assert abs(np.mean(off)) < 5 * 0.47 / np.sqrt(12)
    # Negative control: the plain regression of the same records is not that good.
    for seed in range(2):
        rough = initial("least_squares", *pendulum({"zeta": 0.05}, noise=0.003, samples=1000, seed=seed))
        assert rough.stderr["zeta"] > 0.01 * 0.05


@pytest.mark.parametrize("damping", ["displacement", "quadratic"])
def test_the_noise_of_a_weak_column_includes_that_of_the_position(damping):
    """The derivatives of the integrals by the samples are those of their differences."""
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    problem, features = replace(problem, damping=(damping,)), checked_features(signal)
    (term,) = (c for c in candidates(problem, features, "rad") if c.damping == damping)
    (stretch,) = _prepare(signal, problem, features, 1e-3)
    width = 2 * features.period
    phi = weights_of(stretch.y.size, stretch.h, width, 0)
    change = 1e-4 * np.sin(3.0 * signal.t)

    def values(y):
        at = replace(stretch, y=y, theta=y, omega=stretch.velocity @ y)
        return _column(term, at, phi, width, features)[0]

    _, through = _column(term, stretch, phi, width, features)
    expected = 0.5 * (values(stretch.y + change) - values(stretch.y - change))
    assert through @ change == pytest.approx(expected, abs=0.01 * np.abs(expected).max())
