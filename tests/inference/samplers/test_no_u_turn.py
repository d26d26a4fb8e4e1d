"""The no-U-turn sampler between walls, against rejection sampling."""

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
"""Two oblique walls, beyond which is nearly two thirds of the normal distribution."""
SIGMAS = 5.0
"""Monte Carlo errors by which a moment may be off: a false alarm in 100,000 for the ten moments of a test."""


@dataclass(frozen=True)
class TruncatedByWalls:
    """A correlated normal distribution within walls. The force on proposals is a multiple of its gradient."""

    walls: np.ndarray
    offsets: np.ndarray
    scale: float = 1.0

    def log_density(self, u: np.ndarray) -> float:
        """Return the log density up to a constant."""
        return -0.5 * float((u - MEAN) @ PRECISION @ (u - MEAN))

    def force(self, u: np.ndarray) -> np.ndarray:
        """Return the force."""
        return -self.scale * (PRECISION @ (u - MEAN))


def largest_departure(u: np.ndarray, mean: np.ndarray, square: np.ndarray, errors: np.ndarray) -> float:
    """Return the largest departure of means and mean squares in Monte Carlo errors. errors: those of the other side."""
    moments = np.concatenate([u, u**2], axis=-1)
    own = np.array([diagnostics.monte_carlo_error(moments[..., i]) for i in range(2 * D)])
    return float(np.max(np.abs(moments.mean(axis=(0, 1)) - np.r_[mean, square]) / np.hypot(own, errors)))


@lru_cache
def by_rejection() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return means and mean squares, (D,), and the errors of both, (2 D,), of the distribution within two walls."""
    drawn = np.random.default_rng(3).multivariate_normal(MEAN, COVARIANCE, 1_000_000)
    inside = drawn[np.all(drawn @ TWO[0].T + TWO[1] >= 0, axis=1)]
    assert 200_000 < len(inside) < 800_000
    both = np.concatenate([inside, inside**2], axis=1)
    return both[:, :D].mean(axis=0), both[:, D:].mean(axis=0), both.std(axis=0) / np.sqrt(len(inside))


@pytest.mark.parametrize("force", [1.0, 0.7])
def test_draws_between_two_walls_have_the_moments_of_rejection_sampling(force: float) -> None:
    """Also if the force is not the gradient of the density. Control: the moments without walls are other ones."""
    mean, square, errors = by_rejection()
    space, start = TruncatedByWalls(*TWO, force), MEAN + np.array([1.0, 0.5, 0.0, 0.0, 1.0])
    chains = [Chain(space, 0.6, np.random.default_rng([1, k])) for k in range(CHAINS)]
    u = np.stack([c.sample(start, space.log_density(start), COUNT + 100)[0][100:] for c in chains])
    assert np.all(u @ TWO[0].T + TWO[1] > -1e-12)
    assert largest_departure(u, mean, square, errors) < SIGMAS
    sd = np.sqrt(np.diag(COVARIANCE))
    assert largest_departure(u, MEAN, MEAN**2 + sd**2, errors) > 2 * SIGMAS


def test_a_path_with_too_many_reflections_has_no_end() -> None:
    """Four reflections for each wall are allowed."""
    walls, offsets = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([0.5, 0.5])
    u, _ = drift(np.zeros(2), np.array([1.0, 0.3]), 7.0, walls, offsets)
    np.testing.assert_allclose(u, [0.0, 2.1], atol=1e-12)
    assert np.all(np.isnan(drift(np.zeros(2), np.array([1.0, 0.3]), 70.0, walls, offsets)[0]))
