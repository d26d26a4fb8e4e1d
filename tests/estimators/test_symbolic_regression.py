"""Symbolic regression: the algebra of its expressions, what it discovers, how the damping is read."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.expressions import Expression, front
from tests.estimators.truths import PAPER, error, initial, pendulum

V = np.linspace(-1.5, 1.5, 301)
LAW = {"zeta": "f(v) = 0.1·v", "mu_c": "tanh(", "mu_q": "f(v) = 0.05·|v|·v"}
PUBLISHED = {"zeta": 0.1545, "mu_c": 0.3871, "mu_q": 0.0679}


def test_the_expressions_are_operons():
    """Each has the error that Operon's own evaluation found, in single precision."""
    y = 0.7 * np.tanh(6 * V) - 0.4 * V * np.abs(V) + 0.05 * np.sin(7 * V)
    found, models = front(V, y, seed=3, population=100, generations=8, length=14, polish=3)
    assert models == 100 * 9
    assert len(found) > 3
    for one in found:
        assert one.length <= 14
        assert np.mean((one.expression(V) - y) ** 2) == pytest.approx(one.error, rel=1e-3, abs=1e-9)
    # Negative control: an expression that is not the one found has another error.
    errors = [one.error for one in found]
    worst, best = found[int(np.argmax(errors))], found[int(np.argmin(errors))]
    assert np.mean((worst.expression(V) - y) ** 2) != pytest.approx(best.error, rel=0.1)


@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_it_discovers_the_law(damping):
    ((parameter, truth),) = damping.items()
    found = initial("symbolic_regression", *pendulum(damping))
    assert LAW[parameter] in found.details["chosen"]
    assert found.details["read"] == "constants of the expression, which has the form of the damping law"
    assert error(found.values[parameter], truth) < PUBLISHED[parameter]
    lengths, errors = found.details["pareto_length"], found.details["pareto_error"]
    assert 0 <= found.details["pareto_chosen"] < len(lengths) == len(errors)
    assert lengths == sorted(set(lengths))
    assert found.evaluations == 500 * 41


def test_another_damping_is_seen_and_is_no_good_fit():
    signal, problem = pendulum({"mu_c": 0.06}, model=("viscous",))
    found, refined = run("symbolic_regression", signal, problem, seed=1)
    assert "tanh" in found.details["chosen"]  # it says friction although it was asked for viscous damping
    assert (
        found.details["read"] == "coefficient with which the term dissipates as much energy as the expression"
    )
    assert "the model is incomplete" in refined.outcome


def test_constants_inside_the_absolute_value_of_a_product_are_fitted() -> None:
    """Of 2 |v tanh(3 v)| these are 2 and 3; the coefficient inside |...| is 1."""
    v = np.linspace(-2.0, 2.0, 9)
    product = Expression.variable(1.0) * Expression.variable(3.0).apply("tanh")
    expression = product.apply("abs").scaled(2.0)
    assert expression.constants() == pytest.approx([2.0, 3.0])
    changed = expression.with_constants([5.0, 0.5])
    np.testing.assert_allclose(changed(v), 5 * np.abs(v * np.tanh(0.5 * v)))
