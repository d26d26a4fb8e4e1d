"""Steps along the horizontal pendulum's own curves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from bayesdamp.inference.fit.mode import maximise
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal
from bayesdamp.types import Seed, Signal

LAW = LAWS.get("horizontal_pendulum")
POINT = {"stiffness": 300.0, "gravity": -140.0, "spring_angle": 0.4, "theta0": -1.1}


def test_natural_coordinates_are_the_equilibrium_and_the_frequency_there() -> None:
    """Against SciPy's root and the force's slope by differences."""

    def force(x: float) -> float:
        return float(LAW.force(x, POINT))

    result = LAW.natural(POINT)
    assert result is not None
    rest = brentq(force, -1.0, 1.0, xtol=1e-14)
    assert result["spring_angle"] == pytest.approx(rest, abs=1e-12)
    assert result["stiffness"] == pytest.approx((force(rest + 1e-5) - force(rest - 1e-5)) / 2e-5, rel=1e-7)
    assert result["theta0"] == pytest.approx(POINT["theta0"] - rest)
    back = LAW.from_natural(result)
    assert back == pytest.approx(POINT)


def test_where_there_is_no_equilibrium_there_are_no_coordinates() -> None:
    assert LAW.natural({"stiffness": 1.0, "gravity": -50.0, "spring_angle": 1.5}) is None
    assert LAW.from_natural({"stiffness": 1.0, "gravity": 9.0, "spring_angle": 1.5}) is None
    assert LAWS.get("linear").natural({"stiffness": 1.0, "rest_angle": 0.0}) is None


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


def test_a_step_begins_as_the_straight_one_and_keeps_the_natural_coordinates_straight() -> None:
    target = problem()
    follow = target.followed
    rng = np.random.default_rng(0)
    z, step = target.scores(SEED), 0.1 * rng.standard_normal(6)
    assert np.max(np.abs(follow(z, 1e-4 * step) - z - 1e-4 * step)) < 1e-7

    def natural(z: np.ndarray) -> np.ndarray:
        result = LAW.natural({n: float(v) for n, v in target.values(z).items()})
        assert result is not None
        return np.array([result[n] for n in (*LAW.parameters, "theta0")])

    start, half, end = natural(z), natural(follow(z, 0.5 * step)), natural(follow(z, step))
    np.testing.assert_allclose(half - start, 0.5 * (end - start), atol=1e-4 * np.abs(start).max())
    straight = natural(z + 0.5 * step) - start, natural(z + step) - start
    assert np.max(np.abs(straight[0] - 0.5 * straight[1])) > 1e-3  # negative control
    known = Target(
        target.signal,
        target.oscillator,
        "gaussian",
        {k: v for k, v in target.priors.items() if k != "gravity"},
        {**target.known, "gravity": 1.0},
    )
    z, step = z[:5], step[:5]
    assert np.array_equal(known.followed(z, step), z + step)


def test_a_climb_along_the_curve_arrives_where_a_straight_one_creeps() -> None:
    target = problem()
    mode = find_mode(target, {Seed("s"): SEED}, noise_level=0.01)
    assert mode.searches[0].converged
    z = target.scores(SEED)
    curvature = mode.likelihood.held(1.0).curvature
    along = maximise(curvature, target.reflected, z, limit=120, retract=target.followed)
    straight = maximise(curvature, target.reflected, z, limit=120)
    assert along.converged
    assert along.value == pytest.approx(mode.log_posterior, abs=0.05)
    assert not straight.converged or straight.evaluations > 2 * along.evaluations
    assert straight.value <= along.value + 0.05
