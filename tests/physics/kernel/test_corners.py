"""Tangents of terms whose force has a corner or parameters of its own, at the error of steps that searches take."""

from __future__ import annotations

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
"""Equivalent damping ratio of the term at the first amplitude: an eighth of the energy is lost in a cycle."""
SMOOTH, CORNERED, ROUGH = 1e-4, 4e-3, 1e-3
"""Error of tangents over their largest value, of forces without a corner and of structural damping, whose force jumps
wherever the motion turns; and a step's error at which each is far beyond it."""


def worst(name: str, tolerance: float) -> float:
    """Of the parameters of a term, the largest error of a tangent against central differences of motions solved to a
    step's error of 1e-12, over the largest value of that difference."""
    term, w = TERMS.get(name), math.sqrt(MOTION["stiffness"])
    a, epsilon = MOTION["theta0"], MOTION["epsilon"]
    made = Solver(("viscous", name), "linear", TIMES, "angle", a, w, epsilon, TIMES[::120])
    values = {n: OWN.get(n, 0.1) for n in made.names} | MOTION | {"zeta": 0.02}
    values[term.parameter] = SHARE * 2 * math.pi * w**2 * a**2 / term.work(a, w, values)
    p, none = np.array([values[n] for n in made.names]), np.zeros(made.knots.size)
    found = made.solve(p, np.ones(2, bool), tangents=PARAMETERS, tolerance=tolerance)
    errors = []
    for parameter in (term.parameter, *(q.name for q in term.inferred if q.name != term.parameter)):
        i = made.names.index(parameter)
        difference = central_difference(made, p, i, 1e-4 * p[i], 1e-12, (none, none))
        errors.append(float(np.max(np.abs(found.tangents[:, i] - difference)) / np.max(np.abs(difference))))
    return max(errors)


@pytest.mark.parametrize(
    "name", ["coulomb", "cubic", "displacement", "structural", "power", "stribeck", "dry_position"]
)
def test_tangents_of_every_term_are_central_differences(name: str) -> None:
    """The control: at steps' errors that are ten thousand times as large they are not."""
    limit = CORNERED if name == "structural" else SMOOTH
    assert worst(name, SEARCHED) < limit
    assert worst(name, ROUGH) > limit or name in ("cubic", "displacement")  # whose forces are polynomials
