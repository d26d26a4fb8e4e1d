"""Records with noise: different computations, honest standard errors, poor fits called so.

Seeds are fixed. Limits are five standard deviations or more of what was to be expected, so that a new seed
would fail less than once in 10⁵.
"""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import PAPER, QUICK, error, pendulum

BOUND = {"zeta": 0.264, "mu_c": 0.538, "mu_q": 0.529}  # Cramér–Rao, per cent, 1,000 samples, all else known


@pytest.mark.parametrize("damping", PAPER[1:2], ids=lambda d: next(iter(d)))
def test_initial_values_differ_and_refined_ones_agree(damping):
    ((parameter, truth),) = damping.items()
    signal, problem = pendulum(damping, noise=0.003, samples=1000, seed=5)
    found = {name: run(name, signal, problem, seed=1) for name in QUICK}
    initial = [estimates[0].values[parameter] for estimates in found.values()]
    refined = [estimates[1].values[parameter] for estimates in found.values()]
    assert min(abs(a - b) for i, a in enumerate(initial) for b in initial[:i]) > 1e-6 * truth
    assert np.ptp(refined) < 1e-5 * truth
    assert error(refined[0], truth) < 5 * BOUND[parameter]
    # The stated standard error is the bound: its own scatter is 1/√(2n), 2.2 %.
    assert found[QUICK[0]][1].stderr[parameter] / truth * 100 == pytest.approx(BOUND[parameter], rel=0.12)


def test_least_squares_variants_are_four_honest_computations():
    found = []
    for seed in range(4):
        signal, problem = pendulum({"zeta": 0.05}, noise=0.003, samples=2000, seed=seed)
        for variant in ("ols", "wls", "irls", "tls"):
            (estimate,) = run(
                "least_squares", signal, problem, options={"variant": variant}, stages=["initial"], seed=1
            )
            found.append((estimate.values["zeta"], estimate.stderr["zeta"]))
    values, stderr = np.array(found).T
    assert np.all(np.abs(values - 0.05) < 5 * stderr)
    assert np.all(stderr < 0.01)
    assert len(set(values)) == 16


def test_another_damping_is_no_good_fit():
    signal, problem = pendulum({"mu_c": 0.06}, noise=0.003, model=("viscous",))
    (refined,) = run("least_squares", signal, problem, stages=["refined"], seed=1)
    assert "the model is incomplete" in refined.outcome
    assert refined.values["zeta"] > 0
    # Negative control: the right damping is a good fit of the same record.
    signal, problem = pendulum({"mu_c": 0.06}, noise=0.003)
    (refined,) = run("least_squares", signal, problem, stages=["refined"], seed=1)
    assert refined.outcome == "ok"


def test_a_coefficient_is_never_negative_and_its_bound_is_told():
    """Dry friction damps small motions more, drag less: beside viscous damping its drag would be negative."""
    signal, problem = pendulum({"mu_c": 0.06}, noise=0.001, samples=2000, model=("viscous", "quadratic"))
    initial, refined = run("least_squares", signal, problem, seed=1)
    assert initial.values["mu_q"] < 0.0  # the regression says so as it is
    assert refined.values["mu_q"] == 0.0
    assert "mu_q is at its bound 0" in refined.outcome
