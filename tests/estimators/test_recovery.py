"""Estimates recover the truth of clean records: closed forms, random truths, sums, free parameters."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.types import Problem, Signal, System
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
from tests.physics.independent import trajectory

SLOW = ("genetic", "symbolic_regression")
EACH = pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in QUICK]
)
"""Two methods that need seconds for each record are tested quickly only with random truths and in their own files."""


def recovered(name, record, truth, first=None, second=0.01):
    """Return both estimates of a record, and check their errors in per cent of the truth."""
    estimates = run(name, *record, seed=1)
    for estimate, limit in zip(estimates, (first or INITIAL.get(name, 1.0), second), strict=True):
        for parameter, value in truth.items():
            assert error(estimate.values[parameter], value) < limit, (name, parameter)
    return estimates


def part(record, chosen):
    """Return a record of the chosen samples, and its problem."""
    signal, problem = record
    return replace(signal, t=signal.t[chosen], y=signal.y[chosen]), problem


@EACH
@pytest.mark.parametrize(
    ("record", "truth"), [(damped_cosine, {"zeta": 0.08}), (dry_friction, {"mu_c": 0.2})]
)
def test_closed_forms_are_recovered(name, record, truth):
    assert recovered(name, record(), truth)[1].outcome == "ok"


@pytest.mark.parametrize("case", [0, 1, *(pytest.param(i, marks=pytest.mark.slow) for i in range(2, 6))])
def test_random_truths_are_recovered(case):
    """Clean records with truths from a fixed seed: no false alarms."""
    rng = np.random.default_rng((20260101, case))
    parameter, low, high = [("zeta", 0.01, 0.2), ("mu_c", 0.01, 0.08), ("mu_q", 0.02, 0.2)][case % 3]
    truth, k, theta0 = {parameter: rng.uniform(low, high)}, rng.uniform(12, 45), rng.uniform(0.35, 0.5)
    record = pendulum(truth, k=k, theta0=theta0)
    for name in QUICK:
        recovered(name, record, truth)


@pytest.mark.parametrize("name", ["least_squares", "envelope"])
def test_sums_are_recovered(name):
    damping = {"zeta": 0.05, "mu_c": 0.03}
    recovered(name, pendulum(damping), damping, 1.0)


@EACH
def test_unknown_restoring_parameters_and_start_are_recovered(name):
    record = pendulum({"zeta": 0.05}, free=EVERYTHING, samples=2000)
    first, refined = recovered(name, record, {"zeta": 0.05}, 5.0)
    assert set(first.values) == set(refined.values) == set(refined.stderr) == {"zeta", *EVERYTHING}
    for parameter, value in {"stiffness": 20.0, "gravity": 1.0, "theta0": 0.3}.items():
        assert error(refined.values[parameter], value) < 0.01
    assert abs(refined.values["spring_angle"]) < 1e-4


@EACH
def test_velocities_and_accelerations_are_recovered(name):
    quantity = "acceleration" if name in ("least_squares", "envelope") else "velocity"
    record = pendulum({"mu_c": 0.03}, quantity=quantity, samples=2000, free=("theta0", "omega0"))
    assert error(recovered(name, record, {"mu_c": 0.03}, 5.0)[1].values["theta0"], 0.3) < 0.01


@EACH
def test_records_with_irregular_sampling_or_a_gap_are_recovered(name):
    """The record with a gap has noise; its limit is five standard errors. Initial estimates use the part before it."""
    chosen = np.sort(np.random.default_rng(3).choice(2000, 1500, replace=False))
    chosen[0] = 0
    thinned = part(pendulum({"zeta": 0.05}, samples=2000), chosen)
    assert not thinned[0].uniform
    recovered(name, thinned, {"zeta": 0.05}, 5.0)
    noisy = pendulum({"mu_c": 0.03}, samples=3000, noise=0.001)
    recovered(name, part(noisy, (noisy[0].t < 6.0) | (noisy[0].t > 7.2)), {"mu_c": 0.03}, 10.0, 1.0)


def test_a_wrong_stiffness_gives_a_wrong_damping_and_a_poor_fit():
    """Negative control: the known stiffness is wrong by 2 %."""
    signal, problem = pendulum({"zeta": 0.05})
    wrong = replace(problem.system, known={**problem.system.known, "stiffness": 20.4})
    refined = initial("least_squares", signal, replace(problem, system=wrong), stage="refined")
    assert error(refined.values["zeta"], 0.05) > 0.01
    assert refined.outcome != "ok"


def linear_motion(quantity: str) -> Signal:
    """Return the velocity or acceleration of a linear oscillator that is released 0.3 from rest, with noise."""
    t, order = np.linspace(0.0, 15.0, 750), ("angle", "velocity", "acceleration").index(quantity)
    p = {"zeta": 0.05, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
    noise = 0.01 * np.random.default_rng(1).standard_normal((2, t.size))[order - 1]
    return Signal(t, trajectory("linear", p, t)[:, order] + noise, quantity)


@pytest.mark.parametrize("name", ["least_squares", "envelope"])
def test_an_acceleration_does_not_determine_the_position(name: str) -> None:
    refined = run(name, linear_motion("acceleration"), Problem(("viscous",), System("linear")), seed=1)[1]
    assert refined.values["theta0"] - refined.values["rest_angle"] == pytest.approx(0.3, rel=0.01)
    assert set(refined.stderr) == {"zeta", "stiffness", "omega0"}
    assert abs(refined.values["zeta"] - 0.05) < 4 * refined.stderr["zeta"] < 0.002
    assert refined.outcome == "ok"


def test_parameters_that_are_determined_only_together_have_no_standard_error() -> None:
    """Without gravity, the angle of the relaxed spring is the rest position, which a velocity does not determine."""
    problem = Problem(("viscous",), System("horizontal_pendulum", {"gravity": 0.0}))
    refined = run("envelope", linear_motion("velocity"), problem, seed=1)[1]
    assert set(refined.stderr) == {"zeta", "stiffness", "omega0"}
    assert refined.outcome.startswith("the record does not determine spring_angle and theta0, or only a comb")
