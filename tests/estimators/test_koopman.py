"""Koopman: eigenvalues of the generator."""

from __future__ import annotations

import numpy as np

from tests.estimators.truths import damped_cosine, initial


def test_the_generator_has_the_oscillators_eigenvalues():
    """−ζ ± i√(k − ζ²) of a linear oscillator with k = 25 and ζ = 0.08. Control: those of another damping."""
    details = initial("koopman", *damped_cosine()).details
    values = np.array(details["generator_eigenvalues_re"]) + 1j * np.array(
        details["generator_eigenvalues_im"]
    )
    assert np.min(np.abs(values - (-0.08 + 1j * np.sqrt(25.0 - 0.08**2)))) < 0.02
    assert np.min(np.abs(values - (-0.3 + 5.0j))) > 0.1
