"""Thinning a record: amplitude and phase against closed forms, what is kept and what is taken out."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import MOST_SAMPLES, PASS_BAND, clean, decimate, filter_and_decimate
from bayesdamp.records.record import RawRecord

RATE = 44100.0
N = 300_000
T = np.arange(N) / RATE


def decay(t: np.ndarray, frequency: float = 30.0, rate: float = 0.4) -> np.ndarray:
    return 0.2 * np.exp(-rate * t) * np.cos(2 * np.pi * frequency * t + 0.3)


@pytest.mark.parametrize("factor", [2, 7, 50])
def test_the_passband_and_what_would_fold_down(factor: int) -> None:
    """exp(iωn) passes a filter of real taps as H(ω) exp(iωn), with H real and near 1 where no phase shifts. The
    negative control: beyond the new Nyquist frequency nothing passes."""
    n = np.arange(40 * factor * 20)
    for share in (0.01, 0.4, PASS_BAND):
        omega = share * np.pi / factor
        cosine, first = filter_and_decimate(np.cos(omega * n), factor)
        sine, _ = filter_and_decimate(np.sin(omega * n), factor)
        response = (cosine + 1j * sine) * np.exp(-1j * omega * (first + factor * np.arange(cosine.size)))
        # The mean that is set aside is a constant within the passband; of a cut sinusoid it is small, not nothing.
        np.testing.assert_allclose(np.abs(response), 1.0, atol=1e-4)
        np.testing.assert_allclose(np.angle(response), 0.0, atol=1e-4)
    for share in (1.0, 1.7):
        left, _ = filter_and_decimate(np.cos(share * np.pi / factor * n + 0.4), factor)
        assert np.abs(left - left.mean()).max() < 1e-4


def test_a_decay_is_the_same_decay_with_fewer_samples() -> None:
    raw = decimate(RawRecord(None, decay(T), RATE))
    assert raw.t is not None
    assert raw.y.size < MOST_SAMPLES
    assert 95 < 1 / np.median(np.diff(raw.t)) / 30.0 < 110
    # exp(-st) is real in ω - is instead of ω: the same response a little beside the real axis.
    np.testing.assert_allclose(raw.y, decay(raw.t), rtol=0, atol=0.2 * 1e-4)
    assert any("more than the oscillation needs" in str(note) for note in raw.provenance.notes)  # type: ignore[union-attr]
    signal = clean(raw, name="fork")
    assert signal.provenance.more["period"] == pytest.approx(1 / 30, rel=1e-4)


def test_white_noise_is_what_is_left_in_the_band() -> None:
    """White noise of variance σ² keeps σ² times the share of the band: between PASS_BAND and 1 of the new Nyquist
    one."""
    noise = np.random.default_rng(3).normal(0, 1e-3, N)
    raw = decimate(RawRecord(None, decay(T) + noise, RATE))
    assert raw.t is not None
    left = raw.y - decay(raw.t)
    factor = raw.provenance.more["decimation"]
    # ± 4 standard errors of a variance of correlated samples; false alarms below 1e-3.
    slack = 4 * np.sqrt(2 / left.size / PASS_BAND)
    assert PASS_BAND / factor * (1 - slack) < np.var(left) / 1e-6 < 1 / factor * (1 + slack)


def test_the_files_own_times_are_kept() -> None:
    stamps = np.round(T + 60.0, 6)
    raw = decimate(RawRecord(stamps, decay(T)))
    np.testing.assert_allclose(raw.y, decay(raw.t - 60.0), rtol=0, atol=1e-4)


def test_what_need_not_or_cannot_be_thinned_stays() -> None:
    short = RawRecord(None, decay(T[:MOST_SAMPLES]), RATE)
    assert decimate(short) is short
    gap = RawRecord(np.where(T > 2, T + 1.0, T), decay(T))
    assert decimate(gap) is gap
    back = RawRecord(np.where(T > 2, T - 1.0, T), decay(T))
    assert decimate(back) is back
    fast = RawRecord(None, decay(T, 9000.0), RATE)
    assert decimate(fast) is fast
    rows = RawRecord(T, decay(T), rows=np.where(np.arange(N) > 500, np.arange(N) + 9, np.arange(N)))
    assert decimate(rows) is rows
