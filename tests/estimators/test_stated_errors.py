"""Standard errors that direct methods state, where little is lost in a cycle: Q = 500, one per cent of noise."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.methods.least_squares import _covariance
from bayesdamp.types import Problem, Signal, System
from tests.physics.independent import viscous

RATE, FREQUENCY, START, NOISE = 4.5e-3, 4.5, 0.3, 0.003
KNOWN = {"stiffness": FREQUENCY**2, "rest_angle": 0.0, "theta0": START, "omega0": 0.0}
T = np.linspace(0.0, 40 * 2 * np.pi / FREQUENCY, 1601)


def record(number: int) -> Signal:
    """θ̈ + 2ζθ̇ + ω²θ = 0 in closed form, from rest."""
    noise = NOISE * np.random.default_rng([7, number]).standard_normal(T.size)
    return Signal(T, viscous(T, RATE, FREQUENCY, START) + noise, name=f"ring-down {number}")


def scores(method: str, count: int) -> np.ndarray:
    """Errors over their stated standard errors, of records with fresh noise."""
    problem = Problem(("viscous",), System("linear", KNOWN))
    found = [run(method, record(i), problem, stages=("initial",), seed=i)[0] for i in range(count)]
    return np.array([(one.values["zeta"] - RATE) / one.stderr["zeta"] for one in found])


@pytest.mark.parametrize("method", ["least_squares", pytest.param("sindy", marks=pytest.mark.slow)])
def test_stated_errors_are_those_that_are_made(method: str):
    """Their mean square over 20 records; χ²'s range of 99.8 %, and 9 % for the replicas."""
    assert 0.25 < float(np.mean(scores(method, 20) ** 2)) < 2.6


def test_residuals_within_half_a_period_say_little(monkeypatch: pytest.MonkeyPatch):
    """Negative control: at the resonance the noise leaves no residual; an average over neighbours is far too large."""

    def average(a: np.ndarray, weight: np.ndarray, noise: np.ndarray) -> np.ndarray:
        return _covariance(a, noise[:, 0], weight, np.linspace(0, T[-1], len(a)), 2 * np.pi / FREQUENCY)

    monkeypatch.setattr("bayesdamp.estimators.methods.least_squares._propagate", average)
    assert float(np.mean(scores("least_squares", 8) ** 2)) < 0.2
