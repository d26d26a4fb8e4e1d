"""Searches for the mode of a posterior: starts with a wrong frequency, and steps that end at a bound."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.mode import maximise
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import Normal
from tests.inference.problems import linear_target

TRUTH = {"zeta": 0.01, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 2.0, "omega0": 0.0, "epsilon": 0.1}
PERIOD, NOISE = 1.9, 0.01
FAST = {**TRUTH, "stiffness": 24.0}
"""A start whose frequency is wrong by a tenth: over 40 cycles no search converges from there."""


@lru_cache
def swing() -> Target:
    """Return a large swing of a pendulum, whose frequency changes with its amplitude."""
    t = np.linspace(0.0, 75.0, 3000)
    y = simulate(Oscillator(("viscous",), "pendulum"), TRUTH, t)
    y += NOISE * np.random.default_rng(3).standard_normal(t.size)
    start = {"theta0": Normal(mean=0.0, sd=4.0), "omega0": Normal(mean=0.0, sd=18.0)}
    return linear_target(t, y, "viscous", {"epsilon": 0.1, "noise_sd": NOISE}, law="pendulum", **start)


def test_a_start_with_a_wrong_frequency_converges_with_growing_windows() -> None:
    """The stiffness agrees with the truth within six of its errors. Control: a search with the whole record at once."""
    control = find_mode(swing(), [FAST], noise_level=NOISE)
    mode = find_mode(swing(), [FAST], noise_level=NOISE, period=PERIOD)
    assert len(mode.searches) == 2  # from the start itself, and after growing windows
    wrong, right = (abs(swing().values(m.z)["stiffness"] - TRUTH["stiffness"]) for m in (control, mode))
    assert wrong > 1.0
    assert right < 6 * 4e-4


def test_a_step_that_a_bound_shortens_is_not_convergence() -> None:
    """The full step from (0.1, 4.9) leads to the maximum, where x is below zero; cut at x = 0 it ends lower than it
    began. The maximum with x not below zero is known: x = 0, y = 3 + 0.95 · 2."""
    information = np.array([[1.0, -0.95], [-0.95, 1.0]])
    top = np.array([-2.0, 3.0])

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        away = z - top
        return np.array(-0.5 * away @ information @ away), -information @ away, information

    for start in ([0.1, 4.9], [3.0, 1.0], [0.5, 6.0]):
        result = maximise(at, np.array([True, False]), np.array(start))
        assert result.converged
        assert result.x == pytest.approx([0.0, 3.0 + 0.95 * 2.0], abs=1e-3)


def test_a_search_without_a_shorter_step_that_succeeds_has_not_converged() -> None:
    """The gradient is wrong: the density is lower everywhere else."""

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return np.array(-float(z[0] != 1.0)), np.array([1e4]), np.eye(1)

    assert not maximise(at, np.array([False]), np.array([1.0])).converged
