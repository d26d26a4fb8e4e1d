"""Tangents of terms whose force has a corner or its own parameters, with the tolerance that searches use."""

import math

import numpy as np
import pytest

from bayesdamp.inference.deviation.least_squares import SEARCHED
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import PARAMETERS
from tests.physics.kernel.test_march import central_difference

TIMES = np.linspace(0.0, 12.0, 481)
MOTION = {"stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0, "epsilon": 0.02}
OWN = {
    "exponent": 1.5, "static_excess": 0.5, "stribeck_velocity": 0.2, "friction_slope": 0.3, "friction_curvature": 0.5,
}  # fmt: skip
SHARE = 0.01
"""Equivalent damping ratio of the term at the first amplitude; a cycle dissipates an eighth of the energy."""
SMOOTH, CORNERED, ROUGH = 1e-4, 4e-3, 1e-3
"""Largest error of tangents over their largest value: for most forces, and for structural damping, whose force jumps at
each turning point; and a tolerance with which these limits are exceeded."""


def worst(name: str, tolerance: float) -> float:
    """Return the largest relative error of the tangents by the parameters of a term, against central differences of
    motions with a tolerance of 1e-12."""
    term, w = TERMS.get(name), math.sqrt(MOTION["stiffness"])
    a, epsilon = MOTION["theta0"], MOTION["epsilon"]
    solver = Solver(("viscous", name), "linear", TIMES, "angle", a, w, epsilon, TIMES[::120])
    values = {n: OWN.get(n, 0.1) for n in solver.names} | MOTION | {"zeta": 0.02}
    values[term.parameter] = SHARE * 2 * math.pi * w**2 * a**2 / term.work(a, w, values)
    p, none = np.array([values[n] for n in solver.names]), np.zeros(solver.knots.size)
    motion = solver.solve(p, np.ones(2, bool), tangents=PARAMETERS, tolerance=tolerance)
    errors = []
    for parameter in (term.parameter, *(q.name for q in term.inferred if q.name != term.parameter)):
        i = solver.names.index(parameter)
        difference = central_difference(solver, p, i, 1e-4 * p[i], 1e-12, (none, none))
        errors.append(float(np.max(np.abs(motion.tangents[:, i] - difference)) / np.max(np.abs(difference))))
    return max(errors)


@pytest.mark.parametrize(
    "name", ["coulomb", "cubic", "displacement", "structural", "power", "stribeck", "dry_position"]
)
def test_tangents_of_every_term_are_central_differences(name: str) -> None:
    """Control: with a tolerance of 1e-3 they are not, except for forces that are polynomials."""
    limit = CORNERED if name == "structural" else SMOOTH
    assert worst(name, SEARCHED) < limit
    assert worst(name, ROUGH) > limit or name in ("cubic", "displacement")
