"""The Koopman method: eigenvalues of the generator, also of a record whose parts have different sampling intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.estimators.methods.koopman import CLEAN_RANK, decompose, observe
from bayesdamp.estimators.regression.library import candidates
from bayesdamp.estimators.shared import checked_features, motion
from tests.estimators.truths import damped_cosine


@pytest.mark.parametrize("every", [1, 3])
def test_the_generator_has_the_eigenvalues_of_the_oscillator(every: int):
    """−ζ ± i√(k − ζ²) of a linear oscillator with k = 25 and ζ = 0.08. Control: those of another damping.

    With `every` = 3 the record has a gap, after which only every third sample remains.
    """
    signal, problem = damped_cosine()
    used = (signal.t < 4.0) | ((signal.t > 5.5) & (np.arange(signal.t.size) % every == 0)) | (every == 1)
    signal = replace(signal, t=signal.t[used], y=signal.y[used])
    features = checked_features(signal)
    smoothed, library = motion(signal, problem, features), candidates(problem, features, "rad", mixed=True)
    before, after, _, _, lag = observe(signal, smoothed, problem, library, features, 0.0)
    values = np.linalg.eigvals(decompose(before, after, lag, CLEAN_RANK)[0])
    assert np.min(np.abs(values - (-0.08 + 1j * np.sqrt(25.0 - 0.08**2)))) < 0.02
    assert np.min(np.abs(values - (-0.3 + 5.0j))) > 0.1
