"""A densely sampled record with a known start: means over windows mean the same in the record and in the motion."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.inference.deviation.data import Data, prepare_data
from bayesdamp.inference.deviation.linear import knots_of
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.types import Signal
from tests.physics.independent import trajectory
from validation.truth.oscillator import Oscillator
from validation.truth.ratio import true_ratio

LAW = "horizontal_pendulum"
STIFFNESS, EPSILON = 20.0, 0.1
SPRING = {"stiffness": STIFFNESS, "gravity": 1.0, "spring_angle": 0.0}
KNOWN = {**SPRING, "theta0": 0.3, "omega0": 0.0, "epsilon": EPSILON}
TRUTHS = {"viscous": {"zeta": 0.05}, "coulomb": {"mu_c": 0.03}, "quadratic": {"mu_q": 0.05}}
PERIOD = 1.4032
NOISE = 1e-4
"""Noise of 70 samples a cycle, in rad; more of them are noisier, so that all records hold as much."""
AMPLITUDE = 0.25
QUANTITIES = ("angle", "velocity", "acceleration")


@pytest.mark.parametrize("rate", [70, 200, 1400])
@pytest.mark.parametrize("kind", TRUTHS)
def test_the_true_damping_is_named_at_any_rate(kind: str, rate: int) -> None:
    """Seven cycles without means, with a few samples in each, and with many; the stamps begin at 12.5 s.

    Nine intervals of 95 % on one seed: one of them or more misses with a probability of 0.37, two or more with 0.07.
    The seed is one at which none does.
    """
    t = np.arange(7 * rate) * PERIOD / rate
    noise = NOISE * np.sqrt(rate / 70) * np.random.default_rng(5).standard_normal(t.size)
    signal = Signal(12.5 + t, trajectory(LAW, {**KNOWN, **TRUTHS[kind]}, t)[:, 0] + noise, name=kind)
    asked = {"damping": list(TRUTHS), "restoring": [LAW], "known": KNOWN, "deviation": "none"}
    comparison = compare_models(signal, **asked)
    verdict = answer(signal, comparison, [AMPLITUDE], measured=False, sample=False).verdict
    data = prepare_data(signal)
    assert (data.rows is not None) == (rate >= 64)
    assert data.times[0] == pytest.approx((data.thinned - 1) / 2 * PERIOD / rate)  # of the picture
    ratio = verdict.damping_ratio[0]
    assert (verdict.damping, verdict.decided) == (kind, True)
    assert verdict.probability > 0.99
    (coefficient,) = TRUTHS[kind].values()
    truth = true_ratio(Oscillator(LAW, SPRING, {kind: coefficient}, EPSILON), AMPLITUDE)
    assert ratio.low < truth < ratio.high


def stamps(uneven: bool) -> np.ndarray:
    """9,520 times, of 1,400 a cycle; uneven: jittered by half a step, and with a hole of 0.4 cycles."""
    step = PERIOD / 1400
    t = np.arange(9520) * step
    if uneven:
        t[1:] += 0.5 * step * np.random.default_rng(2).uniform(-1, 1, t.size - 1)
        t[2720:] += 0.4 * PERIOD
    return t


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_log_likelihoods_differ_as_those_of_all_samples(quantity: str, uneven: bool) -> None:
    """Under friction, differences agree within 0.1 nats for pairs that differ by tens of nats.

    The negative controls are an origin of time at the first mean, and a motion that is not averaged. The record has
    no noise: the information within windows is lost, 0.3 % of that on a sinusoid.
    """
    t, order = stamps(uneven), QUANTITIES.index(quantity)
    noise = 1e-4 * np.sqrt(STIFFNESS) ** order
    truth, other = {"mu_c": 0.03, "theta0": 0.3}, {"mu_c": 0.03001, "theta0": 0.29999}
    y, moved = (trajectory(LAW, {**KNOWN, **p}, t)[:, order] for p in (truth, other))
    data = prepare_data(Signal(t, y, quantity=quantity))
    # A window that does not fill up before a hole or the end is left out.
    assert data.rows.size > 0.98 * t.size

    def log_likelihood(data: Data, changed: dict[str, float]) -> float:
        solver = data.solver(PAPER_TERMS, LAW, EPSILON, knots_of(data.end, data.cycles))
        given = {**KNOWN, **changed}
        p, active = np.array([given.get(n, 0.0) for n in solver.names]), np.array([False, True, False])
        solved = solver.solve(p, active, tangents=NONE)
        return -0.5 * data.thinned * float(np.sum((data.y - solved.y) ** 2)) / noise**2

    def difference(data: Data) -> float:
        return log_likelihood(data, truth) - log_likelihood(data, other)

    left = np.sinc(data.rows.shape[1] / 1400) ** 2  # the mean of a sinusoid over a window is smaller by sinc
    exact = left * 0.5 * float(np.sum((y - moved)[data.rows] ** 2)) / noise**2
    assert exact > 10
    assert difference(data) == pytest.approx(exact, abs=0.1)
    later = replace(data, t=data.t - data.t[0], record=replace(data.record, t=data.record.t - data.t[0]))
    assert abs(difference(later) - exact) > 1.0
    assert abs(difference(replace(data, rows=None)) - exact) > 1.0
