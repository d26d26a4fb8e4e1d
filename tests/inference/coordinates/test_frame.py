"""Leapfrog steps that bounce off walls, and the coordinates of a posterior that ends at zero."""

from __future__ import annotations

from functools import lru_cache

import jax
import numpy as np
import pytest
from blackjax.mcmc import nuts
from blackjax.mcmc.hmc import HMCState
from jax import numpy as jnp

from bayesdamp.inference.coordinates.frame import cut_off, frame
from bayesdamp.inference.fit.mode import whitening
from bayesdamp.inference.samplers._reflect import drift, reflecting_leapfrog
from bayesdamp.types import Refusal
from tests.inference import problems

WALLS = np.array([[1.0, 0.2, 0.0], [-0.7, 1.0, 0.3], [0.1, -0.5, 1.0]])
OFFSETS = np.array([0.5, 0.4, 0.3])
WITHIN = (jnp.asarray(WALLS), jnp.asarray(OFFSETS))
INSIDE = np.array([0.1, 0.2, 0.3])


def flights(seed: int, count: int = 50) -> list[np.ndarray]:
    return list(2.0 * np.random.default_rng(seed).standard_normal((count, 3)))


def test_a_flight_stays_within_the_walls_and_runs_backwards():
    for p in flights(0):
        u, v = drift(jnp.asarray(INSIDE), jnp.asarray(p), jnp.asarray(1.5), *WITHIN)
        assert np.all(WALLS @ u + OFFSETS > -1e-12)
        assert np.linalg.norm(v) == pytest.approx(np.linalg.norm(p), rel=1e-12)
        back, was = drift(u, v, jnp.asarray(-1.5), *WITHIN)
        np.testing.assert_allclose(back, INSIDE, atol=1e-10)
        np.testing.assert_allclose(was, p, atol=1e-10)


def test_a_flight_keeps_volume():
    def both(x: jax.Array) -> jax.Array:
        return jnp.concatenate(drift(x[:3], x[3:], jnp.asarray(1.5), *WITHIN))

    jacobian = jax.jit(jax.jacfwd(both))
    for p in flights(1, 20):
        matrix = jacobian(jnp.concatenate([INSIDE, p]))
        assert abs(np.linalg.det(matrix)) == pytest.approx(1.0, rel=1e-9)
    # Negative control: being put back on the wall, as a clipped step would be, keeps no volume.
    clipped = jax.jacfwd(lambda u: jnp.maximum(u, 0.0))(jnp.array([-0.1, 0.2, 0.3]))
    assert np.linalg.det(clipped) == 0.0


def test_no_walls_no_bounces():
    u, p = drift(jnp.zeros(3), jnp.ones(3), jnp.asarray(2.0), jnp.empty((0, 3)), jnp.empty(0))
    np.testing.assert_array_equal(u, 2 * np.ones(3))
    np.testing.assert_array_equal(p, np.ones(3))


@lru_cache
def between_walls(bend: float) -> tuple[np.ndarray, np.ndarray]:
    """NUTS on a normal distribution between three oblique walls, and the same by rejection: moments.

    bend: the force is that of a distribution so much wider, and only the energies are right.
    """
    centre = jnp.array([-0.5, 0.3, 0.0])

    def value(u: jax.Array) -> jax.Array:
        return -0.5 * jnp.sum((u - centre) ** 2)

    def force(u: jax.Array) -> jax.Array:
        return (centre - u) / bend

    kernel = nuts.build_kernel(reflecting_leapfrog(value, force, jnp.asarray(WALLS), jnp.asarray(OFFSETS)))

    def advance(state, key):
        state, _ = kernel(key, state, value, 0.6, jnp.ones(3), 7)
        return state, state.position

    def chain(key):
        start = jnp.asarray(INSIDE)
        state = HMCState(start, value(start), force(start))
        return jax.lax.scan(advance, state, jax.random.split(key, 20_000))[1]

    keys = jax.random.split(jax.random.PRNGKey(0), 4)
    found = np.asarray(jax.jit(jax.vmap(chain))(keys))[:, 500:].reshape(-1, 3)
    drawn = np.asarray(centre) + np.random.default_rng(3).standard_normal((1_500_000, 3))
    expected = drawn[np.all(drawn @ WALLS.T + OFFSETS > 0, axis=1)]
    assert len(expected) > 50_000
    return (
        np.r_[found.mean(axis=0), found.std(axis=0)],
        np.r_[expected.mean(axis=0), expected.std(axis=0)],
    )


