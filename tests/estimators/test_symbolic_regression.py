"""Symbolic regression: evaluation of its expressions, laws that it discovers, and the damping read from them."""

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.expressions import front, values_of
from tests.estimators.truths import PAPER, error, initial, pendulum

V = np.linspace(-1.5, 1.5, 301)
LAW = {"zeta": "f(v) = 0.1·v", "mu_c": "tanh(", "mu_q": "f(v) = 0.05·v·|v|"}
PUBLISHED = {"zeta": 0.1545, "mu_c": 0.3871, "mu_q": 0.0679}


def test_expressions_have_the_errors_that_operon_computed():
    """Operon uses single precision. Negative control: the worst expression and the error of the best."""
    y = 0.7 * np.tanh(6 * V) - 0.4 * V * np.abs(V) + 0.05 * np.sin(7 * V)
    members, models = front(V, y, seed=3, population=100, generations=8, length=14, polish=3)
    assert models == 100 * 9
    assert len(members) > 3
    errors = [float(np.mean((values_of(member.expression, V) - y) ** 2)) for member in members]
    assert errors == pytest.approx([member.error for member in members], rel=1e-3, abs=1e-9)
    assert max(member.length for member in members) <= 14
    assert max(errors) != pytest.approx(min(errors), rel=0.1)


@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_the_law_of_the_papers_pendulum_is_discovered(damping):
    ((parameter, truth),) = damping.items()
    estimate = initial("symbolic_regression", *pendulum(damping))
    assert LAW[parameter] in estimate.details["chosen"]
    assert error(estimate.values[parameter], truth) < PUBLISHED[parameter]
    assert estimate.evaluations == 500 * 41


def test_a_wrong_damping_model_is_recognised():
    """Friction with a viscous model: the expression is tanh, and the fit is poor."""
    signal, problem = pendulum({"mu_c": 0.06}, model=("viscous",))
    estimate, refined = run("symbolic_regression", signal, problem, seed=1)
    assert "tanh" in estimate.details["chosen"]
    assert "the model is incomplete" in refined.outcome
