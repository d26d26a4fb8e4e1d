"""The evidence under wider and narrower priors, against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.evidence.importance import Importance
from bayesdamp.inference.sensitivity import evidence_by_prior_width, under_priors
from bayesdamp.priors import HalfNormal
from tests.inference.evidence.weighing_problems import LIMIT, PRIORS, posterior_grid, problem

TWO = "two touching"


def under_width(factor: float) -> float:
    """Return the log evidence by quadrature with both half-normal priors wider by this factor."""
    axes, logs = posterior_grid(TWO, 56)
    for i, (name, axis) in enumerate(zip(("zeta", "mu_c"), axes)):
        other = HalfNormal(scale=factor * PRIORS[name].scale)
        along = np.asarray(other.log_density(axis)) - np.asarray(PRIORS[name].log_density(axis))
        logs = logs + along.reshape((-1, 1) if i == 0 else (1, -1))
    return float(logsumexp(logs))


def test_evidence_under_wider_and_narrower_priors_is_that_of_quadrature():
    """Within five standard errors (false alarm 1e-5). Negative control: prior densities without their constants would
    miss the log of the factor for each coefficient."""
    target, mode = problem(TWO)
    evidence = Importance().evidence("m", target, mode, 1)
    y, log_weights = evidence.arrays["y"], evidence.arrays["log_weights"]
    widths = evidence_by_prior_width(
        target.priors, ("zeta", "mu_c"), y, log_weights, lambda priors: under_priors(mode, priors), 1
    )
    exact = np.array([under_width(f) for f in widths.factors])
    assert widths.varied == ("zeta", "mu_c")
    assert widths.factors[0] == pytest.approx(0.1)
    assert widths.factors[-1] == pytest.approx(10.0)
    assert np.all(widths.trusted)
    assert not np.any(widths.anew[widths.factors >= 1.0])
    off = np.abs(widths.log_evidence - exact)
    assert np.all(off < 5 * widths.stderr + 2e-3)
    assert np.all(off[~widths.anew] < LIMIT)
    flat = widths.log_evidence + 2 * np.log(widths.factors)
    assert np.all(np.abs(flat - exact)[np.abs(np.log(widths.factors)) > 0.1] > LIMIT)
