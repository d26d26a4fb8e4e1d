"""Known truths come back: closed forms, the paper's pendulum, a sweep, sums, free parameters."""

from __future__ import annotations

from dataclasses import replace

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
    initial,
    pendulum,
)

SLOW = ("genetic", "symbolic_regression")
EACH = pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in QUICK]
)
"""The two that take seconds for each record are among those of `random_truths`, and have tests of their own."""


def recovered(name, record, truth, first=None, second=0.01):
    """Both estimates of a record, which are within these errors of the truth, per cent."""
    estimates = run(name, *record, seed=1)
    for estimate, limit in zip(estimates, (first or INITIAL.get(name, 1.0), second), strict=True):
        for parameter, value in truth.items():
            assert error(estimate.values[parameter], value) < limit, (name, parameter)
    return estimates


def part(record, kept):
    """A record of some of the samples, and its problem."""
    signal, problem = record
    return replace(signal, t=signal.t[kept], y=signal.y[kept]), problem


@EACH
@pytest.mark.parametrize(
    ("record", "truth"), [(damped_cosine, {"zeta": 0.08}), (dry_friction, {"mu_c": 0.2})]
)
def test_closed_forms_are_recovered(name, record, truth):
    assert recovered(name, record(), truth)[1].outcome == "ok"


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(i, marks=pytest.mark.slow) for i in range(2, 6))])
def test_random_truths(case):
    """Deterministic: clean records, truths from one fixed seed, no false alarms by chance."""
    rng = np.random.default_rng((20260101, case))
    parameter, low, high = [("zeta", 0.01, 0.2), ("mu_c", 0.01, 0.08), ("mu_q", 0.02, 0.2)][case % 3]
    truth, k, theta0 = {parameter: rng.uniform(low, high)}, rng.uniform(12, 45), rng.uniform(0.35, 0.5)
    record = pendulum(truth, k=k, theta0=theta0)
    for name in QUICK:
        recovered(name, record, truth)


@pytest.mark.parametrize("name", ["least_squares", "envelope"])
def test_sums_are_taken_apart(name):
    damping = {"zeta": 0.05, "mu_c": 0.03}
    recovered(name, pendulum(damping), damping, 1.0)


@EACH
def test_free_restoring_parameters_and_start(name):
    record = pendulum({"zeta": 0.05}, free=EVERYTHING, samples=2000)
    first, refined = recovered(name, record, {"zeta": 0.05}, 5.0)
    assert set(first.values) == set(refined.values) == set(refined.stderr) == {"zeta", *EVERYTHING}
    for parameter, value in {"stiffness": 20.0, "gravity": 1.0, "theta0": 0.3}.items():
        assert error(refined.values[parameter], value) < 0.01
    assert abs(refined.values["spring_angle"]) < 1e-4


@EACH
def test_other_quantities(name):
    quantity = "acceleration" if name in ("least_squares", "envelope") else "velocity"
    record = pendulum({"mu_c": 0.03}, quantity=quantity, samples=2000, free=("theta0", "omega0"))
    refined = recovered(name, record, {"mu_c": 0.03}, 5.0)[1]
    assert error(refined.values["theta0"], 0.3) < 0.01


@EACH
def test_a_jittered_clock_and_a_gap_are_no_obstacle(name):
    """The gap in a record with noise, within five standard errors."""
    kept = np.sort(np.random.default_rng(3).choice(2000, 1500, replace=False))
    kept[0] = 0
    thinned = part(pendulum({"zeta": 0.05}, samples=2000), kept)
    assert not thinned[0].uniform
    recovered(name, thinned, {"zeta": 0.05}, 5.0)
    noisy = pendulum({"mu_c": 0.03}, samples=3000, noise=0.001)
    recovered(name, part(noisy, (noisy[0].t < 3.0) | (noisy[0].t > 4.2)), {"mu_c": 0.03}, 10.0, 1.0)


def test_negative_control_a_wrong_restoring_law_is_not_recovered():
    """The same checks fail where the stiffness that is called known is wrong by 2 %."""
    signal, problem = pendulum({"zeta": 0.05})
    wrong = replace(problem.system, known={**problem.system.known, "stiffness": 20.4})
    refined = initial("least_squares", signal, replace(problem, system=wrong), stage="refined")
    assert error(refined.values["zeta"], 0.05) > 0.01
    assert refined.outcome != "ok"
