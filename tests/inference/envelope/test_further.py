"""Integrals over parameters of a law by adaptive importance sampling, against closed forms."""

import numpy as np
import pytest

from bayesdamp.inference.envelope.sums import importance_points


@pytest.mark.parametrize(("count", "mean", "sd"), [(1, 0.7, 0.004), (3, 0.5, 0.05)])
def test_the_integral_of_a_normal_likelihood_is_the_closed_form(count, mean, sd):
    points = importance_points(lambda z: -0.5 * sum((score - mean) ** 2 / sd**2 for score in z), count)
    v = sd**2 / (1 + sd**2)
    truth = count * (0.5 * np.log(v) - 0.5 * mean**2 / (1 + sd**2))
    assert points.log_integral == pytest.approx(truth, abs=0.1)
    drawn = points.resample(64)
    assert drawn.mean(axis=0) == pytest.approx(np.full(count, mean / (1 + sd**2)), abs=0.4 * np.sqrt(v))
    assert drawn.std(axis=0) == pytest.approx(np.full(count, np.sqrt(v)), rel=0.4)
