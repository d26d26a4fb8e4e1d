"""Least squares on noise-free records of an independent solver."""

import math

import numpy as np
import pytest

from bayesdamp.inference.deviation.least_squares import fit
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.restoring import LAWS as PLUGINS
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from tests.physics.independent import LAWS, PAPER, trajectory

W = math.sqrt(20.0)
TIMES = np.linspace(0.0, 12.0, 600)
WIDE = 1e3
"""Widths of the priors in units of the truth, with which they have no effect."""


def prior_of(name: str, value: float) -> Prior:
    scale = WIDE * max(abs(value), 0.1)
    if name in PAPER:
        return HalfNormal(scale=scale)
    return LogNormal(median=20.0, sigma=10.0) if name == "stiffness" else Normal(mean=0.0, sd=scale)


@pytest.mark.parametrize("law", LAWS)
def test_the_fit_is_the_truth(law: str) -> None:
    """The search starts from a frequency that is 2 % off, and the pendulum at 2 rad. Gravity is known, because it has
    nearly the same effect as the angle of the spring."""
    p = {**PAPER, **LAWS[law]}
    y = trajectory(law, p, TIMES)[:, 0]
    knots = np.linspace(0, 12, 4)
    solver = Solver(PAPER_TERMS, law, TIMES, "angle", abs(p["theta0"]), W, p["epsilon"], knots)
    priors = {n: prior_of(n, p[n]) for n in solver.names if n != "gravity"}
    parameters = Parameters(solver.names, priors, {"gravity": 1.0})
    rough = PLUGINS.get(law).start(1.02 * W, 0.0, {})
    begin = {**dict.fromkeys(PAPER, 0.02), **rough, "theta0": 0.97 * p["theta0"], "omega0": 0.05}
    result = fit(solver, parameters, np.ones(3, bool), y, parameters.scores(begin), noise=1e-9)
    values = parameters.named(result.z)
    for name in solver.names:
        assert values[name] == pytest.approx(p[name], rel=2e-3, abs=2e-4), name
    assert np.sqrt(result.squares / TIMES.size) < 3e-6 * abs(p["theta0"])
    assert result.residual == pytest.approx(y - result.motion.y, abs=1e-12)
