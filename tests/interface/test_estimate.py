"""One estimator through the interface."""

from __future__ import annotations

import pytest

import bayesdamp as bd
from tests.interface.problems import MODEL, TRUTH, fit, record


def test_refined_is_the_best_fit() -> None:
    """Least squares and the mode under wide priors: one optimum, to a twentieth of an sd."""
    found = bd.estimate(record(), "koopman", MODEL)
    assert found.outcome == "ok"
    for name in TRUTH:
        assert abs(found.refined.values[name] - fit().values[name]) < 0.05 * fit().sd[name]
    assert found.initial.values["zeta"] == pytest.approx(TRUTH["zeta"], rel=0.1)
    assert found.initial.values["zeta"] != found.refined.values["zeta"]
    assert found.values == found.refined.values
    again = bd.fit(record(), MODEL, start=found.values)
    assert again.values["zeta"] == pytest.approx(fit().values["zeta"], rel=1e-4)


def test_a_method_that_cannot_says_so() -> None:
    """Topological signal processing knows single terms only."""
    found = bd.estimate(record(), "topological", bd.Model("viscous+coulomb+quadratic"))
    assert found.outcome != "ok"
    assert not found.initial.values
    with pytest.raises(bd.Refusal):
        found.plot()
