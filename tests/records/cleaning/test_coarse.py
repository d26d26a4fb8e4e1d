"""A record with fewer than four samples a cycle is refused for that, with its frequency; noise is not."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.spectrum import samples_a_cycle
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError


def decay(step: float, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """60 s of 1.1 Hz, with noise of 0.4 % of 1."""
    t = np.arange(0, 60, step)
    noise = 0.004 * np.random.default_rng(3).standard_normal(t.size)
    return t, size * np.exp(-0.04 * t) * np.cos(2 * np.pi * 1.1 * t) + noise


def test_it_is_said_how_coarsely() -> None:
    said = r"sampled too coarsely: its strongest oscillation, at 1\.1 Hz, has 2\.9 samples a cycle"
    with pytest.raises(InputError, match=said):
        clean(RawRecord(*decay(0.31)), name="coarse")


def test_noise_alone_and_a_finer_record_are_not() -> None:
    with pytest.raises(InputError, match="no oscillation stands out"):
        clean(RawRecord(*decay(0.31, size=0.0)), name="noise")
    assert clean(RawRecord(*decay(0.1)), name="fine").t.size > 300
    assert samples_a_cycle(*decay(0.1)) == pytest.approx(1 / 0.11, rel=0.02)
