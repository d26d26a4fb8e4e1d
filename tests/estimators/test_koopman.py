"""Koopman: eigenvalues of the generator, the lag, records with noise."""

from __future__ import annotations

import numpy as np

from bayesdamp.estimators import run
from tests.estimators.truths import damped_cosine


def initial(signal, problem, **options):
    (estimate,) = run("koopman", signal, problem, options=options, stages=["initial"], seed=1)
    return estimate


def nearest(estimate, value: complex) -> complex:
    details = estimate.details
    found = np.array(details["generator_eigenvalues_re"]) + 1j * np.array(details["generator_eigenvalues_im"])
    return found[np.argmin(np.abs(found - value))]


def test_the_generator_has_the_oscillators_eigenvalues():
    """−ζ ± i√(k − ζ²) of a linear oscillator with k = 25 and ζ = 0.08."""
    estimate = initial(*damped_cosine())
    there = -0.08 + 1j * np.sqrt(25.0 - 0.08**2)
    assert abs(nearest(estimate, there) - there) < 0.02
    # Negative control: another damping is not there.
    assert abs(nearest(estimate, -0.3 + 1j * 5.0) - (-0.3 + 1j * 5.0)) > 0.1
