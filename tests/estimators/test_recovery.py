"""Known truths come back: closed forms, the paper's pendulum, a sweep, sums, free parameters."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import (
    EVERYTHING,
    INITIAL,
    QUICK,
    damped_cosine,
    dry_friction,
    error,
    pendulum,
)

SLOW = ("genetic", "symbolic_regression")
NAMES = [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in QUICK]
"""The two that take seconds for each record are among those of `random_truths`, and have tests of their own."""


def both(name, signal, problem, **options):
    initial, refined = run(name, signal, problem, options=options, seed=1)
    assert initial.stage == "initial"
    assert refined.stage == "refined"
    return initial, refined


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("record", "parameter", "truth"), [(damped_cosine, "zeta", 0.08), (dry_friction, "mu_c", 0.2)]
)
def test_closed_forms_are_recovered(name, record, parameter, truth):
    initial, refined = both(name, *record())
    assert error(initial.values[parameter], truth) < INITIAL.get(name, 1.0)
    assert error(refined.values[parameter], truth) < 0.01
    assert refined.outcome == "ok"


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(i, marks=pytest.mark.slow) for i in range(2, 6))])
def test_random_truths(case):
    """Deterministic: clean records, truths from one fixed seed, no false alarms by chance."""
    rng = np.random.default_rng((20260101, case))
    parameter, low, high = [("zeta", 0.01, 0.2), ("mu_c", 0.01, 0.08), ("mu_q", 0.02, 0.2)][case % 3]
    truth, k, theta0 = rng.uniform(low, high), rng.uniform(12, 45), rng.uniform(0.35, 0.5)
    signal, problem = pendulum({parameter: truth}, k=k, theta0=theta0)
    for name in QUICK:
        initial, refined = both(name, signal, problem)
        assert error(initial.values[parameter], truth) < INITIAL.get(name, 1.0), name
        assert error(refined.values[parameter], truth) < 0.01, name


@pytest.mark.parametrize("name", ["least_squares", "envelope"])
def test_sums_are_taken_apart(name):
    damping = {"zeta": 0.05, "mu_c": 0.03}
    initial, refined = both(name, *pendulum(damping))
    for parameter, truth in damping.items():
        assert error(initial.values[parameter], truth) < 1.0
        assert error(refined.values[parameter], truth) < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_free_restoring_parameters_and_start(name):
    signal, problem = pendulum({"zeta": 0.05}, free=EVERYTHING, samples=2000)
    initial, refined = both(name, signal, problem)
    assert set(initial.values) == set(refined.values) == {"zeta", *EVERYTHING}
    truth = {"zeta": 0.05, "stiffness": 20.0, "gravity": 1.0, "theta0": 0.3}
    assert error(initial.values["zeta"], 0.05) < 5.0
    for parameter, value in truth.items():
        assert error(refined.values[parameter], value) < 0.01
    assert abs(refined.values["spring_angle"]) < 1e-4
    assert set(refined.stderr) == set(refined.values)


@pytest.mark.parametrize("name", NAMES)
def test_other_quantities(name):
    quantity = "acceleration" if name in ("least_squares", "envelope") else "velocity"
    signal, problem = pendulum({"mu_c": 0.03}, quantity=quantity, samples=2000, free=("theta0", "omega0"))
    initial, refined = both(name, signal, problem)
    assert error(initial.values["mu_c"], 0.03) < 5.0
    assert error(refined.values["mu_c"], 0.03) < 0.01
    assert error(refined.values["theta0"], 0.3) < 0.01


def test_a_jittered_clock_is_no_obstacle():
    signal, problem = pendulum({"zeta": 0.05}, samples=2000)
    kept = np.sort(np.random.default_rng(3).choice(2000, 1500, replace=False))
    kept[0] = 0
    thinned = type(signal)(signal.t[kept], signal.y[kept])
    assert not thinned.uniform
    for name in set(QUICK) - set(SLOW):
        initial, refined = both(name, thinned, problem)
        assert error(initial.values["zeta"], 0.05) < 5.0, name
        assert error(refined.values["zeta"], 0.05) < 0.01, name


@pytest.mark.parametrize("name", NAMES)
def test_a_gap_is_bridged(name):
    signal, problem = pendulum({"mu_c": 0.03}, samples=3000, noise=0.001)
    kept = (signal.t < 3.0) | (signal.t > 4.2)
    initial, refined = both(name, type(signal)(signal.t[kept], signal.y[kept]), problem)
    assert error(initial.values["mu_c"], 0.03) < 10.0
    assert error(refined.values["mu_c"], 0.03) < 1.0  # five standard errors


def test_negative_control_a_wrong_restoring_law_is_not_recovered():
    """The same checks fail where the stiffness that is called known is wrong by 2 %."""
    signal, problem = pendulum({"zeta": 0.05})
    wrong = dict(problem.system.known, stiffness=20.4)
    problem = type(problem)(problem.damping, type(problem.system)(problem.system.restoring, wrong))
    _, refined = both("least_squares", signal, problem)
    assert error(refined.values["zeta"], 0.05) > 0.01
    assert refined.outcome != "ok"
