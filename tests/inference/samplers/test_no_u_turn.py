"""The no-U-turn sampler against closed forms, between walls against rejection sampling, and its flights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference import diagnostics
from bayesdamp.inference.samplers.nuts import Chain, drift

D, CHAINS, COUNT = 5, 4, 2500
MEAN = np.array([0.5, -1.0, 0.0, 2.0, 0.2])
_ROOT = np.tril(np.random.default_rng(12).uniform(-0.5, 0.5, (D, D)), -1)
COVARIANCE = (np.eye(D) + _ROOT) @ (np.eye(D) + _ROOT).T
PRECISION = np.linalg.inv(COVARIANCE)
TWO = (np.eye(D)[[0, 4]] + 0.3 * np.eye(D)[[1, 2]], np.array([0.0, 0.3]))
"""Two oblique walls that cut off nearly two thirds of the normal."""
SIGMAS = 5.0
"""Monte Carlo errors that a moment may be off: a false alarm in 1.7 million, in 10⁵ for the ten of a test."""


@dataclass(frozen=True)
class CutOff:
    """A correlated normal within walls; what the force is that moves proposals, as a multiple of its gradient."""

    walls: np.ndarray
    offsets: np.ndarray
    scale: float = 1.0

    def log_density(self, u: np.ndarray) -> float:
        """Return the log density up to a constant."""
        return -0.5 * float((u - MEAN) @ PRECISION @ (u - MEAN))

    def force(self, u: np.ndarray) -> np.ndarray:
        """Return the force."""
        return -self.scale * (PRECISION @ (u - MEAN))


def off(u: np.ndarray, mean: np.ndarray, square: np.ndarray, errors: np.ndarray) -> float:
    """Largest departure of the means and mean squares, in Monte Carlo errors of both sides (errors: the other's)."""
    moments = np.concatenate([u, u**2], axis=-1)
    own = np.array([diagnostics.monte_carlo_error(moments[..., i]) for i in range(2 * D)])
    return float(np.max(np.abs(moments.mean(axis=(0, 1)) - np.r_[mean, square]) / np.hypot(own, errors)))


@lru_cache
def by_rejection() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, mean squares, (D,), and the errors of both, (2 D,), of the normal within the two walls."""
    drawn = np.random.default_rng(3).multivariate_normal(MEAN, COVARIANCE, 1_000_000)
    left = drawn[np.all(drawn @ TWO[0].T + TWO[1] >= 0, axis=1)]
    assert 200_000 < len(left) < 800_000
    both = np.concatenate([left, left**2], axis=1)
    return both[:, :D].mean(axis=0), both[:, D:].mean(axis=0), both.std(axis=0) / np.sqrt(len(left))


@pytest.mark.parametrize("force", [1.0, 0.7])
def test_a_normal_between_two_walls(force: float) -> None:
    """By rejection; also where the force is not the density's own. The control: moments of the whole normal are
    others."""
    mean, square, errors = by_rejection()
    space, start = CutOff(*TWO, force), MEAN + np.array([1.0, 0.5, 0.0, 0.0, 1.0])
    chains = [Chain(space, 0.6, np.random.default_rng([1, k])) for k in range(CHAINS)]
    u = np.stack([c.sample(start, space.log_density(start), COUNT + 100)[0][100:] for c in chains])
    assert np.all(u @ TWO[0].T + TWO[1] > -1e-12)
    assert off(u, mean, square, errors) < SIGMAS
    sd = np.sqrt(np.diag(COVARIANCE))
    assert off(u, MEAN, MEAN**2 + sd**2, errors) > 2 * SIGMAS


def test_too_many_bounces_end_nowhere() -> None:
    """Between two walls that are close, four bounces for each are allowed."""
    walls, offsets = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([0.5, 0.5])
    u, _ = drift(np.zeros(2), np.array([1.0, 0.3]), 7.0, walls, offsets)
    np.testing.assert_allclose(u, [0.0, 2.1], atol=1e-12)
    assert np.all(np.isnan(drift(np.zeros(2), np.array([1.0, 0.3]), 70.0, walls, offsets)[0]))
