"""κ, the noise near the oscillation over that of all frequencies, on noise that is made to be so."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.deviation.sample_noise import OSCILLATION_BAND, inflation

W, PER_CYCLE = 5.0, 40
Z = 4.3
"""Standard deviations that a normal exceeds with a probability of 1e-5: the false-alarm rate of each comparison."""


def times(cycles: int) -> np.ndarray:
    return np.arange(cycles * PER_CYCLE) * 2 * np.pi / W / PER_CYCLE


def coloured(rng: np.random.Generator, t: np.ndarray, factor: float) -> np.ndarray:
    """Return normal noise whose power near the oscillation is `factor` times that of the rest."""
    n = t.size
    omega = 2 * np.pi * np.fft.rfftfreq(n, t[1] - t[0])
    inside = (omega > OSCILLATION_BAND[0] * W) & (omega < OSCILLATION_BAND[1] * W)
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * np.where(inside, np.sqrt(factor), 1.0), n)


def test_a_louder_band_is_seen() -> None:
    """The mean κ of 60 records is the band's power over the whole, within Z standard errors."""
    factor, rng, t = 3.0, np.random.default_rng(7), times(40)
    found = np.array([inflation(t, coloured(rng, t, factor), W, 0) for _ in range(60)])
    share = 2 * 40 * (OSCILLATION_BAND[1] - OSCILLATION_BAND[0]) / t.size
    expected = factor / (1 + share * (factor - 1))
    assert abs(found.mean() - expected) < Z * found.std() / np.sqrt(60) + 0.03 * expected
    assert found.min() > 1.5  # control: of white noise it is 1 to 1.4


def test_what_a_fit_took_is_given_back() -> None:
    """With directions of the band projected out of noise, κ is right with their count, and too small without."""
    rng, t = np.random.default_rng(9), times(30)
    x = W * t
    columns = np.column_stack([f(x * (1 + d / 30)) for d in range(-8, 8) for f in (np.sin, np.cos)])
    found = []
    for _ in range(60):
        noise = coloured(rng, t, 4.0)
        left = noise - columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
        cases = (left, columns.shape[1]), (left, 0), (noise, 0)
        found.append([inflation(t, values, W, taken) for values, taken in cases])
    given, ignored, whole = np.mean(found, axis=0)
    assert given == pytest.approx(whole, rel=0.1)
    assert ignored < 0.8 * whole
