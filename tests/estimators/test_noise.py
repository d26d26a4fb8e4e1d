"""Records with noise: different computations, honest standard errors, poor fits called so.

Seeds are fixed. Limits are five standard deviations or more of what was to be expected, so that a new seed
would fail less than once in 10⁵.
"""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import QUICK, dry_friction, error, initial, pendulum


def test_initial_values_differ_and_refined_ones_agree():
    truth, bound = 0.03, 0.538  # Cramér–Rao, per cent, 1,000 samples, all else known
    record = pendulum({"mu_c": truth}, noise=0.003, samples=1000, seed=5)
    found = [run(name, *record, seed=1) for name in QUICK]
    first, refined = (np.sort([estimates[i].values["mu_c"] for estimates in found]) for i in (0, 1))
    assert np.min(np.diff(first)) > 1e-6 * truth
    assert np.ptp(refined) < 1e-5 * truth
    assert error(refined[0], truth) < 5 * bound
    # The stated standard error is the bound: its own scatter is 1/√(2n), 2.2 %.
    assert found[0][1].stderr["mu_c"] / truth * 100 == pytest.approx(bound, rel=0.12)


def test_least_squares_variants_are_four_honest_computations():
    found = []
    for seed in range(4):
        record = pendulum({"zeta": 0.05}, noise=0.003, samples=2000, seed=seed)
        for variant in ("ols", "wls", "irls", "tls"):
            estimate = initial("least_squares", *record, variant=variant)
            found.append((estimate.values["zeta"], estimate.stderr["zeta"]))
    values, stderr = np.array(found).T
    assert np.all(np.abs(values - 0.05) < 5 * stderr)
    assert np.all(stderr < 0.01)
    assert len(set(values)) == 16
    # Exact friction of 0.2 (ε = 0), whose force has no error: total least squares divided by zero.
    assert error(initial("least_squares", *dry_friction(), variant="tls").values["mu_c"], 0.2) < 1


def test_another_damping_is_no_good_fit():
    """Negative control: the right damping is a good fit of the same record."""
    records = (pendulum({"mu_c": 0.06}, noise=0.003, model=model) for model in (("viscous",), None))
    wrong, right = (initial("least_squares", *record, stage="refined") for record in records)
    assert "the model is incomplete" in wrong.outcome
    assert wrong.values["zeta"] > 0
    assert right.outcome == "ok"


def test_a_coefficient_is_never_negative_and_its_bound_is_told():
    """Dry friction damps small motions more, drag less: beside viscous damping its drag would be negative."""
    record = pendulum({"mu_c": 0.06}, noise=0.001, samples=2000, model=("viscous", "quadratic"))
    first, refined = run("least_squares", *record, seed=1)
    assert first.values["mu_q"] < 0.0  # the regression says so as it is
    assert refined.values["mu_q"] == 0.0
    assert "the best fit has mu_q = 0, its lower bound" in refined.outcome
