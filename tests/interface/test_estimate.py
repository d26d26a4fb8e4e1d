"""Estimates from Python."""

import pytest

import bayesdamp as bd
from tests.interface.problems import MODEL, TRUTH, fit, record


def test_a_refined_estimate_is_the_best_fit() -> None:
    """Least squares and the mode under wide priors agree to a twentieth of an sd."""
    estimate = bd.estimate(record(), "koopman", MODEL)
    assert estimate.outcome == "ok"
    for name in TRUTH:
        assert abs(estimate.refined.values[name] - fit().values[name]) < 0.05 * fit().sd[name]
    assert estimate.initial.values["zeta"] == pytest.approx(TRUTH["zeta"], rel=0.1)
    assert estimate.initial.values["zeta"] != estimate.refined.values["zeta"]
    assert estimate.values == estimate.refined.values
    for stage in (estimate.initial, estimate.refined):
        columns = [estimate.summary()[f"{what}_{stage.stage}"].dropna() for what in ("value", "stderr")]
        assert [dict(column) for column in columns] == [stage.values, stage.stderr]
    started = bd.fit(record(), MODEL, start=estimate.values)
    assert started.values["zeta"] == pytest.approx(fit().values["zeta"], rel=1e-4)


def test_an_estimator_that_does_not_support_a_model_has_no_values() -> None:
    """Topological signal processing supports single terms only."""
    estimate = bd.estimate(record(), "topological", bd.Model("viscous+coulomb+quadratic"))
    assert "not a sum of terms" in estimate.outcome
