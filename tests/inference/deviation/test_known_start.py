"""A densely sampled record with a known start: means over windows mean the same in the record and in the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import root_scalar

from bayesdamp.inference.deviation import data as preparing
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import Data, prepared
from bayesdamp.inference.deviation.linear import knots_of
from bayesdamp.inference.deviation.weighing import weigh_all
from bayesdamp.interface.answer import WEIGHED, answer
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel.solve import NONE, Windows
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict

LAW = "horizontal_pendulum"
STIFFNESS, EPSILON = 20.0, 0.1
KNOWN = {
    "stiffness": STIFFNESS,
    "gravity": 1.0,
    "spring_angle": 0.0,
    "theta0": 0.3,
    "omega0": 0.0,
    "epsilon": EPSILON,
}
TRUTHS = {"viscous": 0.05, "coulomb": 0.03, "quadratic": 0.05}
PERIOD = 1.4032
NOISE = 1e-4
"""Noise of 70 samples a cycle, in rad; more of them are noisier, so that all records hold as much."""
AMPLITUDE = 0.25
RATES = (70, 200, 1400)
"""Samples a cycle: without means, with a few samples in each, and with many."""
QUANTITIES = ("angle", "velocity", "acceleration")


def force(kind: str, value: float, v: np.ndarray) -> np.ndarray:
    """Return the force of a damping term, per unit of inertia."""
    shape = {"viscous": 2 * v, "coulomb": np.tanh(v / EPSILON), "quadratic": v * np.abs(v)}[kind]
    return value * shape


def motion(
    kind: str, value: float, t: np.ndarray, quantity: str = "angle", theta0: float = 0.3
) -> np.ndarray:
    """Return SciPy's motion at times t (n,) in s from the start."""

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state
        return np.array([v, -force(kind, value, v) - STIFFNESS * x + np.cos(x)])

    states = solve_ivp(slope, (0, t[-1]), (theta0, 0.0), "DOP853", t, rtol=1e-11, atol=1e-13).y
    return (*states, slope(0.0, states)[1])[QUANTITIES.index(quantity)]


def true_ratio(kind: str, amplitude: float) -> float:
    """Return the energy lost in a cycle of this amplitude over 4π times the energy."""

    def potential(x: float) -> float:
        return 0.5 * STIFFNESS * x**2 - np.sin(x)

    def root(function: Callable[[float], float], low: float, high: float) -> float:
        return root_scalar(function, bracket=(low, high)).root

    rest = root(lambda x: STIFFNESS * x - np.cos(x), -1, 1)
    middle = root(lambda m: potential(m + amplitude) - potential(m - amplitude), rest - 0.1, rest + 0.1)
    top = potential(middle + amplitude)

    def lost(phase: float) -> float:
        x = middle + amplitude * np.sin(phase)
        v = np.sqrt(2 * max(top - potential(x), 0.0))
        return 2 * float(force(kind, TRUTHS[kind], np.array(v))) * amplitude * np.cos(phase)

    return quad(lost, -np.pi / 2, np.pi / 2)[0] / (4 * np.pi * (top - potential(rest)))


@lru_cache
def record(kind: str, rate: int, first: float = 0.0) -> Signal:
    """Seven cycles of the paper's pendulum."""
    t = np.arange(7 * rate) * PERIOD / rate
    sd = NOISE * np.sqrt(rate / RATES[0])
    y = motion(kind, TRUTHS[kind], t) + sd * np.random.default_rng(5).standard_normal(t.size)
    return Signal(first + t, y, name=kind)


def asked(signal: Signal, data: Data | None = None) -> Verdict:
    """Return the verdict on a record whose start is known, weighed on `data` instead of its own where that is given."""
    made = {}
    if data is not None:
        candidates = [MotionCandidate((term,), LAW) for term in TRUTHS]
        made = {WEIGHED: weigh_all(data, candidates, known=KNOWN, approximate=False)}
    return answer(
        signal, [AMPLITUDE], damping=list(TRUTHS), restoring=[LAW], known=KNOWN, deviation="none", measured=False,
        sample=False, weighings=made,
    ).verdict  # fmt: skip


