"""Small measurements on the paper's pendulums, computed when they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from bayesdamp.estimators import run
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
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
    """The paper's record of a damping, 5,000 samples over 10 s without noise; the problem of finding it."""
    law = PENDULUM if restoring == "horizontal_pendulum" else SPRING
    assert set(law) == set(LAWS.get(restoring).parameters)
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
    made: float = 0.1,
    epsilon: float = 0.1,
) -> Estimate:
    """A method's own estimate. made, epsilon: the width of friction's switch in the record, and as it is told."""
    signal, problem = record(damping, restoring, made)
    if epsilon != made:
        problem = Problem(problem.damping, System(restoring, {**problem.system.known, "epsilon": epsilon}))
    return run(method, signal, problem, options=options, stages=("initial",), seed=SEED)[0]


def error(estimate: Estimate, damping: str) -> float:
    """Per cent of the truth; nan where the method has no answer."""
    value = estimate.values.get(TERMS.get(damping).parameter, np.nan)
    return 100 * abs(value / TRUTH[damping] - 1)


def initial_error(
    method: str, damping: str, options: Mapping[str, object] | None = None, **record: object
) -> float:
    """The error of a method's own estimate, per cent."""
    return error(initial(method, damping, options, **record), damping)  # type: ignore[arg-type]


def period_drift(damping: str) -> float:
    """How far the period moves over a record, per cent: the largest difference of its halves' mean periods."""
    signal, _ = record(damping)
    crossings = features(signal).crossing_times
    periods = crossings[2:] - crossings[:-2]
    half = periods.size // 2
    return float(100 * abs(periods[:half].mean() / periods[half:].mean() - 1))
