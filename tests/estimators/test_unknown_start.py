"""With an unknown start, motions fitted to a velocity do not depend on the position of the equilibrium."""

from __future__ import annotations

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.estimators import run
from bayesdamp.estimators.methods.envelope import EnvelopeOptions, _EnvelopeMatch
from bayesdamp.estimators.methods.rnn import Simulator
from bayesdamp.estimators.shared import checked_features
from bayesdamp.types import Problem, Signal, System

START = {"theta0": None, "omega0": None}


def velocity_about(rest: float) -> tuple[Signal, Problem]:
    signal = bd.simulate(
        {"viscous": 0.05}, "linear", stiffness=20.0, rest_angle=rest, theta0=rest + 0.3, quantity="velocity",
        duration=12.0, samples=600, noise_sd=0.002, seed=1,
    )  # fmt: skip
    return signal, Problem(("viscous",), System("linear", {"stiffness": 20.0, "rest_angle": rest}, START))


def test_the_envelope_method_scales_the_start_about_the_equilibrium() -> None:
    own, shifted = (
        _EnvelopeMatch(signal, problem, EnvelopeOptions(), checked_features(signal)).log_difference(
            np.array([0.05]), 1.3
        )
        for signal, problem in map(velocity_about, (0.0, 5.0))
    )
    assert shifted == pytest.approx(own, abs=1e-4)
    assert np.mean(own) == pytest.approx(np.log(1.3), abs=0.01)


def test_the_training_records_of_the_rnn_start_about_the_equilibrium() -> None:
    own, shifted = (
        Simulator(signal, problem, checked_features(signal), np.random.default_rng(0)).quadratures(
            np.log([0.04, 0.05, 0.06])
        )
        for signal, problem in map(velocity_about, (0.0, 5.0))
    )
    assert shifted == pytest.approx(own, abs=1e-4)


def test_simulated_records_do_not_depend_on_an_unknown_rest_angle() -> None:
    def quadratures(rest: float) -> np.ndarray:
        signal = bd.simulate(
            {"viscous": 0.05}, "linear", stiffness=20.0, rest_angle=rest, theta0=rest + 0.3, duration=12.0,
            samples=600, noise_sd=0.002, seed=1,
        )  # fmt: skip
        problem = Problem(
            ("viscous",), System("linear", {}, {**START, "stiffness": None, "rest_angle": None})
        )
        simulator = Simulator(signal, problem, checked_features(signal), np.random.default_rng(0))
        return simulator.quadratures(np.log([0.04, 0.05, 0.06]))

    assert quadratures(5.0) == pytest.approx(quadratures(0.0), abs=0.01)


def test_an_unbounded_motion_is_not_an_estimate() -> None:
    """The spring softens so much that a start at 0.3 rad is beyond its well."""
    signal = bd.simulate(
        {"viscous": 0.05}, "linear", stiffness=20.0, rest_angle=0.0, theta0=0.3, duration=12.0, samples=600,
        noise_sd=0.002, seed=1,
    )  # fmt: skip
    known = {"stiffness": 20.0, "rest_angle": 0.0, "cubic": -300.0, "theta0": 0.3, "omega0": 0.0}
    problem = Problem(("viscous",), System("duffing", known))
    (estimate,) = run("envelope", signal, problem, stages=["initial"], seed=0)
    assert estimate.outcome == "the trajectory is unbounded for every start that was tried"
    assert not estimate.values
