"""Start and end of the decay in envelopes: simulated ones with a known release, and measured ones read by eye."""

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.envelope.record import make_record, read_envelope
from bayesdamp.records.envelope.window import find_window, window_between
from bayesdamp.types import InputError, Refusal
from validation.truth.ringdowns import Ringdown, simulate
from validation.truth.turning_points import CYCLES, readings

DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "ringdown"
# record: limits of the start in s, limits of the end in s
BY_EYE = {
    "measID_1000_sampleID_SP23-25.txt": ((35.5, 37.0), (55.0, 66.0)),
    "measID_1001_sampleID_SP23-26.txt": ((14.8, 16.0), (33.0, 39.0)),
    "measID_1005_sampleID_SP23-62.txt": ((39.8, 41.5), (65.0, 79.0)),
    "measID_1006_sampleID_SP23-62.txt": ((40.6, 42.0), (70.0, 85.0)),
    "measID_1007_sampleID_SP23-62.txt": ((45.0, 47.0), (76.0, 89.0)),
    "measID_1008_sampleID_SP23-62.txt": ((29.2, 31.0), (60.0, 69.0)),
    "measID_100_sampleID_0344.txt": ((1.15, 2.0), (9.0, 15.0)),
    "measID_101_sampleID_0344.txt": ((9.8, 10.6), (16.0, 22.0)),
}


@pytest.mark.skipif(not DATA.exists(), reason="the measured decays are not here")
@pytest.mark.parametrize("name", BY_EYE)
def test_a_measured_record_is_cut_as_by_eye(name):
    (first, last), (early, late) = BY_EYE[name]
    record = read_envelope(DATA / name)
    window = find_window(record.t, record.level)
    assert first <= record.t[window.start] <= last
    assert early <= record.t[window.stop - 1] <= late
    assert window.floor is not None


@pytest.mark.parametrize("drop", [0.0, 9.0])
def test_a_window_starts_at_the_release_and_ends_above_the_floor(drop):
    """The start is at most a hundredth of the decay before the release, and at most a tenth after it."""
    for rates in ({"viscous": 0.2}, {"viscous": 0.15, "coulomb": 0.01}, {"viscous": 0.2, "quadratic": 0.3}):
        truth = simulate(Ringdown(rates, drop=drop, scatter=0.02), np.random.default_rng(3))
        window = find_window(truth.t, truth.level)
        duration = truth.t[window.stop - 1] - truth.t[window.start]
        assert -0.01 * duration < truth.t[window.start] - truth.release < 0.1 * duration, rates
        # dB above the floor at the end
        assert 4.0 < 20 / np.log(10) * truth.x[window.stop - 1] + 45.0 < 20.0, rates


def test_a_saturated_start_is_cut_and_a_level_that_does_not_fall_is_refused():
    t, noise = np.linspace(0.0, 10.0, 1000), 0.01 * np.random.default_rng(1).standard_normal(1000)
    whole = find_window(t, -2.0 * t + noise)
    assert (whole.start, whole.stop, whole.floor) == (0, 1000, None)
    assert 1.9 < t[find_window(t, np.minimum(-3.0 * t, -6.0) + noise).start] < 2.6
    for rise in (0.0, 2.0):
        with pytest.raises(Refusal):
            find_window(t, rise * t + 10 * noise)


def test_given_bounds_are_used():
    t = np.linspace(0.0, 10.0, 400)
    window = window_between(t, -2.0 * t, 2.0, 7.0)
    assert t[window.start] == pytest.approx(2.0, abs=0.03)
    assert t[window.stop - 1] == pytest.approx(7.0, abs=0.03)
    with pytest.raises(Refusal, match="only 0 readings are between"):
        window_between(t, -2.0 * t, 11.0, None)


@pytest.mark.parametrize(
    ("force", "cycles"),
    [
        (lambda x, v, turn: 0.129 * (1 + np.exp(-((v / 1.2) ** 2))) * turn, 100.75),
        (lambda x, v, turn: 0.15 * v**3, CYCLES),
        (lambda x, v, turn: 0.13 * turn, CYCLES),
    ],
    ids=["stribeck", "cubic", "coulomb"],
)
def test_a_decay_that_is_not_straight_in_decibels_is_not_cut(force, cycles):
    """Control: a drive before the release is cut off. With more cycles Stribeck friction stops the motion."""
    t, size = readings(force, [8, 1], noise=0.01, cycles=cycles)
    level = 20 * np.log10(size)
    assert find_window(t, level).start <= 3
    late = t + 20.0
    t = np.concatenate([np.arange(0.0, 20.0, 0.17), late])
    drive = level[0] + 3.0 + 0.3 * np.random.default_rng(1).standard_normal(t.size - late.size)
    assert abs(find_window(t, np.concatenate([drive, level])).start - drive.size) <= 12


def test_a_linear_decay_that_ends_in_noise_is_not_cut():
    """Friction: the amplitude falls linearly to zero, so that only its last tenth is steep and straight in dB."""
    t = np.linspace(0.0, 1.4, 114)
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal((2, t.size)) * 10 ** (-39 / 20)
        size = np.abs(np.maximum(1 - t, 0.0) + noise[0] + 1j * noise[1])
        window = find_window(t, 20 * np.log10(size))
        assert t[window.start] < 0.1, seed
        assert 0.7 < t[window.stop - 1] < 1.0, seed


def test_an_envelope_without_readings_is_refused():
    for size, message in ((0, "there are no readings"), (20, "all readings are zero")):
        with pytest.raises(InputError, match=f"x: {message}"):
            make_record("x", np.arange(float(size)), np.zeros(size), "V")
