"""Wrapped angles are unwrapped with a note; lost signs and clipped peaks are refused with what to do."""

import numpy as np
import pytest

from bayesdamp.interface.first_words import first_words
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.record import RawRecord, unwrap
from bayesdamp.types import InputError

T = np.arange(1000) / 50
Y = np.exp(-0.06 * T) * np.cos(2 * np.pi * T)
NOISE = 0.003 * np.random.default_rng(1).standard_normal(T.size)


def test_a_wrapped_angle_is_unwrapped_with_a_note() -> None:
    for unit, turn in (("rad", 2 * np.pi), ("deg", 360.0)):
        angle = (Y + NOISE) * turn / (2 * np.pi)
        signal = clean(RawRecord(T, angle % turn), name="x", unit=unit)
        assert first_words(signal).frequency[1] == pytest.approx(1.0, rel=1e-3)
        assert any("The angle was wrapped" in note for note in signal.provenance.notes)
        plain = RawRecord(T, angle)
        assert unwrap(plain, unit, "angle") is plain


LOST = {
    "rectified": np.abs(Y + NOISE),
    "rectified, negative": -np.abs(Y + NOISE),
    "squared": Y**2,
    "rectified, then noise": np.abs(Y) + 5 * NOISE,
    "kinetic energy": np.gradient(Y, T) ** 2 + NOISE,
}


@pytest.mark.parametrize("case", LOST)
def test_a_lost_sign_is_refused(case: str) -> None:
    """Negative control: records that lie above zero or are rounded."""
    with pytest.raises(InputError, match="rectified or squared; record it with its sign"):
        clean(RawRecord(T, LOST[case]), name="x")
    settling = Y - np.exp(-0.09 * T) + NOISE  # a release from a step, through a high-pass filter
    for y in (Y - Y.min() + NOISE, np.round(10 * (Y + NOISE)) / 10, settling):
        assert clean(RawRecord(T, y), name="x").t.size > 500


def test_the_refusal_of_clipped_peaks_gives_the_time_of_the_last() -> None:
    raw = RawRecord(T, np.minimum(Y + NOISE, 0.6))
    with pytest.raises(InputError, match=r"peaks are cut off.* give a start after 8\.\d+ s"):
        clean(raw, name="x")
    later = first_words(clean(raw, name="x", start=9.0))
    assert later.ratio[1] == pytest.approx(0.06 / (2 * np.pi), rel=0.02)
