"""Records with noise: methods differ, their trajectory fits agree, and poor fits are recognised.

Seeds are fixed. Limits are five or more standard deviations, so that fewer than one seed in 10⁵ would fail by chance.
"""

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import QUICK, dry_friction, error, initial, pendulum


def test_initial_values_differ_and_refined_ones_agree():
    truth, bound = 0.03, 0.538  # Cramér–Rao, per cent, 1,000 samples, all else known
    record = pendulum({"mu_c": truth}, noise=0.003, samples=1000, seed=5)
    estimates = [run(name, *record, seed=1) for name in QUICK]
    first, refined = (np.sort([pair[i].values["mu_c"] for pair in estimates]) for i in (0, 1))
    assert np.min(np.diff(first)) > 1e-6 * truth
    assert np.ptp(refined) < 1e-5 * truth
    assert error(refined[0], truth) < 5 * bound
    # The standard error is the bound; it scatters by 1/√(2n), 2.2 %.
    assert estimates[0][1].stderr["mu_c"] / truth * 100 == pytest.approx(bound, rel=0.12)


def test_variants_of_least_squares_differ():
    """Their standard deviation for this noise is 1.2 % at most.

    Exact friction of 0.2 (ε = 0), whose force has no error, once made total least squares divide by zero.
    """
    record = pendulum({"zeta": 0.05}, noise=0.003, samples=2000)
    variants = ("ols", "wls", "irls", "tls")
    values = [initial("least_squares", *record, variant=variant).values["zeta"] for variant in variants]
    assert np.all(np.abs(np.array(values) / 0.05 - 1) < 0.06)
    assert len(set(values)) == 4
    assert error(initial("least_squares", *dry_friction(), variant="tls").values["mu_c"], 0.2) < 1


def test_a_wrong_damping_is_a_poor_fit():
    """Negative control: the right damping is a good fit of the same record."""
    records = (pendulum({"mu_c": 0.06}, noise=0.003, model=model) for model in (("viscous",), None))
    wrong, right = (initial("least_squares", *record, stage="refined") for record in records)
    assert "the model is incomplete" in wrong.outcome
    assert wrong.values["zeta"] > 0
    assert right.outcome == "ok"


def test_a_refined_coefficient_is_not_negative_and_the_outcome_names_its_bound():
    """Dry friction with a model of viscous damping and drag: the best drag would be negative."""
    record = pendulum({"mu_c": 0.06}, noise=0.001, samples=2000, model=("viscous", "quadratic"))
    first, refined = run("least_squares", *record, seed=1)
    assert first.values["mu_q"] < 0.0  # a regression without bounds
    assert refined.values["mu_q"] == 0.0
    assert "the best fit has mu_q = 0, which is the lower bound" in refined.outcome
