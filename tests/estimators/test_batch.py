"""Fits of many records at once: as one by one, and at the bound that no estimator can beat."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.batch import refine_batch
from bayesdamp.estimators.bound import cramer_rao
from bayesdamp.types import Signal
from tests.estimators.truths import PAPER, pendulum

START = {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0, "theta0": 0.3, "omega0": 0.0, "epsilon": 0.1}


def noisy(damping: dict[str, float], count: int, free: tuple[str, ...] = ()):
    clean, problem = pendulum(damping, samples=1000, free=free)
    noise = 0.003 * np.random.default_rng(8).standard_normal((count, clean.t.size))
    y = clean.y + noise
    return Signal(clean.t, y[0]), y, problem


def test_as_one_by_one():
    signal, y, problem = noisy({"mu_c": 0.03}, 3, ("stiffness", "theta0"))
    first = run("least_squares", signal, problem, stages=("initial",), seed=1)[0]
    found = refine_batch(signal, y, problem, first)
    assert found.names == ("mu_c", "stiffness", "theta0")
    assert np.all(found.settled)
    for row, values, errors in zip(y, found.values, found.stderr):
        alone = run("least_squares", Signal(signal.t, row), problem, stages=("refined",), seed=1)[0]
        for name, value, error in zip(found.names, values, errors):
            assert value == pytest.approx(alone.values[name], abs=2e-3 * alone.stderr[name])
            assert error == pytest.approx(alone.stderr[name], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_the_refined_stage_reaches_the_bound(damping):
    """2,000 repeats at 1 % noise: the rms error is known to 1.6 %, so that 5 % is three standard errors; false alarm
    in 600 seeds."""
    ((name, truth),) = damping.items()
    signal, y, problem = noisy(damping, 2000)
    first = run("least_squares", signal, problem, stages=("initial",), seed=1)[0]
    found = refine_batch(signal, y, problem, first)
    rms = float(np.sqrt(np.mean((found.values[:, 0] - truth) ** 2)))
    bound = cramer_rao(problem, {**START, **damping}, signal.t, 0.003)[name]
    assert rms == pytest.approx(bound, rel=0.05)
    # The stated standard errors are those of the scatter: 68.3 ± 1.0 %, four standard errors.
    inside = np.mean(np.abs(found.values[:, 0] - truth) < found.stderr[:, 0])
    assert inside == pytest.approx(0.683, abs=0.042)
    # Negative control: the initial stage of least squares does not reach it.
    own = [
        run("least_squares", Signal(signal.t, row), problem, stages=("initial",), seed=1)[0].values[name]
        for row in y[:20]
    ]
    assert float(np.sqrt(np.mean((np.array(own) - truth) ** 2))) > 1.5 * bound
