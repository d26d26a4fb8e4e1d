"""Evidence of coefficients that make up for each other between the walls, and what is said where it is not found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.evidence import importance
from tests.inference.coordinates.densities import agrees, posterior_of

TOTAL, WIDTH = 0.03, 3e-5
"""Three coefficients whose sum alone the data tell, so exactly; under half-normal priors of scale 1."""
AREA = np.log((2 / np.pi) ** 1.5 * 0.5 * TOTAL**2 * WIDTH * np.sqrt(2 * np.pi)) - TOTAL**2 / 4
"""Log of their integral: the prior's density there times the triangle's area, over the sum; e^(−Σx²/2) is, on average
over the triangle, e^(−TOTAL²/4) to 1e-6."""


def height(z: np.ndarray) -> np.ndarray:
    """Log density of the three, (..., 3), on the reflected side."""
    off = (z.sum(axis=-1) - TOTAL) / WIDTH
    return -0.5 * (off**2 + np.sum(z**2, axis=-1)) + 1.5 * np.log(2 / np.pi)


def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    gradient = -(z.sum() - TOTAL) / WIDTH**2 - z
    return height(z), gradient, np.eye(3) + np.ones((3, 3)) / WIDTH**2


@pytest.fixture
def sheet(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """A target and its mode, at two of three walls."""
    monkeypatch.setattr(importance, "shear_of", lambda target, mode: None)
    return posterior_of(("a", "b", "c"), np.ones(3, bool), np.array([1e-9, 1e-9, TOTAL]), height, slopes)


def test_evidence_on_a_thin_sheet_between_walls(sheet: tuple[Any, Any]) -> None:
    assert agrees(importance.PLUGIN.evidence("m", *sheet, seed=3), AREA, 0.05)


def test_too_few_draws_with_weight_are_said(sheet: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """The negative control: from the mode's own normal distribution, mirrored at the walls, hardly a draw meets the
    sheet; the shape of weights that are nought in most shows nothing of it."""

    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(importance, "truncated_about", singular)
    lost = importance.PLUGIN.evidence("m", *sheet, seed=3)
    assert lost.outcome.startswith("not to be trusted: ")
    assert lost.stderr > 0.1
