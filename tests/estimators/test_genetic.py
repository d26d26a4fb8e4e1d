"""The genetic search: its range, its generations, and several unknowns at once. Seeds are fixed."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import EVERYTHING, error, pendulum


def initial(signal, problem, **options):
    return run("genetic", signal, problem, options=options, stages=["initial"], seed=1)[0]


@pytest.fixture(scope="module")
def viscous():
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    return signal, problem, initial(signal, problem)


def test_it_converges_in_the_generations_that_the_paper_names(viscous):
    _, _, found = viscous
    assert found.details["generations"] <= 40
    assert error(found.values["zeta"], 0.05) < 0.01
    best, mean = found.trace["best_misfit"], found.trace["mean_misfit"]
    assert best.size == mean.size == found.trace["zeta"].size == found.details["generations"] + 1
    assert np.all(best <= mean)
    assert np.all(np.diff(best) <= 0)  # the elite is kept
    assert best[0] > 100 * best[-1]
    # Negative control: two generations of eight are no search.
    poor = initial(*viscous[:2], population=8, generations=1)
    assert error(poor.values["zeta"], 0.05) > 1.0


def test_six_unknowns():
    signal, problem = pendulum({"mu_q": 0.05}, free=EVERYTHING, samples=1000)
    found = initial(signal, problem)
    truth = {"mu_q": 0.05, "stiffness": 20.0, "gravity": 1.0, "theta0": 0.3}
    assert set(found.values) == {"mu_q", *EVERYTHING}
    for name, value in truth.items():
        assert error(found.values[name], value) < 1.0
