"""A cycle of the undamped motion and the work of damping along it, against closed forms and elliptic integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from bayesdamp.physics.orbit import Cycle, cycle
from bayesdamp.physics.oscillator import Oscillator
from tests.physics.independent import trajectory

K, A = 20.0, 0.3
W = math.sqrt(K)


def of(damping: tuple[str, ...], law: str, amplitude: float = A, **p: float) -> Cycle:
    return cycle(Oscillator(damping, law), {"stiffness": K, **p}, amplitude, p["rest_angle"])


@pytest.mark.parametrize("amplitude", [0.1, 2.9])
def test_gravity_pendulum_against_elliptic_integrals(amplitude):
    p = {"rest_angle": 0.4, "zeta": 0.05, "mu_q": 0.1}
    found = of(("viscous", "quadratic"), "pendulum", amplitude, **p)
    m = math.sin(amplitude / 2) ** 2
    action = 16 * W * (ellipe(m) - (1 - m) * ellipk(m))
    drag = 8 * K * (math.sin(amplitude) - amplitude * math.cos(amplitude))
    assert float(found.period) == pytest.approx(4 * ellipk(m) / W, rel=1e-7)
    assert float(found.energy) == pytest.approx(K * (1 - math.cos(amplitude)), rel=1e-11)
    assert float(found.energy_slope) == pytest.approx(K * math.sin(amplitude), rel=1e-11)
    assert float(found.energy_lost) == pytest.approx(2 * 0.05 * action + 0.1 * drag, rel=1e-8)


def test_friction_without_a_width_is_dry():
    """It takes 4 μA in a cycle."""
    assert float(of(("coulomb",), "linear", rest_angle=0.0, mu_c=0.03).energy_lost) == pytest.approx(
        4 * 0.03 * A
    )


def test_asymmetric_law_against_a_trajectory():
    """Turning points of k(θ − θ_s) − γ cos θ are not equally far from rest: half their distance is the amplitude."""
    p = {"stiffness": 40.0, "gravity": -30.0, "spring_angle": 0.5, "theta0": 1.6, "omega0": 0.0}
    t = np.linspace(0.0, 3.0, 30_001)
    path = trajectory("horizontal_pendulum", p, t, force=lambda v, sign: 0.0 * v)
    x, v = path[:, 0], path[:, 1]
    amplitude = 0.5 * float(x.max() - x.min())
    osc = Oscillator(("quadratic",), "horizontal_pendulum")
    rest = osc.equilibrium(p, float(x.mean()))
    found = cycle(osc, {**p, "mu_q": 0.1}, amplitude, rest)
    turns = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0))
    period = float(np.mean(np.diff(t[turns] + (t[1] - t[0]) * v[turns] / (v[turns] - v[turns + 1]))))
    assert float(found.period) == pytest.approx(period, rel=1e-6)
    one = t <= period
    lost = float(np.trapezoid(0.1 * np.abs(v[one]) ** 3, t[one]))
    assert float(found.energy_lost) == pytest.approx(lost, rel=1e-3)
    away = (x.max() - rest) / (rest - x.min())
    assert abs(away - 1) > 0.05  # else the case shows nothing
