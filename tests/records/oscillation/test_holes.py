"""Records with stretches without a sample: the whole record is one decay, and a hole is no beat."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.records.cleaning.window import free_decay
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import first_words
from bayesdamp.records.oscillation.modes import find_other_motion
from bayesdamp.records.oscillation.spectrum import coarse_periods
from bayesdamp.types import Signal

FREQUENCY, RATE, START, NOISE = 1.3, 0.05, 0.4, 0.002


def holed(seed: int, *more: tuple[float, float, float]) -> Signal:
    """40 s at 60 Hz without three stretches of 5 s; more: other oscillations (amplitude, frequency, decay rate)."""
    rng = np.random.default_rng([31, seed])
    t = np.arange(0.0, 40.0, 1 / 60)
    y = 0.05 + START * np.exp(-RATE * t) * np.cos(2 * np.pi * FREQUENCY * t)
    for amplitude, frequency, rate in more:
        y += amplitude * np.exp(-rate * t) * np.cos(2 * np.pi * frequency * t)
    y += NOISE * rng.standard_normal(t.size)
    kept = np.ones(t.size, bool)
    for begin in np.array([4.0, 17.0, 28.0]) + rng.uniform(0, 5, 3):
        kept &= (t < begin) | (t > begin + 5.0)
    return Signal(t[kept], y[kept], name=f"holed {seed}")


@pytest.mark.parametrize("seed", range(2))
def test_a_record_with_holes_is_one_decay(seed: int) -> None:
    """Amplitudes are those at its first and last sample, to 5 %, and not those of the longest run between two holes;
    the damping ratio is within five of its errors."""
    signal = holed(seed)
    found = features(signal)
    assert found.amplitude == pytest.approx(START, rel=0.05)
    assert found.final_amplitude == pytest.approx(START * np.exp(-RATE * 40), rel=0.05)
    assert found.frequency == pytest.approx(2 * np.pi * FREQUENCY, rel=1e-3)
    assert found.cycles == pytest.approx(40 * FREQUENCY, abs=1.0)
    assert np.all(np.diff(found.turning_times) < 0.6 / FREQUENCY)
    assert np.all(np.diff(found.turning_amplitudes) < 3 * NOISE), "a turning point at a hole's edge is none"
    assert find_other_motion(signal.t, signal.y, 1 / FREQUENCY) is None
    window = free_decay(signal.t, signal.y, coarse_periods(signal.t, signal.y), 0.0, True, True, "holed")
    assert signal.t[window.first] < 1 / FREQUENCY
    assert signal.t[window.last] > 40 - 1 / FREQUENCY
    assert len(window.decays) == 1
    damping = first_words(signal).damping
    assert damping[0].amplitude > 0.9 * START
    assert damping[2].amplitude < 1.1 * START * np.exp(-RATE * 40)
    for one in damping:
        assert abs(one.ratio - RATE / (2 * np.pi * FREQUENCY)) < 5 * one.stderr + 1e-5


def test_beats_with_holes_are_beats() -> None:
    """Negative control."""
    signal = holed(0, (0.3, 1.08 * FREQUENCY, RATE))
    found = find_other_motion(signal.t, signal.y, 1 / FREQUENCY)
    assert found.kind == "beats"


def test_a_second_release_within_a_hole_is_one() -> None:
    """Negative control: behind the hole it swings further than before it."""
    signal = holed(0)
    begin = signal.t[
        np.argmax(np.diff(signal.t)[signal.t[:-1] > 15] > 1) + np.count_nonzero(signal.t[:-1] <= 15)
    ]
    y = np.where(signal.t > begin + 1, 0.05 + 3 * (signal.y - 0.05), signal.y)
    window = free_decay(signal.t, y, coarse_periods(signal.t, y), 0.0, True, True, "holed")
    assert signal.t[window.first] > begin or signal.t[window.last] <= begin
