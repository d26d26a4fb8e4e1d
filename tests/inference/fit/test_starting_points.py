"""Searches for modes: from several starting points, and steps that end at a bound."""

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.mode import Mode, find_mode, group_searches, maximise
from bayesdamp.inference.model.target import Target
from bayesdamp.priors import LogNormal
from bayesdamp.types import Refusal
from tests.inference.problems import linear_target

STEP, FREQUENCY, RATE, SD = 0.35, 4.5, 0.06, 0.005
ALIAS = 2 * np.pi / STEP - FREQUENCY
"""A damped cosine at this frequency has the same values at all multiples of STEP."""


@lru_cache
def searched(jitter: float) -> tuple[Target, Mode]:
    """Return the target of a linear oscillator, sampled four times a period with so much jitter (s), and its mode."""
    rng = np.random.default_rng(5)
    t = STEP * np.arange(60) + np.concatenate([[0.0], jitter * rng.uniform(-1, 1, 59)])
    y = 0.3 * np.exp(-RATE * t) * np.cos(FREQUENCY * t) + SD * rng.standard_normal(t.size)
    target = linear_target(t, y, "viscous", {"noise_sd": SD}, stiffness=LogNormal(median=50.0, sigma=1.0))
    common = {"zeta": RATE, "theta0": 0.3, "omega0": 0.0}
    starts = [{**common, "stiffness": w**2} for w in (FREQUENCY, FREQUENCY, ALIAS)]
    return target, find_mode(target, starts, noise_level=SD)


def test_an_aliased_frequency_is_a_second_mode_of_the_same_likelihood():
    """The modes differ in their prior only. Two of the three searches start at the same point."""
    target, mode = searched(0.0)
    assert len(mode.searches) == 3
    (top, share), (other, other_share) = group_searches(mode)
    stiffness = sorted(float(target.values(z)["stiffness"]) for z in (top, other))
    np.testing.assert_allclose(stiffness, [FREQUENCY**2 + RATE**2, ALIAS**2 + RATE**2], rtol=0.01)
    prior = 0.5 * float(other @ other - top @ top)
    assert np.log(share / other_share) == pytest.approx(prior, abs=0.02)
    assert share + other_share == pytest.approx(1.0)
    assert other_share > 0.02


def test_without_aliasing_other_modes_have_no_probability():
    _, mode = searched(0.1)
    assert all(share < 1e-6 for _, share in group_searches(mode)[1:])


def test_noise_that_explains_the_oscillation_is_no_mode() -> None:
    """The known start has the wrong sign, so that only noise can explain the record. Control: the right sign."""
    t = 0.05 * np.arange(200)
    noise = SD * np.random.default_rng(5).standard_normal(t.size)
    y = 0.3 * np.exp(-RATE * t) * np.cos(FREQUENCY * t) + noise
    known = {"zeta": RATE, "stiffness": FREQUENCY**2, "omega0": 0.0}
    wrong, right = (linear_target(t, y, "viscous", {**known, "theta0": x}, "correlated") for x in (-0.3, 0.3))
    start = {"noise_sd": SD, "noise_time": 0.05}
    assert find_mode(right, [start], noise_level=SD).searches[0].converged
    with pytest.raises(Refusal, match="the noise model, not the motion, explains"):
        find_mode(wrong, [start], noise_level=SD)


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
