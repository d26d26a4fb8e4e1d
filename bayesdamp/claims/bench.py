"""Small measurements on the paper's pendulums, computed when a claim needs them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from bayesdamp.estimators import run
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Estimate, Problem, Signal, System

TRUTH = {"viscous": 0.05, "coulomb": 0.03, "quadratic": 0.05}
"""Section 2.3 of the paper."""
PENDULUM = {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0}
SPRING = {"stiffness": 20.0, "rest_angle": 0.0}
START = {"theta0": 0.3, "omega0": 0.0}
SEED = 20260101


@lru_cache
def record(
    damping: str, restoring: str = "horizontal_pendulum", epsilon: float = 0.1
) -> tuple[Signal, Problem]:
    """Return the paper's record of a damping, 5,000 samples over 10 s without noise, and its estimation problem."""
    law = PENDULUM if restoring == "horizontal_pendulum" else SPRING
    known = {**law, **START, "epsilon": epsilon}
    osc = Oscillator((damping,), restoring)
    truth = {**known, TERMS.get(damping).parameter: TRUTH[damping]}
    signal = simulate_signal(
        osc, truth, duration=10.0, samples=5000, noise_sd=0.0, rng=np.random.default_rng(SEED), name=damping
    )
    return signal, Problem((damping,), System(restoring, known))


def initial(
    method: str,
    damping: str,
    options: Mapping[str, object] | None = None,
    *,
    restoring: str = "horizontal_pendulum",
    simulated: float = 0.1,
    assumed: float = 0.1,
) -> Estimate:
    """Return a method's own estimate on the paper's record.

    Parameters
    ----------
    method, damping, options, restoring
        The estimator with its options, and the record.
    simulated
        Friction's width ε in the record.
    assumed
        Friction's width ε that the estimator gets.
    """
    signal, problem = record(damping, restoring, simulated)
    if assumed != simulated:
        problem = Problem(problem.damping, System(restoring, {**problem.system.known, "epsilon": assumed}))
    return run(method, signal, problem, options=options, stages=("initial",), seed=SEED)[0]


def error(estimate: Estimate, damping: str) -> float:
    """Return an estimate's error in per cent of the truth; nan if there is no answer."""
    value = estimate.values.get(TERMS.get(damping).parameter, np.nan)
    return 100 * abs(value / TRUTH[damping] - 1)


def initial_error(
    method: str, damping: str, options: Mapping[str, object] | None = None, **record: Any
) -> float:
    """Return the error of a method's own estimate in per cent. The arguments are those of `initial`."""
    return error(initial(method, damping, options, **record), damping)


def period_drift(damping: str) -> float:
    """Return the relative difference, in per cent, of the mean periods in the two halves of the record."""
    signal, _ = record(damping)
    crossings = features(signal).crossing_times
    periods = crossings[2:] - crossings[:-2]
    half = periods.size // 2
    return float(100 * abs(periods[:half].mean() / periods[half:].mean() - 1))
