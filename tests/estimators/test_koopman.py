"""Koopman: eigenvalues of the generator, the lag, records with noise."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import PAPER, damped_cosine, error, pendulum


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


@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_papers_pendulum_clean_and_noisy(damping):
    ((parameter, truth),) = damping.items()
    assert error(initial(*pendulum(damping)).values[parameter], truth) < 0.05
    estimate = initial(*pendulum(damping, noise=0.003, samples=1000, seed=3))
    assert error(estimate.values[parameter], truth) < 7.0  # five standard deviations
    assert estimate.details["rank"] < len(estimate.details["dictionary"])


def test_the_lag_is_an_option():
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    short, long = (initial(signal, problem, lag=lag) for lag in (0.01, 0.04))
    assert long.details["lag"] > 3 * short.details["lag"]
    assert error(long.values["zeta"], 0.05) < 1.0
