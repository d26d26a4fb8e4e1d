"""The no-U-turn sampler against closed forms, between walls against rejection sampling, and its flights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.samplers.nuts import Chain, drift

D, CHAINS, COUNT = 5, 4, 2500
MEAN = np.array([0.5, -1.0, 0.0, 2.0, 0.2])
_ROOT = np.tril(np.random.default_rng(12).uniform(-0.5, 0.5, (D, D)), -1)
COVARIANCE = (np.eye(D) + _ROOT) @ (np.eye(D) + _ROOT).T
PRECISION = np.linalg.inv(COVARIANCE)
TWO = (np.eye(D)[[0, 4]] + 0.3 * np.eye(D)[[1, 2]], np.array([0.0, 0.3]))
"""Two oblique walls that cut off nearly two thirds of the normal."""
NONE = (np.empty((0, D)), np.empty(0))
SIGMAS = 5.0
"""Monte Carlo errors that a moment may be off: a false alarm in 1.7 million, in 10⁵ for the ten of a test."""

WALLS = np.array([[1.0, 0.2, 0.0], [-0.7, 1.0, 0.3], [0.1, -0.5, 1.0]])
OFFSETS = np.array([0.5, 0.4, 0.3])
INSIDE = np.array([0.1, 0.2, 0.3])


@dataclass(frozen=True)
class CutOff:
    """A correlated normal within walls; what the force is that moves proposals, as a multiple of its gradient."""

    walls: np.ndarray
    offsets: np.ndarray
    force: float = 1.0

    def height(self, u: np.ndarray) -> float:
        """Return the log density up to a constant."""
        return -0.5 * float((u - MEAN) @ PRECISION @ (u - MEAN))

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return the force."""
        return -self.force * (PRECISION @ (u - MEAN))


def sampled(space: CutOff, seed: int = 1, count: int = COUNT, step: float = 0.6) -> tuple[np.ndarray, ...]:
    """Positions (chain, draw, D) after 100 draws, with the acceptance, the steps and the divergences."""
    start = MEAN + np.array([1.0, 0.5, 0.0, 0.0, 1.0])
    each = [
        Chain(space, step, np.random.default_rng([seed, k])).sampled(start, space.height(start), count + 100)
        for k in range(CHAINS)
    ]
    u, _, diverging, steps, accepted = (np.stack([item[i][100:] for item in each]) for i in range(5))
    return u, accepted, steps, diverging


def off(u: np.ndarray, mean: np.ndarray, square: np.ndarray, errors: np.ndarray) -> float:
    """Largest departure of the means and mean squares, in Monte Carlo errors of both sides (errors: the other's)."""
    moments = np.concatenate([u, u**2], axis=-1)
    own = np.array([diagnostics.monte_carlo_error(moments[..., i]) for i in range(2 * D)])
    return float(np.max(np.abs(moments.mean(axis=(0, 1)) - np.r_[mean, square]) / np.hypot(own, errors)))


@lru_cache
def within(force: float = 1.0) -> tuple[np.ndarray, ...]:
    """What is drawn between the two walls."""
    return sampled(CutOff(*TWO, force))


