"""Wrapped angles are recognised; rectangular, coarse and noisy signals give no false alarm in 100 of each kind."""

from collections.abc import Callable
from itertools import product

import numpy as np

from bayesdamp.records.record import count_jumps

T = np.arange(1000) / 50
SWING = np.exp(-0.1 * T) * np.cos(6 * T)


def test_the_jumps_of_a_wrapped_swing_are_counted() -> None:
    cases = product((360.0, 2 * np.pi), (0.0, -0.5), (0.0, 0.003), (0.02, 0.05, 0.45))
    for turn, begin, noise, size in cases:
        y = size * SWING + noise * np.random.default_rng(5).standard_normal(T.size) - begin
        wrapped = turn * ((y - begin) % 1.0 + begin)
        crossings = int(np.sum(np.abs(np.diff(wrapped)) > turn / 2))
        assert count_jumps(wrapped, turn) == crossings > 3, (turn, begin, noise, size)
        assert count_jumps(turn * y, turn) == 0, (turn, begin, noise, size)


def test_the_jumps_of_a_wheel_that_slows_down_are_counted() -> None:
    assert count_jumps((30 * T - T**2) * 10 % 360, 360.0) == 7
    assert count_jumps((30 * T - T**2) * 10, 360.0) == 0


OTHERS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "noise": lambda rng: rng.uniform(0, 360, T.size),
    "a noisy swing": lambda rng: np.clip(180 * SWING + 40 * rng.standard_normal(T.size), -180, 180),
    "a rectangle": lambda rng: 360.0 * (np.sin(rng.uniform(2, 20) * T) > 0),
    "a rectangle of another height": lambda rng: rng.uniform(330, 390) * (np.sin(9 * T) > 0) + 0.5 * np.sin(5 * T),
    "a rectangle within a turn": lambda rng: 359.0 * (np.sin(9 * T) > 0) + rng.uniform(0, 1, T.size),
    "two turns of a wheel": lambda rng: (rng.uniform(0, 0.2) + 0.1 * T) * 360 % 360,
    "coarse, of many levels": lambda rng: 36 * np.round(10 * rng.uniform(0.4, 1.0) * SWING),
    "spikes": lambda rng: SWING + 360 * (rng.uniform(size=T.size) < 0.01),
}  # fmt: skip


def test_no_other_signal_is_taken_for_a_wrapped_angle() -> None:
    for kind, make in OTHERS.items():
        signals = [make(np.random.default_rng(seed)) for seed in range(100)]
        assert not any(count_jumps(y, 360.0) for y in signals), kind
