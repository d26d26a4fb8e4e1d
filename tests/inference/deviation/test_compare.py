"""Records that are hard to linearise: few samples, a wandering frequency, an equilibrium that is not recorded."""

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.linear import smooth_root
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Signal
from validation.contest.records import simulate_record


def test_a_record_with_fewer_values_than_the_model_of_all_forms_has_unknowns():
    t = np.arange(12) * 2.7 / 12
    noise = 1e-3 * np.random.default_rng(12).standard_normal(t.size)
    signal = bd.Signal(t, np.exp(-0.03 * 2 * np.pi * t) * np.cos(2 * np.pi * t) + noise)
    at, *_ = bd.compare(signal, sample=False).verdict.damping_ratio
    assert at.low < 0.03 < at.high


def test_no_restoring_law_is_left_out_for_a_frequency_that_wanders():
    """At its fit without deviations the true law is 107 nats behind; at its mode it is the best."""
    rng, n = np.random.default_rng(27), 320
    t, knots = np.arange(n) / 16, np.linspace(0, (n - 1) / 16, 12)
    root = smooth_root(12, 0.3)
    h, g = (np.interp(t, knots, size * root @ rng.standard_normal(12)) for size in (0.03, 0.2))
    phase, decay = (np.append(0, np.cumsum(rate[1:])) * 2 * np.pi / 16 for rate in (1 + h, 0.02 * np.exp(g)))
    noise = 1e-3 * rng.standard_normal(n)
    comparison = compare_signal(Signal(t, 0.5 * np.exp(-decay) * np.cos(phase) + noise, "angle"))
    assert {r.candidate.restoring for r in comparison.results} == set(LAWS.names())
    assert comparison.best.candidate.restoring == "linear"


def test_a_linear_model_whose_singular_values_do_not_converge_is_solved():
    """LAPACK's gelsd fails on a matrix of 39 well-scaled unknowns that this record leads to."""
    record = simulate_record(813, 76)
    assert "+".join(compare_signal(record.signal).best.candidate.damping) == record.damping


def test_the_equilibrium_of_a_velocity_may_be_far_from_zero() -> None:
    """A spring balances gravity there. Control: the same values as an angle would have to be near it."""
    t, law = np.linspace(0.0, 20.0, 400), {"stiffness": 9.68, "gravity": 10.17, "spring_angle": -1.26}
    values = np.array([law[name] for name in LAWS.get("horizontal_pendulum").parameters])
    y = 0.05 * np.exp(-0.02 * t) * np.cos(2.7 * t)
    angle, rate = (prepare_data(Signal(t, y, quantity)) for quantity in ("angle", "velocity"))
    rest = rate.equilibrium("horizontal_pendulum", values)
    assert 9.68 * (rest + 1.26) == pytest.approx(10.17 * np.cos(rest))
    assert angle.equilibrium("horizontal_pendulum", values) is None