@pytest.mark.parametrize("bend", [1.0, 1.5])
def test_draws_between_walls(bend):
    """Six moments, errors of each below 0.006 on either side: within 0.035, no false alarm in 10⁴."""
    found, expected = between_walls(bend)
    np.testing.assert_allclose(found, expected, atol=0.035)
    # Negative control: without walls the moments are those of the whole distribution.
    assert np.max(np.abs(np.r_[-0.5, 0.3, 0.0, 1.0, 1.0, 1.0] - expected)) > 0.2


def test_cut_off_normal_against_rejection():
    """2 × 4,000 draws: errors of 0.02 sd; 0.1 sd is five."""
    mean, root = np.array([-0.4, 0.6]), np.array([[1.0, 0.0], [-0.8, 0.6]])
    drawn = mean + np.random.default_rng(1).standard_normal((200_000, 2)) @ root.T
    expected = drawn[np.all(drawn > 0, axis=1)]
    found = cut_off(mean, root @ root.T)
    assert np.all(found >= 0)
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), atol=0.1)
    np.testing.assert_allclose(np.cov(found.T), np.cov(expected.T), atol=0.08)


def test_cut_off_normal_on_a_thin_sheet():
    """Coefficients of which the sum alone is known, to a share of 1e-4: between the walls they are uniform on a
    triangle, whose moments are those of Dirichlet's distribution. 2,000 effective draws: sds of 0.005; the control is
    the normal's own mean, which is far outside."""
    total, away = 0.03, np.array([-0.2, 0.1, 0.13])
    loose = 0.25**2 * (np.eye(3) - 1 / 3) + (1e-4 * total) ** 2 / 3
    found = cut_off(away, loose) / total
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-3)
    np.testing.assert_allclose(found.mean(axis=0), 1 / 3, atol=0.03)
    np.testing.assert_allclose(found.std(axis=0), 1 / np.sqrt(18), atol=0.03)
    assert np.min(away / total) < -1


def test_cut_off_far_from_the_wall_and_far_beyond_it():
    """A normal that hardly meets the wall keeps its moments; far beyond, what is left is exponential."""
    far = cut_off(np.array([30.0]), np.array([[1.0]]))
    assert far.mean() == pytest.approx(30.0, abs=0.1)
    beyond = cut_off(np.array([-50.0]), np.array([[1.0]]))
    assert beyond.mean() == pytest.approx(1 / 50, rel=0.1)
    assert beyond.std() == pytest.approx(1 / 50, rel=0.15)


@pytest.mark.parametrize("name", ["viscous_coulomb", "touching_zero"])
def test_the_posterior_is_round_in_its_frame(name):
    target, mode = problems.target(name), problems.mode(name)
    at = frame(target, mode)
    assert at.good
    assert np.all(at.centre[np.asarray(target.layout.folded)] > 0)
    draws = problems.posterior(name, "nuts").draws.reshape(-1, len(target.names))
    z = np.stack([target.scores(dict(zip(target.names, x))) for x in draws[::4]])
    u = np.linalg.solve(at.factor, (z - at.centre).T)
    assert np.all(np.abs(u.mean(axis=1)) < 0.35)
    np.testing.assert_allclose(np.cov(u), np.eye(len(z[0])), atol=0.35)


def test_whitening_of_stiff_and_loose_directions():
    """The lower factor of the inverse, to rounding, where the inverse itself has lost its positivity to it."""
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    mild = turn @ np.diag([1.0, 4.0, 30.0, 900.0]) @ turn.T
    np.testing.assert_allclose(whitening(mild), np.linalg.cholesky(np.linalg.inv(mild)), rtol=1e-9)
    scale = np.diag([1.0, 1e8, 1e3, 1e-2])
    factor = whitening(scale @ mild @ scale)
    np.testing.assert_allclose(factor, np.linalg.inv(scale) @ whitening(mild), rtol=1e-9)
    np.testing.assert_allclose(np.triu(factor, 1), 0.0)
    for bad in (np.diag([1.0, -1.0]), np.diag([1.0, np.nan])):
        with pytest.raises(Refusal, match="no curvature"):
            whitening(bad)


def test_whitening_where_the_inverse_is_positive_no_more():
    """Two loose directions and two stiff ones, turned anyhow: rounding takes most inverses' positivity, no factor's."""
    lost = 0
    for seed in range(20):
        turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((4, 4)))[0]
        stiff = turn @ np.diag([1.0, 1.0, 1e14, 1e14]) @ turn.T
        factor = whitening(stiff)
        np.testing.assert_allclose(factor.T @ stiff @ factor, np.eye(4), atol=0.1)
        try:
            np.linalg.cholesky(np.linalg.inv(0.5 * (stiff + stiff.T)))
        except np.linalg.LinAlgError:
            lost += 1
    assert lost > 5  # the control: inverted first, these have no factor
