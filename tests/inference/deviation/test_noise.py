"""κ, the noise near the frequency of the oscillation over that of all frequencies."""

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


def test_the_ratio_is_that_of_the_spectrum() -> None:
    """The mean κ of 60 records is the band's power over the whole, within Z standard errors."""
    factor, rng, t = 3.0, np.random.default_rng(7), times(40)
    ratios = np.array([inflation(t, coloured(rng, t, factor), W, 0) for _ in range(60)])
    share = 2 * 40 * (OSCILLATION_BAND[1] - OSCILLATION_BAND[0]) / t.size
    expected = factor / (1 + share * (factor - 1))
    assert abs(ratios.mean() - expected) < Z * ratios.std() / np.sqrt(60) + 0.03 * expected
    assert ratios.min() > 1.5  # control: of white noise it is 1 to 1.4


def test_the_ratio_allows_for_the_parameters_of_a_fit() -> None:
    """If directions of the band are projected out, κ is right with their number. Control: without it κ is too small."""
    rng, t = np.random.default_rng(9), times(30)
    x = W * t
    columns = np.column_stack([f(x * (1 + d / 30)) for d in range(-8, 8) for f in (np.sin, np.cos)])
    ratios = []
    for _ in range(60):
        noise = coloured(rng, t, 4.0)
        residual = noise - columns @ np.linalg.lstsq(columns, noise, rcond=None)[0]
        cases = (residual, columns.shape[1]), (residual, 0), (noise, 0)
        ratios.append([inflation(t, values, W, count) for values, count in cases])
    counted, ignored, whole = np.mean(ratios, axis=0)
    assert counted == pytest.approx(whole, rel=0.1)
    assert ignored < 0.8 * whole
