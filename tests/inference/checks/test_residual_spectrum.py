"""What stands out of white noise: calibrated where nothing does, named where something does."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference import residual_tests
from bayesdamp.inference.residual_tests import find_spectral_line

T = np.arange(300) * 0.02
PERIOD = 0.5
PHASE = 2 * np.pi * T / PERIOD
TANGENTS = np.array([np.cos(PHASE), np.sin(PHASE), T * np.cos(PHASE), T * np.sin(PHASE), np.ones(T.size)])
ABSORBED = residual_tests.orthonormal(TANGENTS.T)


def fitted(values: np.ndarray) -> np.ndarray:
    """What a least-squares fit by the tangents leaves, in units of its own noise."""
    q = np.linalg.qr(TANGENTS.T)[0]
    left = values - q @ (q.T @ values)
    return left / np.sqrt(np.sum(left**2) / (T.size - len(TANGENTS)))


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(T.size)


def test_chances_are_those_of_white_noise() -> None:
    """1,000 series of noise after a fit, seeds fixed. Bonferroni's bound over four parts: at or below the nominal
    share, by at most three binomial standard deviations above it (two tests: 0.3 %), and not empty at a fifth."""
    noises = (fitted(white(seed)) for seed in range(1000))
    chances = np.array([find_spectral_line(T, noise, PERIOD, ABSORBED).chance for noise in noises])
    for share in (0.01, 0.05):
        assert np.mean(chances < share) <= share + 3 * np.sqrt(share * (1 - share) / chances.size)
    assert np.mean(chances < 0.2) > 0.1


def test_what_is_left_is_named() -> None:
    """Each alone against the same noise; the noise alone has none of them."""
    for added, words in (
        (T**2 * np.cos(PHASE) / 4, residual_tests.AT_OSCILLATION),
        (0.5 * np.cos(2 * PHASE + 1), residual_tests.AT_OVERTONES),
        (1.5 * T / T[-1], residual_tests.SLOW_STRUCTURE),
        (0.8 * np.sin(2 * np.pi * T / 0.142), residual_tests.OTHER_OSCILLATION.format(ratio=3.5)),
    ):
        result = find_spectral_line(T, fitted(white(1) + added), PERIOD, ABSORBED)
        assert (result.chance < 1e-3, result.words) == (True, words)
    assert find_spectral_line(T, fitted(white(1)), PERIOD, ABSORBED).chance > 0.05


def test_what_a_fit_absorbs_does_not_count() -> None:
    """Counted among the waves all the same, the little that is left would hide (the negative control)."""
    left, none = fitted(white(2) + 0.15 * T**2 * np.cos(PHASE)), np.empty((T.size, 0))
    right, control = (find_spectral_line(T, left, PERIOD, absorbed).chance for absorbed in (ABSORBED, none))
    assert right < control
