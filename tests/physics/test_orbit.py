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


def of(damping: tuple[str, ...], law: str, amplitude: float = A, near: float = 0.0, **p: float) -> Cycle:
    return cycle(Oscillator(damping, law), {"stiffness": K, **p}, amplitude, near)


def test_linear_law():
    found = of(("viscous",), "linear", rest_angle=0.2, zeta=0.05)
    assert float(found.period) == pytest.approx(2 * math.pi / W, rel=1e-12)
    assert float(found.energy) == pytest.approx(K * A**2 / 2, rel=1e-12)
    assert float(found.slope) == pytest.approx(K * A, rel=1e-12)
    assert float(found.lost) == pytest.approx(2 * 0.05 * math.pi * W * A**2, rel=1e-10)


def test_work_of_friction_and_drag_in_the_linear_law():
    found = of(("coulomb",), "linear", rest_angle=0.0, mu_c=0.03, epsilon=0.0)
    assert float(found.lost) == pytest.approx(4 * 0.03 * A, rel=1e-12)
    # ∮ tanh(θ̇/ε) dθ is short of 4A by the share π²/24 (ε/Aω)², to leading order
    for epsilon in (0.02, 0.05):
        share = float(of(("coulomb",), "linear", rest_angle=0.0, mu_c=0.03, epsilon=epsilon).lost) / (
            0.12 * A
        )
        assert 1 - share == pytest.approx(math.pi**2 / 24 * (epsilon / (A * W)) ** 2, abs=2e-6)
    found = of(("quadratic",), "linear", rest_angle=0.0, mu_q=0.05)
    assert float(found.lost) == pytest.approx(8 / 3 * 0.05 * K * A**3, rel=1e-12)


@pytest.mark.parametrize("amplitude", [0.1, 2.9])
def test_gravity_pendulum_against_elliptic_integrals(amplitude):
    p = {"rest_angle": 0.4, "zeta": 0.05, "mu_q": 0.1}
    found = of(("viscous", "quadratic"), "pendulum", amplitude, 0.4, **p)
    m = math.sin(amplitude / 2) ** 2
    action = 16 * W * (ellipe(m) - (1 - m) * ellipk(m))
    drag = 8 * K * (math.sin(amplitude) - amplitude * math.cos(amplitude))
    assert float(found.period) == pytest.approx(4 * ellipk(m) / W, rel=1e-7)
    assert float(found.energy) == pytest.approx(K * (1 - math.cos(amplitude)), rel=1e-11)
    assert float(found.slope) == pytest.approx(K * math.sin(amplitude), rel=1e-11)
    assert float(found.lost) == pytest.approx(2 * 0.05 * action + 0.1 * drag, rel=1e-8)


def test_asymmetric_law_against_a_trajectory():
    """Turning points of k(θ − θ_s) − γ cos θ are not equally far from rest: half their distance is the amplitude."""
    p = {"stiffness": 40.0, "gravity": -30.0, "spring_angle": 0.5, "theta0": 1.6, "omega0": 0.0}
    t = np.linspace(0.0, 3.0, 30_001)
    path = trajectory("horizontal_pendulum", p, t, force=lambda v, sign: 0.0 * v)
    x, v = path[:, 0], path[:, 1]
    amplitude = 0.5 * float(x.max() - x.min())
    found = cycle(
        Oscillator(("quadratic",), "horizontal_pendulum"), {**p, "mu_q": 0.1}, amplitude, float(x.mean())
    )
    turns = np.flatnonzero((v[:-1] > 0) & (v[1:] <= 0))
    period = float(np.mean(np.diff(t[turns] + (t[1] - t[0]) * v[turns] / (v[turns] - v[turns + 1]))))
    assert float(found.period) == pytest.approx(period, rel=1e-6)
    one = t <= period
    assert float(found.lost) == pytest.approx(
        float(np.trapezoid(0.1 * np.abs(v[one]) ** 3, t[one])), rel=1e-3
    )
    rest = Oscillator(("quadratic",), "horizontal_pendulum").equilibrium(p, float(x.mean()))
    away = (x.max() - rest) / (rest - x.min())
    assert abs(away - 1) > 0.05  # else the case shows nothing


def test_what_has_no_such_motion_is_nan():
    over = of(("viscous",), "pendulum", 3.3, rest_angle=0.0, zeta=0.1)
    escapes = of(("viscous",), "duffing", 0.6, rest_angle=0.0, cubic=-80.0, zeta=0.1)
    unstable = of(("viscous",), "linear", stiffness=-3.0, rest_angle=0.0, zeta=0.1)
    for found in (over, escapes, unstable):
        assert math.isnan(float(found.lost))
    assert math.isfinite(float(of(("viscous",), "duffing", 0.4, rest_angle=0.0, cubic=-80.0, zeta=0.1).lost))