@lru_cache
def by_rejection() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, mean squares, (D,), and the errors of both, (2 D,), of the normal within the two walls."""
    drawn = np.random.default_rng(3).multivariate_normal(MEAN, COVARIANCE, 1_000_000)
    left = drawn[np.all(drawn @ TWO[0].T + TWO[1] >= 0, axis=1)]
    assert 200_000 < len(left) < 800_000
    both = np.concatenate([left, left**2], axis=1)
    return both[:, :D].mean(axis=0), both[:, D:].mean(axis=0), both.std(axis=0) / np.sqrt(len(left))


def test_a_correlated_normal() -> None:
    """Means and variances in closed form; the control: a mean that is off by a fifth of its sd."""
    u, accepted, _, diverging = sampled(CutOff(*NONE))
    sd = np.sqrt(np.diag(COVARIANCE))
    assert off(u, MEAN, MEAN**2 + sd**2, np.zeros(2 * D)) < SIGMAS
    assert off(u, MEAN + 0.2 * sd * np.eye(D)[2], MEAN**2 + sd**2, np.zeros(2 * D)) > SIGMAS
    assert accepted.mean() > 0.7
    assert not diverging.any()
    correlation = np.corrcoef(u.reshape(-1, D).T)
    np.testing.assert_allclose(correlation, COVARIANCE / np.outer(sd, sd), atol=0.08)
    summary = diagnostics.summarise(u[..., 3])
    assert summary["rhat"] < 1.01
    assert summary["ess_bulk"] > 0.1 * CHAINS * COUNT


@pytest.mark.parametrize("force", [1.0, 0.7])
def test_a_normal_between_two_walls(force: float) -> None:
    """By rejection; also where the force is not the density's own. The control: moments of the whole normal are
    others."""
    mean, square, errors = by_rejection()
    u, *_ = within(force)
    assert np.all(u @ TWO[0].T + TWO[1] > -1e-12)
    assert off(u, mean, square, errors) < SIGMAS
    sd = np.sqrt(np.diag(COVARIANCE))
    assert off(u, MEAN, MEAN**2 + sd**2, errors) > 2 * SIGMAS


def test_a_force_of_the_wrong_sign_is_refused() -> None:
    """It drives proposals away: energies decide, so that few of them are accepted or many diverge."""
    _, right, _, diverging = sampled(CutOff(*NONE), count=200)
    _, wrong, _, astray = sampled(CutOff(*NONE, force=-1.0), count=200)
    assert not diverging.any()
    assert wrong.mean() < 0.5 * right.mean()
    assert astray.mean() > 0.002 or wrong.mean() < 0.5


def flights(seed: int, count: int = 50) -> np.ndarray:
    """Momenta, (count, 3)."""
    return 2.0 * np.random.default_rng(seed).standard_normal((count, 3))


def test_a_flight_stays_within_the_walls_and_runs_backwards() -> None:
    bounced = 0
    for p in flights(0):
        u, v = drift(INSIDE, p, 1.5, WALLS, OFFSETS)
        assert np.all(WALLS @ u + OFFSETS > -1e-12)
        assert np.linalg.norm(v) == pytest.approx(np.linalg.norm(p), rel=1e-12)
        back, was = drift(u, v, -1.5, WALLS, OFFSETS)
        np.testing.assert_allclose(back, INSIDE, atol=1e-10)
        np.testing.assert_allclose(was, p, atol=1e-10)
        bounced += not np.allclose(v, p)
    assert bounced > 25
    # Negative control: a position that is put back to the wall instead does not find its way.
    p = np.array([-2.0, 0.0, 0.0])
    clipped = np.maximum(INSIDE + 1.5 * p, -0.4)
    assert not np.allclose(np.maximum(clipped - 1.5 * p, -0.4), INSIDE)


def test_a_flight_keeps_volume() -> None:
    def both(x: np.ndarray) -> np.ndarray:
        return np.concatenate(drift(x[:3], x[3:], 1.5, WALLS, OFFSETS))

    steps = 1e-6 * np.eye(6)
    sizes = []
    for p in flights(1, 20):
        at = np.concatenate([INSIDE, p])
        jacobian = np.stack([(both(at + h) - both(at - h)) / 2e-6 for h in steps], axis=-1)
        sizes.append(abs(np.linalg.det(jacobian)))
    # A flight that ends within a difference's step of a bounce has no derivative there: none of these does.
    np.testing.assert_allclose(sizes, 1.0, rtol=1e-6)


def test_too_many_bounces_end_nowhere() -> None:
    """Between two walls that are close, four bounces for each are allowed."""
    walls, offsets = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([0.5, 0.5])
    u, _ = drift(np.zeros(2), np.array([1.0, 0.3]), 7.0, walls, offsets)
    np.testing.assert_allclose(u, [0.0, 2.1], atol=1e-12)
    assert np.all(np.isnan(drift(np.zeros(2), np.array([1.0, 0.3]), 70.0, walls, offsets)[0]))
