"""The coordinates of a posterior that ends at zero."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.coordinates.whitening import truncated, whitening_of
from bayesdamp.inference.fit.mode import whitening
from bayesdamp.types import Refusal
from tests.inference import problems


def test_cut_off_normal_against_rejection():
    """2 × 4,000 draws: errors of 0.02 sd; 0.1 sd is five."""
    mean, root = np.array([-0.4, 0.6]), np.array([[1.0, 0.0], [-0.8, 0.6]])
    drawn = mean + np.random.default_rng(1).standard_normal((200_000, 2)) @ root.T
    expected = drawn[np.all(drawn > 0, axis=1)]
    found = truncated(mean, root @ root.T)
    assert np.all(found >= 0)
    np.testing.assert_allclose(found.mean(axis=0), expected.mean(axis=0), atol=0.1)
    np.testing.assert_allclose(np.cov(found.T), np.cov(expected.T), atol=0.08)


def test_cut_off_normal_on_a_thin_sheet():
    """Coefficients of which the sum alone is known, to a share of 1e-4: between the walls they are uniform on a
    triangle, whose moments are those of Dirichlet's distribution. 2,000 effective draws: sds of 0.005; the control is
    the normal's own mean, which is far outside."""
    total, away = 0.03, np.array([-0.2, 0.1, 0.13])
    loose = 0.25**2 * (np.eye(3) - 1 / 3) + (1e-4 * total) ** 2 / 3
    found = truncated(away, loose) / total
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-3)
    np.testing.assert_allclose(found.mean(axis=0), 1 / 3, atol=0.03)
    np.testing.assert_allclose(found.std(axis=0), 1 / np.sqrt(18), atol=0.03)
    assert np.min(away / total) < -1


def test_cut_off_far_from_the_wall_and_far_beyond_it():
    """A normal that hardly meets the wall keeps its moments; far beyond, what is left is exponential."""
    far = truncated(np.array([30.0]), np.array([[1.0]]))
    assert far.mean() == pytest.approx(30.0, abs=0.1)
    beyond = truncated(np.array([-50.0]), np.array([[1.0]]))
    assert beyond.mean() == pytest.approx(1 / 50, rel=0.1)
    assert beyond.std() == pytest.approx(1 / 50, rel=0.15)


@pytest.mark.parametrize("name", ["viscous_coulomb", "touching_zero"])
def test_the_posterior_is_round_in_its_frame(name):
    target, mode = problems.target(name), problems.mode(name)
    at = whitening_of(target, mode)
    assert at.good
    assert np.all(at.centre[target.reflected] > 0)
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
