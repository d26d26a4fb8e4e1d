"""What is mended, and said, or refused with what to do: wrapped angles, lost signs, peaks that are cut off."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.law_free import first_words
from bayesdamp.records.record import RawRecord, unwrap
from bayesdamp.types import InputError

T = np.arange(1000) / 50
Y = np.exp(-0.06 * T) * np.cos(2 * np.pi * T)
NOISE = 0.003 * np.random.default_rng(1).standard_normal(T.size)


def test_a_wrapped_angle_is_unwrapped_and_that_is_said() -> None:
    for unit, turn in (("rad", 2 * np.pi), ("deg", 360.0)):
        angle = (Y + NOISE) * turn / (2 * np.pi)
        signal = clean(unwrap(RawRecord(T, angle % turn), unit, "angle"), name="x", unit=unit)
        assert first_words(signal).frequency == pytest.approx(1.0, rel=1e-3)
        assert any("is unwrap" in note for note in signal.provenance.notes)
        plain = RawRecord(T, angle)
        assert unwrap(plain, unit, "angle") is plain


LOST = {
    "rectified": np.abs(Y + NOISE),
    "rectified, negative": -np.abs(Y + NOISE),
    "squared": Y**2,
    "rectified, and noise after that": np.abs(Y) + 5 * NOISE,
    "kinetic energy": np.gradient(Y, T) ** 2 + NOISE,
}


@pytest.mark.parametrize("what", LOST)
def test_a_lost_sign_is_refused(what: str) -> None:
    """Negative control: what is above zero, or rounded, only resembles it."""
    with pytest.raises(InputError, match="rectified or squared; record it with its sign"):
        clean(RawRecord(T, LOST[what]), name="x")
    for y in (Y - Y.min() + NOISE, np.round(10 * (Y + NOISE)) / 10):
        assert clean(RawRecord(T, y), name="x").t.size > 500


def test_peaks_that_are_cut_off_are_refused_with_the_time_from_which_on_they_are_not() -> None:
    with pytest.raises(InputError, match=r"peaks are cut off.* give a start after 8\.\d+ s"):
        clean(RawRecord(T, np.minimum(Y + NOISE, 0.6)), name="x")
    kept = clean(RawRecord(T, np.minimum(Y + NOISE, 0.6)), name="x", start=9.0)
    assert first_words(kept).damping[1].ratio == pytest.approx(0.06 / (2 * np.pi), rel=0.02)
