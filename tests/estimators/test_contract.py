"""The contract of every estimator, also of those that are added later."""

import dataclasses

import numpy as np
import pytest

from bayesdamp.estimators import ESTIMATORS, Estimator, Options, names_for_all, run
from bayesdamp.types import Estimate, InputError, Problem, Provenance, Refusal, Signal, System
from tests.estimators.truths import SHORT, damped_cosine, pendulum

NAMES = names_for_all()


@pytest.fixture(scope="module")
def noisy():
    return pendulum({"zeta": 0.05}, noise=0.003, samples=1000, free=("stiffness",))


@pytest.mark.parametrize("name", NAMES)
def test_an_estimate_depends_only_on_the_record_the_known_values_and_the_seed(name, noisy):
    """Name and provenance of a record, which could contain the truth, and global random numbers change nothing.

    Control: another record gives another value.
    """
    signal, problem = noisy
    first = run(name, signal, problem, options=SHORT.get(name), seed=[7, 1])
    marked = dataclasses.replace(signal, name="zeta=9", provenance=Provenance(facts={"zeta": 9.0}))
    np.random.seed(99)
    before = np.random.get_state()[1].copy()  # pyright: ignore
    again = run(name, marked, problem, options=SHORT.get(name), seed=[7, 1])
    assert np.array_equal(np.random.get_state()[1], before)  # pyright: ignore
    for a, b in zip(first, again, strict=True):
        assert (a.values, a.stderr, a.details, a.outcome) == (b.values, b.stderr, b.details, b.outcome)
    other = pendulum({"zeta": 0.05}, noise=0.003, samples=1000, free=("stiffness",), seed=9)
    (changed,) = run(name, *other, options=SHORT.get(name), stages=["initial"], seed=[7, 1])
    assert changed.values != again[0].values
    for estimate, stage in zip(first, ("initial", "refined"), strict=True):
        assert (estimate.estimator, estimate.stage) == (name, stage)
        assert {"zeta"} <= set(estimate.values) <= {"zeta", "stiffness"}
        assert all(type(v) is float and np.isfinite(v) for v in estimate.values.values())
        assert set(estimate.stderr) <= set(estimate.values)
        assert all(np.isfinite(v) and v >= 0 for v in estimate.stderr.values())
        assert min(estimate.seconds, estimate.evaluations) > 0
    # Five times the Cramér–Rao bound, also after a short training of a network.
    assert first[1].values["zeta"] == pytest.approx(0.05, rel=0.024)
    assert first[1].outcome == "ok"


IMPOSSIBLE = {
    "constant": np.zeros(500),
    "ramp": np.linspace(0.3, 0.0, 500),
    "three samples a period": np.cos(2 * np.pi * np.linspace(0, 160, 500)),
    "noise": np.random.default_rng(0).normal(size=500),
    "three samples": np.array([0.3, 0.1, -0.2]),
}


@pytest.mark.parametrize("kind", IMPOSSIBLE)
def test_every_estimator_refuses_an_impossible_record_in_a_sentence(kind):
    y = IMPOSSIBLE[kind]
    signal = Signal(np.linspace(0.0, 10.0, y.size), y)
    problem = pendulum({"zeta": 0.05}, samples=10)[1]
    for name in NAMES:
        for estimate in run(name, signal, problem, options=SHORT.get(name), seed=1):
            assert len(estimate.outcome.split()) > 3, name
            assert estimate.values == {}, name


@pytest.mark.parametrize("name", NAMES)
def test_every_estimator_refuses_known_values_with_which_nothing_oscillates(name):
    problem = Problem(("viscous",), System("linear", {"stiffness": -1.0, "rest_angle": 0.0}))
    with pytest.raises(InputError, match="stiffness = -1: it must be above 0"):
        run(name, damped_cosine()[0], problem, seed=1)


class Stub(Estimator):
    """A minimal estimator that returns a value or raises an error."""

    name = "stub"
    options = Options

    def __init__(self, error: Exception | None = None, **values: float) -> None:
        self.error, self.values = error, values

    def initial(self, signal, problem, options, rng):
        if self.error:
            raise self.error
        return Estimate(self.name, "initial", self.values)


@pytest.fixture
def stub():
    def add(*args, **kwargs):
        ESTIMATORS.add("stub", Stub(*args, **kwargs))

    yield add
    ESTIMATORS.remove("stub")


def test_a_refusal_and_a_value_that_is_not_finite_are_outcomes_and_other_errors_are_not(stub, noisy):
    stub(Refusal("the net did not converge at all"))
    initial, refined = run("stub", *noisy, seed=1)
    assert initial.outcome == "the net did not converge at all"
    assert refined.outcome == "no initial estimate to refine: the net did not converge at all"
    stub(KeyError("a fault"))
    with pytest.raises(KeyError):
        run("stub", *noisy, seed=1)
    for values, reason in (({"zeta": float("nan")}, "not finite"), ({"stiffness": 20.0}, "no value of zeta")):
        stub(**values)
        initial, refined = run("stub", *noisy, seed=1)
        assert reason in initial.outcome
        assert initial.values == refined.values == {}


@pytest.mark.parametrize("start", [1e-6, 5.0])
def test_the_refinement_converges_from_a_distant_start(stub, noisy, start):
    stub(zeta=start)
    refined = run("stub", *noisy, seed=1)[1]
    assert refined.values["zeta"] == pytest.approx(0.05, rel=0.02)
    assert refined.outcome == "ok"
