"""The noise level estimated from a record."""

import numpy as np
import pytest

from bayesdamp.estimators.shared import NOISE_SAMPLES, noise_level
from bayesdamp.types import Signal


def noisy(samples: int, sd: np.ndarray | float) -> Signal:
    t = np.linspace(0.0, 30.0, samples)
    wave = np.exp(-0.1 * t) * np.cos(4.5 * t)
    return Signal(t, wave + sd * np.random.default_rng(3).standard_normal(samples), "angle", "rad", "noisy")


@pytest.mark.parametrize("samples", [600, 3 * NOISE_SAMPLES])
def test_the_noise_level_is_the_standard_deviation_of_white_noise(samples):
    """Within four standard errors of a median of n values, 1.2/√n each. Control: twice the noise."""
    within = 5 / np.sqrt(min(samples, NOISE_SAMPLES))
    assert noise_level(noisy(samples, 0.01)) == pytest.approx(0.01, rel=within)
    assert noise_level(noisy(samples, 0.02)) != pytest.approx(0.01, rel=0.5)
