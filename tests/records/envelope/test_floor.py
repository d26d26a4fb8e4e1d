"""The noise floor estimated from the readings after a decay, and the noise of averaged readings."""

import numpy as np
import pytest

from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.records.envelope.window import NoiseFloor, measure_floor
from validation.truth.ringdowns import wandering


def floor(slow: float, constant: float, decay: float, seed: int) -> NoiseFloor:
    """Measure a floor of power 2 over 400 decay times: `slow` is the share of thermal motion in what fluctuates."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 400.0, 0.02)
    complex_noise = np.zeros(t.size, complex)
    for share, time in ((1 - slow, 0.01), (slow, 1.0)):
        part = wandering(t.size, 0.02, time, rng) + 1j * wandering(t.size, 0.02, time, rng)
        complex_noise += np.sqrt(share * (2.0 - constant) / 2) * part
    return measure_floor(t, np.abs(decay + complex_noise) ** 2 + constant, np.full(t.size, decay**2), 1.0)


@pytest.mark.parametrize("slow", [0.0, 0.9])
def test_a_floor_is_separated_into_its_fluctuating_and_constant_parts(slow):
    """With 400 independent values of thermal motion the power is known to about 10 %."""
    for constant, decay in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        measured = floor(slow, constant, decay, 1)
        assert measured.power == pytest.approx(2.0, rel=0.25)
        fluctuating, rest, _, _ = measured.parts(slow)
        assert fluctuating == pytest.approx(2.0 - constant, rel=0.25)
        assert rest == pytest.approx(constant, abs=0.4)


def test_the_share_of_thermal_motion_is_weighed_by_the_readings():
    """Negative control: the floor has the opposite share."""
    fast = floor(0.0, 0.0, 0.0, 2)
    assert fast.parts(0.9)[3] < fast.parts(0.0)[3] - 5.0
    slow = floor(0.9, 0.0, 0.0, 2)
    assert slow.parts(0.9)[3] > slow.parts(0.0)[3] + 0.3


def test_means_of_readings_have_the_simulated_covariance():
    """Negative control: each mean is taken for one reading."""
    each, apart, time = 12, 0.1, 0.4
    values = wandering(each * 40_000, apart, time, np.random.default_rng(3)).reshape(-1, each).mean(axis=1)
    t = each * apart * np.arange(4)
    first, second = Noise(1e-9, 1.0, 2.0, time, 0.0, each=each, apart=apart).covariance(t, np.zeros(4))[0, :2]
    assert first == pytest.approx(np.var(values), rel=0.03)
    assert second == pytest.approx(np.mean(values[1:] * values[:-1]), rel=0.06)
    single = Noise(1e-9, 1.0, 2.0, time, 0.0, each=1.0, apart=each * apart)
    assert single.covariance(t, np.zeros(4))[0, 0] > 2 * first
