"""Records of a million samples are looked at in time that grows as they do."""

import numpy as np
import pytest

from bayesdamp.records.oscillation import modes
from bayesdamp.records.oscillation.modes import damped_modes, find_other_motion


def two(cycles: float, second: float, samples: int = 13) -> tuple[np.ndarray, np.ndarray]:
    """A decay at 5 Hz, and a second mode of this size at 7.3 Hz, of so many cycles."""
    t = np.linspace(0.0, cycles / 5, round(cycles * samples))
    fall = np.exp(-2.0 * t / t[-1])
    y = fall * np.cos(10 * np.pi * t) + second * np.exp(-t / t[-1]) * np.sin(14.6 * np.pi * t)
    return t, y + np.random.default_rng(4).normal(0, 0.02, t.size)


def test_a_search_by_part_of_a_long_record_finds_the_modes_that_are_in_it() -> None:
    t, y = two(4000, 0.2)
    assert t.size > 2 * modes.SEARCHED
    found = damped_modes(t, y, 2)
    assert found is not None
    assert found.frequencies == pytest.approx([5.0, 7.3], abs=1e-5)
    assert found.first == pytest.approx([1.0, 0.2], rel=0.02)
    assert found.rates * t[-1] == pytest.approx([2.0, 1.0], abs=0.1)


def test_one_decay_of_many_cycles_is_one_and_two_are_two() -> None:
    assert find_other_motion(*two(4000, 0.0), 0.2) is None
    seen = find_other_motion(*two(4000, 0.2), 0.2)
    assert seen is not None
    assert seen.kind == "two modes"
