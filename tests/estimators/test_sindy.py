"""SINDy and weak SINDy: the terms that they select, their errors, and their standard errors."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.methods.weak_sindy import _column, _prepare
from bayesdamp.estimators.regression import candidates, test_function_weights as weights_of
from bayesdamp.estimators.shared import checked_features
from tests.estimators.truths import PAPER, initial, pendulum

WRITTEN = {"zeta": "2θ̇", "mu_c": "tanh(θ̇/ε)", "mu_q": "θ̇|θ̇|"}
SUM = {"zeta": 0.05, "mu_c": 0.03}


@pytest.mark.parametrize(
    ("name", "damping"),
    [*(("sindy", d) for d in (*PAPER, SUM)), *(("weak_sindy", d) for d in (PAPER[1], SUM))],
    ids=str,
)
def test_the_terms_of_the_papers_pendulum_are_selected_and_recovered(name, damping):
    estimate = initial(name, *pendulum(damping))
    assert estimate.outcome == "ok"
    assert estimate.details["selected"] == [WRITTEN[parameter] for parameter in damping]
    assert estimate.details["coefficients"] == pytest.approx(list(damping.values()), rel=1e-4)
    assert estimate.values == pytest.approx(damping, rel=1e-4)


def test_the_outcome_says_that_the_selected_terms_are_not_those_of_the_model():
    """Dry friction with a viscous model."""
    signal, problem = pendulum({"mu_c": 0.06}, model=("viscous",))
    first, refined = run("sindy", signal, problem, seed=1)
    assert first.outcome == (
        "the sparse regression selects tanh(θ̇/ε): without 2θ̇, which the model has; "
        "with tanh(θ̇/ε), which the model does not have"
    )
    assert first.values["zeta"] > 0.0
    assert refined.outcome != "ok"


def test_unknown_restoring_terms_are_selected():
    estimate = initial("weak_sindy", *pendulum({"zeta": 0.05}, free=("stiffness", "gravity", "spring_angle")))
    assert estimate.details["selected"] == ["2θ̇", "θ", "cos θ"]
    assert estimate.values["stiffness"] == pytest.approx(20.0, rel=1e-3)
    assert estimate.values["gravity"] == pytest.approx(1.0, rel=1e-2)


def test_standard_errors_of_weak_sindy_are_near_the_bound():
    """The Cramér–Rao bound with an unknown start is 0.47 % of ζ. An rms of twice the bound has a chance of 10⁻⁵.

    Negative control: errors of plain regression.
    """
    records = [pendulum({"zeta": 0.05}, noise=0.003, samples=1000, seed=seed) for seed in range(12)]
    by_name = {n: [initial(n, *record) for record in records] for n in ("weak_sindy", "least_squares")}
    errors, plain = (np.array([100 * (e.values["zeta"] / 0.05 - 1) for e in x]) for x in by_name.values())
    stderr = [100 * estimate.stderr["zeta"] / 0.05 for estimate in by_name["weak_sindy"]]
    assert np.mean(stderr) == pytest.approx(0.47, rel=0.2)
    assert np.sqrt(np.mean(np.square(errors))) < 1.0 < np.sqrt(np.mean(np.square(plain)))
    assert abs(np.mean(errors)) < 5 * 0.47 / np.sqrt(12)


@pytest.mark.parametrize("damping", ["displacement", "quadratic"])
def test_the_noise_of_a_weak_column_includes_that_of_the_position(damping):
    """The derivatives of the integrals by the samples are those of their differences."""
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    problem, features = replace(problem, damping=(damping,)), checked_features(signal)
    (term,) = (c for c in candidates(problem, features, "rad") if c.damping == damping)
    stretch = _prepare(signal, problem, features, 1e-3)
    width = 2 * features.period
    phi = weights_of(stretch.y.size, stretch.h, width, 0)
    change = 1e-4 * np.sin(3.0 * signal.t)

    def values(y):
        at = replace(stretch, y=y, theta=y, omega=stretch.velocity @ y)
        return _column(term, at, phi, width, features)[0]

    _, through = _column(term, stretch, phi, width, features)
    expected = 0.5 * (values(stretch.y + change) - values(stretch.y - change))
    assert through @ change == pytest.approx(expected, abs=0.01 * np.abs(expected).max())
