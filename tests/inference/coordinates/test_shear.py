"""Evidence along a curved ridge, in coordinates in which it is straight, against the closed form."""

from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.evidence import Draws, bridge, importance
from tests.inference.coordinates.densities import agrees, posterior_of

NAMES = ("mu", "k", "g", "s")
FOLDED = np.array([True, False, False, False])
WIDTH, TILT = 0.02, 0.6
"""Width and tilt of the ridge k = TILT·g·s. g and s have their priors, mu is a reflected normal with an sd of 0.3."""
SCALE = np.array([0.3, 1.0, 1.0, 1.0])


def height(z: np.ndarray) -> np.ndarray:
    """Return the log density of scores z, (..., 4)."""
    mu, k, g, s = np.moveaxis(z, -1, 0)
    return -0.5 * ((mu / SCALE[0]) ** 2 + g**2 + s**2 + ((k - TILT * g * s) / WIDTH) ** 2)


AREA = np.log(SCALE[0] * WIDTH / 2) + 2 * np.log(2 * np.pi)
"""Log of the integral of the density over the side on which mu is positive."""


def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the log density at scores z, (4,), its gradient and its Gauss–Newton information."""
    mu, k, g, s = z
    off = (k - TILT * g * s) / WIDTH
    row = np.array([0.0, 1.0, -TILT * s, -TILT * g]) / WIDTH
    gradient = -np.array([mu / SCALE[0] ** 2, 0.0, g, s]) - off * row
    return height(z), gradient, np.diag([SCALE[0] ** -2, 0.0, 1.0, 1.0]) + np.outer(row, row)


@pytest.fixture
def banana() -> tuple[Any, Any]:
    return posterior_of(NAMES, FOLDED, np.zeros(4), height, slopes)


@pytest.mark.parametrize("method", [importance, bridge])
def test_evidence_along_a_curved_ridge_has_the_closed_form(banana, monkeypatch, method) -> None:
    """That of the bridge from exact draws. Control: in the scores themselves, the ridge is curved and the error is
    large."""
    z = np.random.default_rng(5).standard_normal((4, 1000, 4)) * [SCALE[0], WIDTH, 1.0, 1.0]
    z[..., 0] = np.abs(z[..., 0])
    z[..., 1] += TILT * z[..., 2] * z[..., 3]
    evidence = method.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z))
    assert agrees(evidence, AREA, 0.03)
    monkeypatch.setattr(method, "shear_of", lambda target, mode: None)
    assert method.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z)).stderr > 3 * evidence.stderr
