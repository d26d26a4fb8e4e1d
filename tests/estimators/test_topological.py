"""The topological method: the equations as printed in the paper, the published ones, and its noise limit."""

import pytest

from bayesdamp.estimators import run
from tests.estimators.truths import PAPER, error, initial, pendulum

PRINTED = {"zeta": 0.011167, "mu_c": 0.0085, "mu_q": 2.40}


def value(damping, variant, **record):
    estimate = initial("topological", *pendulum(damping, **record), variant=variant)
    return next(iter(estimate.values.values()))


@pytest.mark.parametrize("quantity", ["angle", "velocity", "acceleration"])
@pytest.mark.parametrize("damping", PAPER, ids=lambda d: next(iter(d)))
def test_the_variant_as_printed_gives_the_values_of_the_printed_equations(damping, quantity):
    """Control: the published equations are right to 1 %."""
    ((parameter, truth),) = damping.items()
    assert value(damping, "as_printed", quantity=quantity) == pytest.approx(PRINTED[parameter], rel=0.01)
    assert error(value(damping, "published", quantity=quantity), truth) < 1.0


def test_a_decay_below_the_noise_is_refused():
    signal, problem = pendulum({"zeta": 0.5}, noise=0.05, samples=1000)
    for estimate in run("topological", signal, problem, seed=1):
        assert estimate.values == {}
        assert estimate.outcome != "ok"
