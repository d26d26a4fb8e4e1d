"""What the readings behind a decay tell of the floor, and how its noise is averaged."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.records.envelope.window import NoiseFloor, measure_floor
from validation.truth.ringdowns import wandering


def floor(slow: float, constant: float, decay: float, seed: int) -> NoiseFloor:
    """Of power 2 over 400 decay times, thermal motion in it to this share, beside a decay of this amplitude."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 400.0, 0.02)
    complex_noise = np.zeros(t.size, complex)
    for share, time in ((1 - slow, 0.01), (slow, 1.0)):
        part = wandering(t.size, 0.02, time, rng) + 1j * wandering(t.size, 0.02, time, rng)
        complex_noise += np.sqrt(share * (2.0 - constant) / 2) * part
    power = np.abs(decay + complex_noise) ** 2 + constant
    return measure_floor(t, power, np.full(t.size, decay**2), 1.0)


@pytest.mark.parametrize("slow", [0.0, 0.9])
def test_a_floor_is_taken_apart(slow):
    """With 400 independent values of thermal motion the power is known to some 10 %."""
    for constant, decay in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        seen = floor(slow, constant, decay, 1)
        assert seen.power == pytest.approx(2.0, rel=0.25)
        fluctuating, rest, _, _ = seen.parts(slow)
        assert fluctuating == pytest.approx(2.0 - constant, rel=0.25)
        assert rest == pytest.approx(constant, abs=0.4)


def test_a_share_that_the_readings_contradict_weighs_little():
    """Negative control: a floor all of which is fast cannot be nine tenths thermal motion."""
    seen = floor(0.0, 0.0, 0.0, 2)
    assert seen.parts(0.9)[3] < seen.parts(0.0)[3] - 5.0
    slow = floor(0.9, 0.0, 0.0, 2)
    assert slow.parts(0.9)[3] > slow.parts(0.0)[3] + 0.3


def test_means_of_readings_of_a_floor_scatter_as_simulated():
    rng = np.random.default_rng(3)
    each, apart, time = 12, 0.1, 0.4
    values = wandering(each * 40_000, apart, time, rng).reshape(-1, each).mean(axis=1)
    t = each * apart * np.arange(4)
    noise = Noise(1e-9, 1.0, 2.0, time, 0.0, each=each, apart=apart)
    found = noise.covariance(t, np.zeros(4))[0]
    assert found[0] == pytest.approx(np.var(values), rel=0.03)
    assert found[1] == pytest.approx(np.mean(values[1:] * values[:-1]), rel=0.06)
    # Negative control: as if each mean were one reading.
    assert (
        Noise(1e-9, 1.0, 2.0, time, 0.0, each=1.0, apart=each * apart).covariance(t, np.zeros(4))[0, 0]
        > 2 * found[0]
    )
