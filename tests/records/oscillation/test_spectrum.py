"""The period of long records, in which it is searched on averages over blocks of samples."""

import numpy as np
import pytest

from bayesdamp.records.oscillation.noise import coarse_period, samples_a_cycle


def record(rows: int, cycles: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a decaying oscillation of period 1 s."""
    t = np.linspace(0.0, cycles, rows)
    y = np.exp(-3.0 * t / cycles) * np.cos(2 * np.pi * t)
    return t, y + noise * np.random.default_rng(rows).standard_normal(rows)


@pytest.mark.parametrize(
    ("rows", "cycles"),
    [
        (1_000_000, 30_000),  # a block contains 1.9 periods: its averages have an alias at 13 s
        (219_000, 13_846),  # 0.89 periods, alias at 8 s
        (308_000, 4_559),  # a quarter of a period, which averages reduce
    ],
)
def test_a_period_about_as_long_as_a_block_is_found(rows: int, cycles: float) -> None:
    period, share = coarse_period(*record(rows, cycles, 0.005))
    assert period == pytest.approx(1.0, rel=0.03)
    assert share > 0.9


def test_a_slow_period_in_noise_is_found_in_the_averages() -> None:
    """A part of the samples without averaging contains only five cycles of it."""
    period, share = coarse_period(*record(553_000, 170, 1.0))
    assert period == pytest.approx(1.0, rel=0.03)
    assert share > 0.5


def test_samples_per_cycle_are_counted_in_the_record_not_in_averages() -> None:
    """32 samples per cycle, in a record that is searched in blocks of ten."""
    assert samples_a_cycle(*record(160_000, 5_000, 0.1)) == pytest.approx(32, rel=0.01)