def shifted(data: Data, by: float) -> Data:
    """Return the data with another origin of time."""
    assert data.windows is not None
    return replace(data, t=data.t - by, windows=Windows(data.windows.times - by, data.windows.weights))


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("kind", TRUTHS)
def test_the_true_damping_is_named_at_any_rate(kind: str, rate: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine intervals of 95 % on one seed: one of them or more misses with a probability of 0.37, two or more with 0.07.

    The seed is one at which none does, and the same for intervals without averaging."""
    signal = record(kind, rate)
    verdict = asked(signal)
    assert (prepared(signal).windows is not None) == (rate >= 160)
    monkeypatch.setattr(preparing, "A_CYCLE", 10**9)
    assert prepared(signal).windows is None
    every = asked(signal).damping_ratio[0]
    ratio = verdict.damping_ratio[0]
    assert (verdict.damping, verdict.decided) == (kind, True)
    assert verdict.probability > 0.99
    assert ratio.low < true_ratio(kind, AMPLITUDE) < ratio.high
    assert ratio.high - ratio.low == pytest.approx(every.high - every.low, rel=0.15)
    assert abs(ratio.value - every.value) < 0.1 * (every.high - every.low)


def test_half_a_window_of_time_is_seen() -> None:
    """Negative control: an origin of time at the first mean gives a wrong answer."""
    signal = record("coulomb", 700)
    data = prepared(signal)
    assert data.thinned == 8
    ratio = asked(signal, shifted(data, 0.0)).damping_ratio[0]
    assert ratio.low < true_ratio("coulomb", AMPLITUDE) < ratio.high
    verdict = asked(signal, shifted(data, float(data.t[0])))
    ratio = verdict.damping_ratio[0]
    assert verdict.damping != "coulomb" or not ratio.low < true_ratio("coulomb", AMPLITUDE) < ratio.high


def test_the_origin_of_the_stamps_does_not_matter() -> None:
    here, there = asked(record("coulomb", 700)), asked(record("coulomb", 700, first=12.5))
    assert there.damping == here.damping
    assert there.damping_ratio[0].value == pytest.approx(here.damping_ratio[0].value, rel=1e-6)


def test_time_begins_at_the_first_sample() -> None:
    """The first mean is in the middle of its window, in the fit's time and in the picture's."""
    signal = record("viscous", 1400, first=3.0)
    data = prepared(signal)
    step = PERIOD / 1400
    assert data.thinned == 17
    assert data.times[0] == pytest.approx((data.thinned - 1) / 2 * step)
    assert data.duration == pytest.approx(float(signal.t[-1] - signal.t[0]), abs=data.thinned * step)
    half = data.first(data.t.size // 2)
    assert half.end < data.end / 2 + step


def stamps(uneven: bool) -> np.ndarray:
    """9,520 = 16 × 17 × 35 times, of 1,400 a cycle; uneven: jittered by half a step, and with a hole of 0.4 cycles
    after a whole number of windows of 16 or 17 samples."""
    step = PERIOD / 1400
    t = np.arange(16 * 17 * 35) * step
    if uneven:
        t[1:] += 0.5 * step * np.random.default_rng(2).uniform(-1, 1, t.size - 1)
        t[16 * 17 * 10 :] += 0.4 * PERIOD
    return t


def log_likelihood(data: Data, kind: str, value: float, theta0: float, noise: float) -> float:
    """Return the log likelihood of the data, up to a constant that does not depend on the motion."""
    solver = data.solver(PAPER_TERMS, LAW, EPSILON, knots_of(data.end, data.cycles))
    names = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
    given = {**KNOWN, "theta0": theta0, names[kind]: value}
    active = np.array([term == kind for term in PAPER_TERMS])
    found = solver.solve(np.array([given.get(n, 0.0) for n in solver.names]), active, tangents=NONE)
    assert found is not None
    return -0.5 * data.thinned * float(np.sum((data.y - found.y) ** 2)) / noise**2


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("kind", TRUTHS)
def test_log_likelihoods_differ_as_those_of_all_samples(kind: str, quantity: str, uneven: bool) -> None:
    """Differences agree within 0.1 nats for pairs that differ by tens of nats.

    The negative controls are an origin of time at the first mean, and a motion that is not averaged. The record has
    no noise: the information in the noise within windows is lost, which is 0.03 √difference by chance.
    """
    t = stamps(uneven)
    size = np.sqrt(STIFFNESS) ** QUANTITIES.index(quantity)
    noise = 1e-4 * size
    truth, other = (TRUTHS[kind], 0.3), (TRUTHS[kind] + 1e-5, 0.29999)
    y = motion(kind, truth[0], t, quantity)
    data = prepared(Signal(t, y, name=kind, quantity=quantity))
    assert data.thinned * data.t.size == t.size

    def difference(data: Data) -> float:
        of = partial(log_likelihood, data, kind, noise=noise)
        return of(*truth) - of(*other)

    moved = motion(kind, other[0], t, quantity, other[1])
    exact = 0.5 * float(np.sum((y - moved) ** 2)) / noise**2
    assert exact > 10
    assert difference(data) == pytest.approx(exact, abs=0.1)
    assert abs(difference(shifted(data, float(data.t[0]))) - exact) > 1.0
    assert abs(difference(replace(data, windows=None)) - exact) > 1.0
