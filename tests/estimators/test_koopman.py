"""The Koopman method: eigenvalues of the generator."""

import numpy as np

from bayesdamp.estimators.methods.koopman import CLEAN_RANK, decompose, observe
from bayesdamp.estimators.regression import candidates
from bayesdamp.estimators.shared import checked_features, motion
from tests.estimators.truths import damped_cosine


def test_the_generator_has_the_eigenvalues_of_the_oscillator():
    """−ζ ± i√(k − ζ²) of a linear oscillator with k = 25 and ζ = 0.08. Control: those of another damping."""
    signal, problem = damped_cosine()
    features = checked_features(signal)
    smoothed, library = motion(signal, problem, features), candidates(problem, features, "rad", mixed=True)
    before, after, _, _, lag = observe(signal, smoothed, problem, library, features, 0.0)
    values = np.linalg.eigvals(decompose(before, after, lag, CLEAN_RANK)[0])
    assert np.min(np.abs(values - (-0.08 + 1j * np.sqrt(25.0 - 0.08**2)))) < 0.02
    assert np.min(np.abs(values - (-0.3 + 5.0j))) > 0.1
