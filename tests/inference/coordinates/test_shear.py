"""A curved ridge: found, straightened without changing volumes, and worth it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.evidence import Draws, bridge, importance
from bayesdamp.types import OK
from tests.inference.coordinates.densities import agrees, posterior_of

NAMES = ("mu", "k", "g", "s")
FOLDED = np.array([True, False, False, False])
WIDTH, TILT = 0.02, 0.6
"""The ridge k = TILT·g·s, so wide; g and s have their priors, mu is a reflected normal of sd 0.3."""
SCALE = np.array([0.3, 1.0, 1.0, 1.0])


def height(z: np.ndarray) -> np.ndarray:
    """Log density of scores z, (..., 4), all of whose integral over the reflected side is known."""
    mu, k, g, s = np.moveaxis(z, -1, 0)
    return -0.5 * ((mu / SCALE[0]) ** 2 + g**2 + s**2 + ((k - TILT * g * s) / WIDTH) ** 2)


AREA = np.log(SCALE[0] * WIDTH / 2) + 2 * np.log(2 * np.pi)


def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The density at scores z, (4,), its gradient and its Gauss–Newton information."""
    mu, k, g, s = z
    off = (k - TILT * g * s) / WIDTH
    row = np.array([0.0, 1.0, -TILT * s, -TILT * g]) / WIDTH
    gradient = -np.array([mu / SCALE[0] ** 2, 0.0, g, s]) - off * row
    return height(z), gradient, np.diag([SCALE[0] ** -2, 0.0, 1.0, 1.0]) + np.outer(row, row)


@pytest.fixture
def banana() -> tuple[Any, Any]:
    return posterior_of(NAMES, FOLDED, np.zeros(4), height, slopes)


def test_importance_along_a_curved_ridge_has_the_closed_form(banana, monkeypatch) -> None:
    """Negative control: with the ridge left curved the weights have no finite variance."""
    evidence = importance.PLUGIN.evidence("m", *banana, seed=3)
    assert agrees(evidence, AREA, 0.03)
    z = evidence.arrays["y"]
    assert np.corrcoef(z[:, 1], z[:, 2] * z[:, 3])[0, 1] > 0.9  # draws are scores, not straightened ones
    monkeypatch.setattr(importance, "shear_of", lambda target, mode: None)
    crooked = importance.PLUGIN.evidence("m", *banana, seed=3)
    assert crooked.outcome != OK or crooked.stderr > 3 * evidence.stderr


def test_bridge_along_a_curved_ridge_has_the_closed_form(banana, monkeypatch) -> None:
    """From exact draws; four standard errors. Negative control: with the ridge left curved the fit hardly meets
    it."""
    z = np.random.default_rng(5).standard_normal((4, 1000, 4)) * [SCALE[0], WIDTH, 1.0, 1.0]
    z[..., 0] = np.abs(z[..., 0])
    z[..., 1] += TILT * z[..., 2] * z[..., 3]
    evidence = bridge.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z))
    assert agrees(evidence, AREA, 0.03)
    monkeypatch.setattr(bridge, "shear_of", lambda target, mode: None)
    assert bridge.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z)).stderr > 3 * evidence.stderr
