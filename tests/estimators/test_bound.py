"""The Cramér–Rao bound against independently computed values, and for parameters that a record does not determine."""

import math

import numpy as np
import pytest

from bayesdamp.estimators.refine import cramer_rao
from bayesdamp.types import Problem, System
from tests.estimators.truths import TERM
from tests.physics.independent import LAWS, PAPER

PENDULUM = LAWS["horizontal_pendulum"]


def per_cent(parameter: str, free: tuple[str, ...] = ()) -> float:
    """Return the bound of a damping parameter in per cent of its value."""
    truth = PAPER[parameter]
    known = {name: value for name, value in PENDULUM.items() if name not in free}
    problem = Problem((TERM[parameter],), System("horizontal_pendulum", known, dict.fromkeys(free)))
    bound = cramer_rao(problem, {**PENDULUM, parameter: truth}, np.linspace(0.0, 10.0, 1000), 0.003)
    assert set(bound) == {parameter, *free}
    return 100 * bound[parameter] / truth


@pytest.mark.parametrize(
    ("parameter", "known", "unknown"),
    [("zeta", 0.264, 0.471), ("mu_c", 0.538, 1.075), ("mu_q", 0.529, 0.957)],
)
def test_bounds_of_the_papers_pendulum_are_those_of_another_computation(parameter, known, unknown):
    """In per cent, with a known and an unknown start and stiffness."""
    assert per_cent(parameter) == pytest.approx(known, abs=6e-4)
    assert per_cent(parameter, ("stiffness", "theta0", "omega0")) == pytest.approx(unknown, abs=6e-4)


def test_parameters_that_the_record_does_not_determine_have_no_bound():
    """The velocity of a linear oscillator does not depend on its position. Control: the angle does."""
    known = {"stiffness": 25.0, "omega0": 0.0}
    problem = Problem(("viscous",), System("linear", known, {"rest_angle": None, "theta0": None}))
    p = {**known, "zeta": 0.08, "rest_angle": 0.1, "theta0": 0.4}
    bound = cramer_rao(problem, p, np.linspace(0.0, 8.0, 300), 0.01, "velocity")
    assert bound["rest_angle"] == bound["theta0"] == math.inf
    assert 0 < bound["zeta"] < 0.01
    assert all(math.isfinite(b) for b in cramer_rao(problem, p, np.linspace(0.0, 8.0, 300), 0.01).values())
