"""The joint posterior of repeats against quadrature of a closed form, and what tells that they are no repeats."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.curves.weighted import shares, summarise
from bayesdamp.inference.many import joint_evidence
from bayesdamp.inference.many.joint import HOPELESS, Apart, JointMode, find_joint_mode
from bayesdamp.inference.many.joint_evidence import Weighed, weigh
from bayesdamp.priors import HalfNormal
from bayesdamp.types import Refusal
from tests.inference.many.repeats import STIFFNESS, joint, log_alone, records, starts, targets

CASES = {"repeats": (0.1, 0.1, 0.1), "at zero": (0.002, 0.002, 0.002), "two specimens": (0.1, 0.14, 0.1)}
LOG_HALF_NORMAL = float(np.log(2 / (0.3 * np.sqrt(2 * np.pi))))


@lru_cache
def signals(case: str):
    return records(CASES[case], seed=1)


@lru_cache
def shared(case: str) -> tuple[JointMode, Weighed]:
    made = targets(signals(case))
    at, tolerances = starts(made)
    mode = find_joint_mode(joint(made, ("zeta",), tolerances), at)
    return mode, weigh(mode, seed=3)


@lru_cache
def exact(case: str, records: tuple[int, ...] = (0, 1, 2)) -> tuple[float, float, float]:
    """Log evidence, mean and sd of the damping of some records together, on a grid."""
    zeta = np.linspace(1e-9, 0.2, 2001)
    log_p = sum(log_alone(signals(case)[i], zeta, np.full_like(zeta, STIFFNESS)) for i in records)
    log_p = log_p - 0.5 * (zeta / 0.3) ** 2 + LOG_HALF_NORMAL
    log_p[0] -= np.log(2)  # trapezoid
    log_evidence = float(logsumexp(log_p) + np.log(zeta[1] - zeta[0]))
    p = np.exp(log_p - np.asarray(logsumexp(log_p)))
    mean = float(p @ zeta)
    return log_evidence, mean, float(np.sqrt(p @ (zeta - mean) ** 2))


@pytest.mark.parametrize("case", CASES)
def test_the_joint_posterior_is_that_of_quadrature(case):
    """Some 1,800 effective draws: the bounds are four Monte Carlo errors, a false alarm once in 16,000 seeds."""
    log_evidence, mean, sd = exact(case)
    mode, found = shared(case)
    assert mode.converged
    assert found.outcome == "ok"
    assert found.effective > 1000
    zeta = mode.joint.values(found.scores)["zeta"]
    said = summarise(zeta, shares(found.log_weights))
    error = 1 / np.sqrt(found.effective)
    assert said["mean"] == pytest.approx(mean, abs=4 * error * sd)
    assert said["sd"] == pytest.approx(sd, rel=4 * error)
    # The step of the solver's plans adds 0.01 nats a record at most.
    assert found.log_evidence == pytest.approx(log_evidence, abs=4 * found.stderr + 0.03)
    # Negative control: one record alone has another posterior and another evidence.
    alone = exact(case, (0,))
    assert alone[2] > 1.25 * sd
    assert abs(alone[0] - log_evidence) > 100


def test_laplace_is_near_where_nothing_touches_zero():
    mode, found = shared("repeats")
    assert mode.look() == pytest.approx(found.log_evidence, abs=0.1)


def test_shared_against_own_damping_tells_repeats_from_specimens():
    """The log Bayes factor of one damping against one for each record: for in one case, against in the other."""
    factors = {}
    for case in ("repeats", "two specimens"):
        own = sum(exact(case, (i,))[0] for i in range(3))
        factors[case] = shared(case)[1].log_evidence - own
        assert factors[case] == pytest.approx(exact(case)[0] - own, abs=0.06)
    assert factors["repeats"] > 3
    assert factors["two specimens"] < -20


def test_one_record_with_all_shared_is_its_own_posterior():
    made = targets(signals("repeats"))[:1]
    at, tolerances = starts(made)
    found = weigh(find_joint_mode(joint(made, made[0].names, tolerances), at), seed=5)
    assert found.log_evidence == pytest.approx(exact("repeats", (0,))[0], abs=4 * found.stderr + 0.01)


def test_records_far_apart_are_not_searched():
    """Negative control of the search: dampings hundreds of standard deviations apart have no joint mode to look for."""
    made = targets(records((0.05, 0.4), seed=2, noise=0.002))
    at, tolerances = starts(made)
    with pytest.raises(Apart, match="the records disagree: a common value of zeta would cost") as caught:
        find_joint_mode(joint(made, ("zeta",), tolerances), at)
    assert caught.value.nats > HOPELESS


def test_a_prior_that_differs_cannot_be_shared():
    one, two, _ = targets(signals("repeats"))
    other = type(two)(
        two.signal, two.oscillator, two.noise, {**two.priors, "zeta": HalfNormal(scale=0.1)}, two.known
    )
    with pytest.raises(Refusal, match="zeta cannot be shared"):
        joint([one, other], ("zeta",), (1e-6, 1e-6))


def test_the_number_of_threads_does_not_change_a_digit(monkeypatch):
    """Negative control: another seed does."""
    mode, found = shared("repeats")
    monkeypatch.setattr(joint_evidence, "cores", lambda: 1)
    alone, other = weigh(mode, seed=3), weigh(mode, seed=4)
    assert alone.log_evidence == found.log_evidence
    np.testing.assert_array_equal(alone.log_weights, found.log_weights)
    assert other.log_evidence != found.log_evidence
