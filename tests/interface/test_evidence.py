"""Evidence against quadrature, for a model with one parameter."""

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
    """Return log ∫ prior · likelihood of the closed form over ζ."""

    def log_posterior(zeta: float) -> float:
        motion = closed_form(TIMES, {**TRUTH, "zeta": zeta})
        return np.sum(stats.norm.logpdf(record().y, motion, NOISE)) + stats.halfnorm(scale=scale).logpdf(zeta)

    top = log_posterior(TRUTH["zeta"])
    area, _ = quad(lambda z: math.exp(log_posterior(z) - top), 0.045, 0.055, epsrel=1e-9, limit=200)
    return top + math.log(area)


@pytest.mark.parametrize("method", ["importance", "bridge", "laplace"])
def test_evidence_is_that_of_quadrature(method: str) -> None:
    """Within four standard errors and the solver's 0.01 nats: one false alarm in ten thousand seeds. Control: a prior
    that is a tenth wider."""
    model = bd.Model("viscous", noise="gaussian", known=KNOWN, priors={"viscous": bd.HalfNormal(SCALE)})
    single = bd.fit(record(), model)
    assert single.density.names == ("zeta",)
    evidence = bd.evidence(single, method)
    assert evidence.outcome == "ok"
    error = 0.0 if math.isnan(evidence.stderr) else evidence.stderr
    assert abs(evidence.log_evidence - by_quadrature(SCALE)) < 4 * error + 0.01
    assert abs(evidence.log_evidence - by_quadrature(1.1 * SCALE)) > 4 * error + 0.01


def test_evidence_from_draws_is_that_from_a_fit() -> None:
    """Bridge sampling from NUTS draws agrees with importance sampling within five joint errors: one false alarm in a
    million seeds."""
    bridge, importance = bd.evidence(posterior(), "bridge"), bd.evidence(fit(), "importance")
    assert bridge.outcome == importance.outcome == "ok"
    assert abs(bridge.log_evidence - importance.log_evidence) < 5 * math.hypot(
        bridge.stderr, importance.stderr
    )
