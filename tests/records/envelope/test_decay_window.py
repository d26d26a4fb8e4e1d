"""Where the decay is found: simulated releases and floors, and the measured records as a hand cuts them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.envelope.record import read_envelope
from bayesdamp.records.envelope.window import find_window, window_between
from bayesdamp.types import Refusal
from validation.truth.ringdowns import Ringdown, simulate
from validation.truth.turning_points import SHARP, readings

DATA = Path(__file__).resolve().parents[3] / ".." / "shared" / "data" / "ringdown"
# record, start between, stop between: s, read off the pictures by eye
BY_HAND = {
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
@pytest.mark.parametrize("name", BY_HAND)
def test_a_measured_record_is_cut_as_by_hand(name):
    (first, last), (early, late) = BY_HAND[name]
    record = read_envelope(DATA / name)
    window = find_window(record.t, record.level)
    assert first <= record.t[window.start] <= last
    assert early <= record.t[window.stop - 1] <= late
    assert window.floor is not None


@pytest.mark.parametrize("drop", [0.0, 9.0])
def test_the_release_is_found(drop):
    """Not before it by more than a hundredth of the decay, nor behind by more than a tenth."""
    for rates in ({"viscous": 0.2}, {"viscous": 0.15, "coulomb": 0.01}, {"viscous": 0.2, "quadratic": 0.3}):
        made = simulate(Ringdown(rates, drop=drop, scatter=0.02), np.random.default_rng(3))
        window = find_window(made.t, made.level)
        duration = made.t[window.stop - 1] - made.t[window.start]
        assert -0.01 * duration < made.t[window.start] - made.release < 0.1 * duration, rates
        # ends well above the floor, and not far from where it crosses 10 dB
        assert 4.0 < 20 / np.log(10) * made.x[window.stop - 1] + 45.0 < 20.0, rates


def test_levels_that_only_fall_that_saturate_at_first_and_that_do_not_fall():
    t, noise = np.linspace(0.0, 10.0, 1000), 0.01 * np.random.default_rng(1).standard_normal(1000)
    whole = find_window(t, -2.0 * t + noise)
    assert (whole.start, whole.stop, whole.floor) == (0, 1000, None)
    assert 1.9 < t[find_window(t, np.minimum(-3.0 * t, -6.0) + noise).start] < 2.6
    for rise in (0.0, 2.0):
        with pytest.raises(Refusal):
            find_window(t, rise * t + 10 * noise)


def test_bounds_that_are_given_are_kept():
    t = np.linspace(0.0, 10.0, 400)
    window = window_between(t, -2.0 * t, 2.0, 7.0)
    assert t[window.start] == pytest.approx(2.0, abs=0.03)
    assert t[window.stop - 1] == pytest.approx(7.0, abs=0.03)
    with pytest.raises(Refusal, match="only 0 readings are between"):
        window_between(t, -2.0 * t, 11.0, None)


@pytest.mark.parametrize(
    "force",
    [
        lambda x, v: 0.129 * (1 + np.exp(-((v / 1.2) ** 2))) * np.tanh(v / SHARP),
        lambda x, v: 0.15 * v**3,
        lambda x, v: 0.13 * np.tanh(v / SHARP),
    ],
    ids=["stribeck", "cubic", "coulomb"],
)
def test_a_decay_that_is_nowhere_straight_is_found_whole(force):
    """Friction that rises towards rest, the cube of the velocity. The control: a drive before it is none of it."""
    t, size = readings(force, [8, 1], noise=0.01)
    level = 20 * np.log10(size)
    assert find_window(t, level).start <= 3
    late = t + 20.0
    t = np.concatenate([np.arange(0.0, 20.0, 0.17), late])
    held = level[0] + 3.0 + 0.3 * np.random.default_rng(1).standard_normal(t.size - late.size)
    found = find_window(t, np.concatenate([held, level]))
    assert abs(found.start - held.size) <= 12


def test_friction_with_noise_at_its_end_is_found_whole():
    """A falls evenly to zero, then noise: only the last tenth falls steeply and straight in dB."""
    t = np.linspace(0.0, 1.4, 114)
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal((2, t.size)) * 10 ** (-39 / 20)
        size = np.abs(np.maximum(1 - t, 0.0) + noise[0] + 1j * noise[1])
        window = find_window(t, 20 * np.log10(size))
        assert t[window.start] < 0.1, seed
        assert 0.7 < t[window.stop - 1] < 1.0, seed
