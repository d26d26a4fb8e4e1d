"""A densely sampled record with a known start: means over windows mean the same in the record and in the motion."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.data import Data, prepared
from bayesdamp.inference.deviation.gaussian.hyperparameters import knots_of
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.physics.kernel.windows import Windows
from bayesdamp.types import Signal

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


def shifted(data: Data, by: float) -> Data:
    """Return the data with another origin of time."""
    assert data.windows is not None
    return replace(data, t=data.t - by, windows=Windows(data.windows.times - by, data.windows.weights))


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


@pytest.mark.parametrize(
    ("kind", "quantity", "uneven"),
    [("viscous", "angle", False), ("coulomb", "velocity", True), ("quadratic", "acceleration", True)],
)
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
