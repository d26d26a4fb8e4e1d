"""With an unknown start, motions fitted to a velocity do not depend on the position of the equilibrium."""

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.estimators import run
from bayesdamp.estimators.methods.envelope import EnvelopeOptions, _EnvelopeMatch
from bayesdamp.estimators.methods.rnn import Simulator
from bayesdamp.estimators.shared import checked_features
from bayesdamp.types import Problem, Signal, System

START = {"theta0": None, "omega0": None}


def signal_about(rest: float, quantity: str) -> Signal:
    return bd.simulate(
        {"viscous": 0.05}, "linear", stiffness=20.0, rest_angle=rest, theta0=rest + 0.3, quantity=quantity,
        duration=12.0, samples=600, noise_sd=0.002, seed=1,
    )  # fmt: skip


def test_the_envelope_method_scales_the_start_about_the_equilibrium() -> None:
    def difference(rest: float) -> np.ndarray:
        signal = signal_about(rest, "velocity")
        problem = Problem(("viscous",), System("linear", {"stiffness": 20.0, "rest_angle": rest}, START))
        match = _EnvelopeMatch(signal, problem, EnvelopeOptions(), checked_features(signal))
        return match.log_difference(np.array([0.05]), 1.3)

    assert difference(5.0) == pytest.approx(difference(0.0), abs=1e-4)
    assert np.mean(difference(0.0)) == pytest.approx(np.log(1.3), abs=0.01)


@pytest.mark.parametrize(("quantity", "tolerance"), [("velocity", 1e-4), ("angle", 0.01)])
def test_the_training_records_of_the_rnn_start_about_the_equilibrium(quantity: str, tolerance: float) -> None:
    """The equilibrium is known for the velocity, and unknown, as the stiffness, for the angle."""

    def quadratures(rest: float) -> np.ndarray:
        signal, spring = signal_about(rest, quantity), {"stiffness": 20.0, "rest_angle": rest}
        system = (spring, START) if quantity == "velocity" else ({}, START | dict.fromkeys(spring))
        problem = Problem(("viscous",), System("linear", *system))
        simulator = Simulator(signal, problem, checked_features(signal), np.random.default_rng(0))
        return simulator.quadratures(np.log([0.04, 0.05, 0.06]))

    assert quadratures(5.0) == pytest.approx(quadratures(0.0), abs=tolerance)


def test_an_unbounded_motion_is_not_an_estimate() -> None:
    """The spring is so soft at large angles that a body that starts at 0.3 rad does not return."""
    known = {"stiffness": 20.0, "rest_angle": 0.0, "cubic": -300.0, "theta0": 0.3, "omega0": 0.0}
    problem = Problem(("viscous",), System("duffing", known))
    (estimate,) = run("envelope", signal_about(0.0, "angle"), problem, stages=["initial"], seed=0)
    assert estimate.outcome == "no simulated motion has finite values; check the known values and the laws"
    assert not estimate.values
