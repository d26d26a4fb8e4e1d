"""Records with gaps: the whole record is one decay, and a gap is not taken for a beat."""

import numpy as np
import pytest

from bayesdamp.interface.first_words import first_words
from bayesdamp.records.cleaning.window import free_decay
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.modes import find_other_motion
from bayesdamp.records.oscillation.noise import coarse_period, coarse_periods
from bayesdamp.types import Signal

FREQUENCY, RATE, START, NOISE = 1.3, 0.05, 0.4, 0.002


def with_gaps(seed: int, *more: tuple[float, float, float]) -> Signal:
    """Return 40 s at 60 Hz with three gaps of 5 s; more: other oscillations (amplitude, frequency, decay rate)."""
    rng = np.random.default_rng([31, seed])
    t = np.arange(0.0, 40.0, 1 / 60)
    y = 0.05 + START * np.exp(-RATE * t) * np.cos(2 * np.pi * FREQUENCY * t)
    for amplitude, frequency, rate in more:
        y += amplitude * np.exp(-rate * t) * np.cos(2 * np.pi * frequency * t)
    y += NOISE * rng.standard_normal(t.size)
    recorded = np.ones(t.size, bool)
    for begin in np.array([4.0, 17.0, 28.0]) + rng.uniform(0, 5, 3):
        recorded &= (t < begin) | (t > begin + 5.0)
    return Signal(t[recorded], y[recorded], name=f"gaps {seed}")


@pytest.mark.parametrize("seed", range(2))
def test_a_record_with_gaps_is_one_decay(seed: int) -> None:
    """Its amplitudes are those at its first and last sample, not those of its longest part without a gap.

    The damping ratios are within five standard errors of the truth.
    """
    signal = with_gaps(seed)
    values = features(signal)
    assert values.amplitude == pytest.approx(START, rel=0.05)
    assert values.final_amplitude == pytest.approx(START * np.exp(-RATE * 40), rel=0.05)
    assert values.frequency == pytest.approx(2 * np.pi * FREQUENCY, rel=1e-3)
    assert values.cycles == pytest.approx(40 * FREQUENCY, abs=1.0)
    assert np.all(np.diff(values.turning_times) < 0.6 / FREQUENCY)
    assert np.all(np.diff(values.turning_amplitudes) < 3 * NOISE), "the edge of a gap is not a turning point"
    assert find_other_motion(signal.t, signal.y, 1 / FREQUENCY) is None
    window = free_decay(signal.t, signal.y, coarse_periods(signal.t, signal.y), 0.0, True, True, "gaps")
    assert signal.t[window.first] < 1 / FREQUENCY
    assert signal.t[window.last] > 40 - 1 / FREQUENCY
    assert len(window.decays) == 1
    damping = first_words(signal)
    assert damping.amplitude[0] > 0.9 * START
    assert damping.amplitude[2] < 1.1 * START * np.exp(-RATE * 40)
    assert np.all(np.abs(damping.ratio - RATE / (2 * np.pi * FREQUENCY)) < 5 * damping.ratio_sd + 1e-5)


def test_beats_are_recognised_in_spite_of_gaps() -> None:
    """Negative control."""
    signal = with_gaps(0, (0.3, 1.08 * FREQUENCY, RATE))
    assert find_other_motion(signal.t, signal.y, 1 / FREQUENCY).kind == "beats"


def test_a_second_release_within_a_gap_is_recognised() -> None:
    """Negative control: after the second gap the amplitude is three times as large."""
    signal = with_gaps(0)
    begin = signal.t[np.flatnonzero(np.diff(signal.t) > 1)[1]]
    y = np.where(signal.t > begin + 1, 0.05 + 3 * (signal.y - 0.05), signal.y)
    window = free_decay(signal.t, y, coarse_periods(signal.t, y), 0.0, True, True, "gaps")
    assert signal.t[window.first] > begin or signal.t[window.last] <= begin


def test_the_period_is_not_that_of_long_gaps() -> None:
    """Control: if lines across the gaps are samples, the period is that of the gaps, six times as long."""
    t = np.arange(0.0, 35.0, 1 / 30)
    y = np.exp(-0.02 * t) * np.cos(2 * np.pi * 0.42 * t)
    recorded = np.all([(t < a) | (t > b) for a, b in ((5.0, 9.8), (13.3, 18.0), (21.5, 26.4))], axis=0)
    assert coarse_period(t[recorded], y[recorded])[0] == pytest.approx(1 / 0.42, rel=0.1)
    assert coarse_period(t, np.interp(t, t[recorded], y[recorded]))[0] > 5 / 0.42
