"""The test for a line in the spectrum of the residuals: false alarms for white noise, and names of structures."""

import numpy as np

from bayesdamp.inference import checks
from bayesdamp.inference.checks import find_spectral_line

T = np.arange(300) * 0.02
PERIOD = 0.5
PHASE = 2 * np.pi * T / PERIOD
TANGENTS = np.array([np.cos(PHASE), np.sin(PHASE), T * np.cos(PHASE), T * np.sin(PHASE), np.ones(T.size)])
ABSORBED = checks.orthonormal(TANGENTS.T)


def fitted(values: np.ndarray) -> np.ndarray:
    """Return the residuals of a least-squares fit by the tangents, in units of their sd."""
    q = np.linalg.qr(TANGENTS.T)[0]
    residuals = values - q @ (q.T @ values)
    return residuals / np.sqrt(np.sum(residuals**2) / (T.size - len(TANGENTS)))


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(T.size)


def test_p_values_of_white_noise_are_at_most_as_small_as_stated() -> None:
    """For 1,000 series after a fit. By Bonferroni's bound over four parts the shares are the nominal ones or smaller,
    within three binomial standard deviations (two tests: false alarm 0.3 %), and not zero."""
    noises = (fitted(white(seed)) for seed in range(1000))
    chances = np.array([find_spectral_line(T, noise, PERIOD, ABSORBED).chance for noise in noises])
    for share in (0.01, 0.05):
        assert np.mean(chances < share) <= share + 3 * np.sqrt(share * (1 - share) / chances.size)
    assert np.mean(chances < 0.2) > 0.1


def test_each_structure_in_the_residuals_is_named() -> None:
    """Added to the same noise, one at a time. Control: the noise alone has no structure."""
    for added, words in (
        (T**2 * np.cos(PHASE) / 4, checks.AT_OSCILLATION),
        (0.5 * np.cos(2 * PHASE + 1), checks.AT_OVERTONES),
        (1.5 * T / T[-1], checks.SLOW_STRUCTURE),
        (0.8 * np.sin(2 * np.pi * T / 0.142), checks.OTHER_OSCILLATION.format(ratio=3.5)),
    ):
        result = find_spectral_line(T, fitted(white(1) + added), PERIOD, ABSORBED)
        assert (result.chance < 1e-3, result.words) == (True, words)
    assert find_spectral_line(T, fitted(white(1)), PERIOD, ABSORBED).chance > 0.05


def test_the_p_value_allows_for_what_the_fit_absorbs() -> None:
    """Control: without this the p value is larger, and the structure less significant."""
    residuals, none = fitted(white(2) + 0.15 * T**2 * np.cos(PHASE)), np.empty((T.size, 0))
    lines = [find_spectral_line(T, residuals, PERIOD, absorbed) for absorbed in (ABSORBED, none)]
    assert lines[0].chance < lines[1].chance
