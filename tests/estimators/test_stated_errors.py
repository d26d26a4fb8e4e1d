"""Standard errors of direct methods for a weakly damped record: Q = 500, and noise of 1 %."""

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
    """Return a viscous decay in closed form with noise."""
    noise = NOISE * np.random.default_rng([7, number]).standard_normal(T.size)
    return Signal(T, viscous(T, RATE, FREQUENCY, START) + noise, name=f"ring-down {number}")


def scores(method: str, count: int) -> np.ndarray:
    """Return errors over standard errors of records with different noise."""
    problem = Problem(("viscous",), System("linear", KNOWN))
    estimates = [run(method, record(i), problem, stages=("initial",), seed=i)[0] for i in range(count)]
    return np.array([(estimate.values["zeta"] - RATE) / estimate.stderr["zeta"] for estimate in estimates])


@pytest.mark.parametrize("method", ["least_squares", pytest.param("sindy", marks=pytest.mark.slow)])
def test_standard_errors_are_those_of_the_estimates(method: str):
    """The mean square score of 20 records is within the 99.8 % range of χ², widened by 9 % for the replicas."""
    assert 0.25 < float(np.mean(scores(method, 20) ** 2)) < 2.6


def test_standard_errors_from_residuals_would_be_too_large(monkeypatch: pytest.MonkeyPatch):
    """Negative control: an average of neighbouring residuals, which are small only at the resonance."""

    def average(a: np.ndarray, weight: np.ndarray, noise: np.ndarray) -> np.ndarray:
        return _covariance(a, noise[:, 0], weight, np.linspace(0, T[-1], len(a)), 2 * np.pi / FREQUENCY)

    monkeypatch.setattr("bayesdamp.estimators.methods.least_squares._propagate", average)
    assert float(np.mean(scores("least_squares", 8) ** 2)) < 0.2
