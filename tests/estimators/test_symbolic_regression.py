"""Symbolic regression: the algebra of its expressions, what it discovers, how the damping is read."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.expressions import Expression, front
from tests.estimators.truths import PAPER, error, pendulum

V = np.linspace(-1.5, 1.5, 301)
LAW = {"zeta": "f(v) = 0.1·v", "mu_c": "tanh(", "mu_q": "f(v) = 0.05·|v|·v"}
PUBLISHED = {"zeta": 0.1545, "mu_c": 0.3871, "mu_q": 0.0679}


def initial(signal, problem, **options):
    return run("symbolic_regression", signal, problem, options=options, stages=["initial"], seed=1)[0]


def test_expressions_keep_their_values():
    v = Expression.variable(1.0)
    inner = v.scaled(-3.0) + Expression.constant(0.4)
    made = (inner.apply("abs") + v * v.scaled(0.3)) * inner.apply("tanh") + Expression.constant(0.1)
    x = -3.0 * V + 0.4
    expected = (np.abs(x) + 0.3 * V**2) * np.tanh(x) + 0.1
    assert made(V) == pytest.approx(expected, abs=1e-12)
    assert made.stretched(2.0)(2.0 * V) == pytest.approx(expected, abs=1e-12)
    assert made.with_constants(made.constants())(V) == pytest.approx(expected, abs=1e-12)
    assert made.with_constants(2 * made.constants())(V) != pytest.approx(expected, abs=1e-3)
    assert str((v + Expression.constant(1e-9)).without_the_negligible(V, 1e-6)) == "v"


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
    worst, best = (
        max(found, key=lambda one: one.error),
        min(found, key=lambda one: one.error),
    )
    assert np.mean((worst.expression(V) - y) ** 2) != pytest.approx(best.error, rel=0.1)


@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_it_discovers_the_law(damping):
    ((parameter, truth),) = damping.items()
    found = initial(*pendulum(damping))
    assert LAW[parameter] in found.details["chosen"]
    assert found.details["read"] == "the expression is the law: its own constants"
    assert error(found.values[parameter], truth) < PUBLISHED[parameter]
    lengths, errors = found.details["pareto_length"], found.details["pareto_error"]
    assert 0 <= found.details["pareto_chosen"] < len(lengths)
    assert len(lengths) == len(errors) == len(found.details["pareto_expression"])
    assert lengths == sorted(set(lengths))
    assert found.evaluations == 500 * 41


def test_it_finds_the_width_of_frictions_switch():
    """ε is not told; the default of 2 % of the peak velocity, 0.027 rad/s, is not the truth."""
    signal, problem = pendulum({"mu_c": 0.03})
    known = {name: value for name, value in problem.system.known.items() if name != "epsilon"}
    system = dataclasses.replace(problem.system, known=known, free={"epsilon": None})
    found = initial(signal, dataclasses.replace(problem, system=system))
    assert found.details["epsilon_found"] == pytest.approx(0.1, rel=0.01)


def test_a_sum_of_three():
    damping = {"zeta": 0.05, "mu_c": 0.03, "mu_q": 0.05}
    found = initial(*pendulum(damping))
    for parameter, truth in damping.items():
        assert error(found.values[parameter], truth) < 1.0


def test_another_damping_is_seen_and_is_no_good_fit():
    signal, problem = pendulum({"mu_c": 0.06}, model=("viscous",))
    found, refined = run("symbolic_regression", signal, problem, seed=1)
    assert "tanh" in found.details["chosen"]  # it says friction although it was asked for viscous damping
    assert found.details["read"] == "the law that does the same work"
    assert "the model is incomplete" in refined.outcome


def test_negative_control_expressions_too_short_for_the_law():
    """Three nodes do not hold θ̇|θ̇|: nothing is called the law, and the front says how far off it is."""
    found = initial(*pendulum({"mu_q": 0.05}), length=3, population=50, generations=5, searches=1)
    assert found.details["read"] == "the law that does the same work"
    assert "|v|" not in found.details["chosen"]
    assert min(found.details["pareto_error"]) > 0.1
