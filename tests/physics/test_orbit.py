"""Period, energy and dissipation of a cycle, against closed forms, elliptic integrals and a trajectory."""

import math

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from bayesdamp.physics.orbit import cycle
from bayesdamp.physics.oscillator import Oscillator
from tests.physics.independent import trajectory

K = 20.0
W = math.sqrt(K)


@pytest.mark.parametrize("amplitude", [0.1, 2.9])
def test_a_cycle_of_a_gravity_pendulum_agrees_with_elliptic_integrals(amplitude):
    p = {"stiffness": K, "rest_angle": 0.4, "zeta": 0.05, "mu_q": 0.1}
    result = cycle(Oscillator(("viscous", "quadratic"), "pendulum"), p, amplitude, 0.4)
    m = math.sin(amplitude / 2) ** 2
    action = 16 * W * (ellipe(m) - (1 - m) * ellipk(m))
    drag = 8 * K * (math.sin(amplitude) - amplitude * math.cos(amplitude))
    assert float(result.period) == pytest.approx(4 * ellipk(m) / W, rel=1e-7)
    assert float(result.energy) == pytest.approx(K * (1 - math.cos(amplitude)), rel=1e-11)
    assert float(result.energy_slope) == pytest.approx(K * math.sin(amplitude), rel=1e-11)
    assert float(result.energy_lost) == pytest.approx(2 * 0.05 * action + 0.1 * drag, rel=1e-8)


def test_a_cycle_of_an_asymmetric_law_agrees_with_a_trajectory():
    """The turning points of k(θ − θ_s) − γ cos θ have different distances from rest; the amplitude is their mean."""
    p = {"stiffness": 40.0, "gravity": -30.0, "spring_angle": 0.5, "theta0": 1.6, "omega0": 0.0}
    t = np.linspace(0.0, 3.0, 30_001)
    path = trajectory("horizontal_pendulum", p, t, force=lambda v, sign: 0.0 * v)
    x, v = path[:, 0], path[:, 1]
    amplitude = 0.5 * float(x.max() - x.min())
    osc = Oscillator(("quadratic",), "horizontal_pendulum")
    rest = osc.equilibrium(p, float(x.mean()))
    result = cycle(osc, {**p, "mu_q": 0.1}, amplitude, rest)
    turns = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0))
    period = float(np.mean(np.diff(t[turns] + (t[1] - t[0]) * v[turns] / (v[turns] - v[turns + 1]))))
    assert float(result.period) == pytest.approx(period, rel=1e-6)
    first = t <= period
    lost = float(np.trapezoid(0.1 * np.abs(v[first]) ** 3, t[first]))
    assert float(result.energy_lost) == pytest.approx(lost, rel=1e-3)
    assert abs((x.max() - rest) / (rest - x.min()) - 1) > 0.05  # the motion is asymmetric
