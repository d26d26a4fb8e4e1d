"""The factor of the covariance at a mode."""

import numpy as np
import pytest

from bayesdamp.inference.mode import covariance_factor
from bayesdamp.types import Refusal


def test_the_factor_is_exact_for_very_different_scales():
    """It is the lower factor of the inverse, to rounding, also where the rounded inverse is not positive definite."""
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    mild = turn @ np.diag([1.0, 4.0, 30.0, 900.0]) @ turn.T
    np.testing.assert_allclose(covariance_factor(mild), np.linalg.cholesky(np.linalg.inv(mild)), rtol=1e-9)
    scale = np.diag([1.0, 1e8, 1e3, 1e-2])
    factor = covariance_factor(scale @ mild @ scale)
    np.testing.assert_allclose(factor, np.linalg.inv(scale) @ covariance_factor(mild), rtol=1e-9)
    np.testing.assert_allclose(np.triu(factor, 1), 0.0)
    for bad in (np.diag([1.0, -1.0]), np.diag([1.0, np.nan])):
        with pytest.raises(Refusal, match="not positive definite at its mode"):
            covariance_factor(bad)
