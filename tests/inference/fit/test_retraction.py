"""Steps along the horizontal pendulum's own curves."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.fit.mode import maximise
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal
from bayesdamp.types import Seed, Signal


def problem() -> Target:
    """A gravity pendulum's velocity, which a horizontal pendulum follows at the far end of a curved ridge."""
    rng = np.random.default_rng(2)
    t = np.arange(0, 30, 0.02)
    p = {"stiffness": 12.26, "rest_angle": 0.0, "zeta": 0.03, "theta0": 0.35, "omega0": 0.0, "epsilon": 0.01}
    y = simulate(Oscillator(("viscous",), "pendulum"), p, t, "velocity") + 0.01 * rng.standard_normal(t.size)
    priors = {
        "zeta": HalfNormal(scale=0.4),
        "stiffness": LogNormal(median=12.0, sigma=0.5),
        "gravity": Normal(mean=0.0, sd=6.0),
        "spring_angle": Normal(mean=0.0, sd=0.7),
        "theta0": Normal(mean=0.0, sd=0.7),
        "omega0": Normal(mean=0.0, sd=2.4),
    }
    known = {"epsilon": 0.01, "noise_sd": 0.01}
    return Target(
        Signal(t, y, "velocity"), Oscillator(("viscous",), "horizontal_pendulum"), "gaussian", priors, known
    )


SEED = {"zeta": 0.02, "stiffness": 12.0, "gravity": 0.0, "spring_angle": 0.0, "theta0": 0.3, "omega0": 0.0}


def test_a_climb_along_the_curve_arrives_where_a_straight_one_creeps() -> None:
    target = problem()
    mode = find_mode(target, {Seed("s"): SEED}, noise_level=0.01)
    assert mode.searches[0].converged
    z = target.scores(SEED)
    curvature = mode.likelihood.with_scale(1.0).curvature
    along = maximise(curvature, target.reflected, z, limit=120, retract=target.followed)
    straight = maximise(curvature, target.reflected, z, limit=120)
    assert along.converged
    assert along.value == pytest.approx(mode.log_posterior, abs=0.05)
    assert not straight.converged or straight.evaluations > 2 * along.evaluations
    assert straight.value <= along.value + 0.05
