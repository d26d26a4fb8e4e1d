"""The topological method: the paper's equations as printed, the published ones, and its cutoff."""

from __future__ import annotations

import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import PAPER, error, initial, pendulum

PRINTED = {"zeta": (0.011167, 77.67), "mu_c": (0.0085, 71.7), "mu_q": (2.40, 4700.0)}


def value(damping, variant, **record):
    estimate = initial("topological", *pendulum(damping, **record), variant=variant)
    return next(iter(estimate.values.values()))


@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_as_printed_gives_what_the_printed_equations_give(damping):
    ((parameter, truth),) = damping.items()
    expected, off = PRINTED[parameter]
    found = value(damping, "as_printed")
    assert found == pytest.approx(expected, rel=0.01)
    assert error(found, truth) == pytest.approx(off, rel=0.01)
    # Negative control: the published formulae are not off like that.
    assert error(value(damping, "published"), truth) < 1.0


def test_noise_above_the_decay_is_refused():
    signal, problem = pendulum({"zeta": 0.5}, noise=0.05, samples=1000)
    for estimate in run("topological", signal, problem, seed=1):
        assert estimate.values == {}
        assert estimate.outcome != "ok"
