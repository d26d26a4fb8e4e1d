"""The fit recovers what made a noise-free record of another solver, and never a negative coefficient."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from bayesdamp.inference.deviation.least_squares import LeastSquaresFit, fit
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.restoring import LAWS as PLUGINS
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from tests.physics.independent import LAWS, PAPER, trajectory

W = math.sqrt(20.0)
TIMES = np.linspace(0.0, 12.0, 600)
WIDE = 1e3
"""Widths of priors, in units of the truth: they move nothing that a record tells."""


@dataclass(frozen=True)
class Case:
    solver: Solver
    parameters: Parameters
    truth: dict[str, float]
    y: np.ndarray


def case_of(law: str, **changed: float) -> Case:
    p = {**PAPER, **LAWS[law], **changed}
    y = trajectory(law, p, TIMES)[:, 0]
    ends = np.linspace(0, 12, 4)
    solver = Solver(PAPER_TERMS, law, TIMES, "angle", abs(p["theta0"]), W, p["epsilon"], ends)
    priors: dict[str, Prior] = {}
    for name in solver.names:
        scale = WIDE * max(abs(p[name]), 0.1)
        if name in PAPER:
            priors[name] = HalfNormal(scale=scale)
        else:
            priors[name] = (
                LogNormal(median=20.0, sigma=10.0) if name == "stiffness" else Normal(mean=0.0, sd=scale)
            )
    if law == "horizontal_pendulum":  # gravity and the spring's angle are told apart by little: one is known
        del priors["gravity"]
    return Case(
        solver, Parameters(solver.names, priors, {"gravity": 1.0}), {n: p[n] for n in solver.names}, y
    )


def fitted(made: Case, noise: float = 1e-9) -> LeastSquaresFit:
    rough = PLUGINS.get(made.solver.restoring).start(1.02 * W, 0.0, {})
    begin = {**dict.fromkeys(PAPER, 0.02), **rough, "theta0": 0.97 * made.truth["theta0"], "omega0": 0.05}
    z = made.parameters.scores(begin)
    found = fit(made.solver, made.parameters, np.ones(3, bool), made.y, z, noise=noise)
    return found


@pytest.mark.parametrize("law", LAWS)
def test_recovers_the_truth(law: str) -> None:
    """The search starts from a frequency that is 2 % off; the pendulum starts at 2 rad."""
    made = case_of(law)
    found = fitted(made)
    values = made.parameters.named(found.z)
    for name, truth in made.truth.items():
        assert values[name] == pytest.approx(truth, rel=2e-3, abs=2e-4), name
    assert np.sqrt(found.squares / TIMES.size) < 3e-6 * abs(made.truth["theta0"])
    assert found.residual == pytest.approx(made.y - found.motion.y, abs=1e-12)
