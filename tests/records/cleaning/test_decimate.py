"""Decimation of a record: the response of its filter against closed forms, and records that are not decimated."""

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import MOST_SAMPLES, PASS_BAND, clean, decimate, filter_and_decimate
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.record import RawRecord

RATE = 44100.0
N = 300_000
T = np.arange(N) / RATE


def decay(t: np.ndarray, frequency: float = 30.0, rate: float = 0.4) -> np.ndarray:
    return 0.2 * np.exp(-rate * t) * np.cos(2 * np.pi * frequency * t + 0.3)


@pytest.mark.parametrize("factor", [2, 7, 50])
def test_the_passband_is_unchanged_and_what_would_alias_is_removed(factor: int) -> None:
    """The response to exp(iωn) is H(ω) exp(iωn), and H must be 1. Control: above the new Nyquist frequency it is 0."""
    n = np.arange(40 * factor * 20)
    for share in (0.01, 0.4, PASS_BAND):
        omega = share * np.pi / factor
        cosine, first = filter_and_decimate(np.cos(omega * n), factor)
        sine, _ = filter_and_decimate(np.sin(omega * n), factor)
        response = (cosine + 1j * sine) * np.exp(-1j * omega * (first + factor * np.arange(cosine.size)))
        # 1e-4 because the mean of a sinusoid that is cut off is small, but not 0, and is filtered separately.
        np.testing.assert_allclose(np.abs(response), 1.0, atol=1e-4)
        np.testing.assert_allclose(np.angle(response), 0.0, atol=1e-4)
    for share in (1.0, 1.7):
        left, _ = filter_and_decimate(np.cos(share * np.pi / factor * n + 0.4), factor)
        assert np.abs(left - left.mean()).max() < 1e-4


def test_a_decimated_decay_is_the_same_decay() -> None:
    raw = decimate(RawRecord(None, decay(T), RATE))
    assert raw.y.size < MOST_SAMPLES
    assert 95 < 1 / np.median(np.diff(raw.t)) / 30.0 < 110
    np.testing.assert_allclose(raw.y, decay(raw.t), rtol=0, atol=0.2 * 1e-4)
    assert any("more than the oscillation needs" in str(note) for note in raw.provenance.notes)  # type: ignore[union-attr]
    signal = clean(RawRecord(None, decay(T), RATE), name="fork")
    assert features(signal).period == pytest.approx(1 / 30, rel=1e-4)
    assert signal.t[1] == pytest.approx(raw.t[1] - raw.t[0])
    stamped = decimate(RawRecord(np.round(T + 60.0, 6), decay(T)))
    np.testing.assert_allclose(stamped.y, decay(stamped.t - 60.0), rtol=0, atol=1e-4)


def test_decimation_reduces_white_noise_to_the_passband() -> None:
    """The variance falls to the share of the passband, which is PASS_BAND to 1 of the new Nyquist frequency.

    Four standard errors of a variance of correlated samples: false alarms below 1e-3.
    """
    noise = np.random.default_rng(3).normal(0, 1e-3, N)
    raw = decimate(RawRecord(None, decay(T) + noise, RATE))
    left = raw.y - decay(raw.t)
    factor = round((raw.t[1] - raw.t[0]) * RATE)
    slack = 4 * np.sqrt(2 / left.size / PASS_BAND)
    assert PASS_BAND / factor * (1 - slack) < np.var(left) / 1e-6 < 1 / factor * (1 + slack)


def test_some_records_are_not_decimated() -> None:
    """Records that are short or fast, times with a gap or that go back, and missing rows."""
    i = np.arange(N)
    for raw in (
        RawRecord(None, decay(T[:MOST_SAMPLES]), RATE),
        RawRecord(None, decay(T, 9000.0), RATE),
        RawRecord(np.where(T > 2, T + 1.0, T), decay(T)),
        RawRecord(np.where(T > 2, T - 1.0, T), decay(T)),
        RawRecord(T, decay(T), rows=np.where(i > 500, i + 9, i)),
    ):
        assert decimate(raw) is raw
