"""Evidence against quadrature, on a problem with one parameter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

import bayesdamp as bd
from tests.interface.problems import KNOWN, NOISE, TIMES, TRUTH, closed_form, fit, posterior, record

SCALE = 0.5


def by_quadrature(scale: float) -> float:
    """log ∫ prior · likelihood of the closed form over ζ."""

    def height(zeta: float) -> float:
        clean = closed_form(TIMES, {**TRUTH, "zeta": zeta})
        return float(
            np.sum(stats.norm.logpdf(record().y, clean, NOISE)) + stats.halfnorm(scale=scale).logpdf(zeta)
        )

    top = height(TRUTH["zeta"])
    area, _ = quad(lambda z: math.exp(height(z) - top), 0.045, 0.055, epsrel=1e-9, limit=200)
    return top + math.log(area)


@pytest.mark.parametrize("method", ["importance", "bridge", "laplace"])
def test_against_quadrature(method: str) -> None:
    """Within four standard errors and the solver's 0.01 nats: a false alarm in ten thousand."""
    model = bd.Model("viscous", noise="gaussian", known=KNOWN, priors={"viscous": bd.HalfNormal(SCALE)})
    one = bd.fit(record(), model)
    assert one.density.names == ("zeta",)
    found = bd.evidence(one, method)
    assert found.outcome == "ok"
    error = 0.0 if math.isnan(found.stderr) else found.stderr
    off = found.log_evidence - by_quadrature(SCALE)
    assert abs(off) < 4 * error + 0.01
    # The negative control: a prior that is a tenth wider is told apart.
    assert abs(found.log_evidence - by_quadrature(1.1 * SCALE)) > 4 * error + 0.01


def test_of_draws_and_of_a_fit() -> None:
    """Bridge sampling from NUTS draws agrees with importance sampling: five joint errors, one in a million."""
    one, other = bd.evidence(posterior(), "bridge"), bd.evidence(fit(), "importance")
    assert one.outcome == other.outcome == "ok"
    assert abs(one.log_evidence - other.log_evidence) < 5 * math.hypot(one.stderr, other.stderr)
