"""Evidence of three coefficients whose sum alone is well determined, between walls at zero."""

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from bayesdamp.inference.evidence import importance
from tests.inference.coordinates.densities import agrees, posterior_of

TOTAL, WIDTH = 0.03, 3e-5
"""Sum of three coefficients and its sd, with half-normal priors of scale 1."""
AREA = np.log((2 / np.pi) ** 1.5 * 0.5 * TOTAL**2 * WIDTH * np.sqrt(2 * np.pi)) - TOTAL**2 / 4
"""Log of the integral: the density of the prior times the area of the triangle, integrated over the sum. The mean of
e^(−Σx²/2) over the triangle is e^(−TOTAL²/4) to 1e-6."""


def height(z: np.ndarray) -> np.ndarray:
    """Return the log density of the three scores, (..., 3), where they are positive."""
    off = (z.sum(axis=-1) - TOTAL) / WIDTH
    return -0.5 * (off**2 + np.sum(z**2, axis=-1)) + 1.5 * np.log(2 / np.pi)


def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    gradient = -(z.sum() - TOTAL) / WIDTH**2 - z
    return height(z), gradient, np.eye(3) + np.ones((3, 3)) / WIDTH**2


@pytest.fixture
def sheet(monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """Return a target and its mode, which is at two of three walls."""
    monkeypatch.setattr(importance, "shear_of", lambda target, mode: None)
    return posterior_of(("a", "b", "c"), np.ones(3, bool), np.array([1e-9, 1e-9, TOTAL]), height, slopes)


def test_evidence_on_a_thin_sheet_between_walls(sheet: tuple[Any, Any]) -> None:
    assert agrees(importance.PLUGIN.evidence("m", *sheet, seed=3), AREA, 0.05)


def test_too_few_draws_with_weight_are_reported(
    sheet: tuple[Any, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Negative control: of draws from the normal distribution about the mode, mirrored at the walls, hardly any is
    near the sheet. The Pareto shape of the weights does not show this."""
    monkeypatch.setattr(importance, "truncated_about", Mock(side_effect=np.linalg.LinAlgError))
    evidence = importance.PLUGIN.evidence("m", *sheet, seed=3)
    assert evidence.outcome.startswith("not to be trusted: ")
    assert evidence.stderr > 0.1
