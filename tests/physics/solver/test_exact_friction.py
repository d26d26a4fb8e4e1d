"""ε = 0: the sign itself, with sticking. The closed form of the linear spring is the truth."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesdamp.physics.integrate import make_plan, simulate
from bayesdamp.physics.solver.plan import compiled_record

from bayesdamp.physics.oscillator import Oscillator
from tests.physics.independent import LAWS, trajectory

TIMES = np.linspace(0.0, 10.0, 1003)
COULOMB = Oscillator(("coulomb",), "linear")
BASE = {"mu_c": 0.3, "stiffness": 20.0, "rest_angle": 0.05, "epsilon": 0.0, "theta0": 0.35, "omega0": 0.0}


def closed_form(p: dict[str, float], times: np.ndarray) -> np.ndarray:
    """θ, θ̇, θ̈ of k(θ − θ_e) with exact Coulomb friction, shape (n, 3): half-cosines, then rest."""
    w = math.sqrt(p["stiffness"])
    out = np.zeros((times.size, 3))
    t, x, v = 0.0, p["theta0"] - p["rest_angle"], p["omega0"]
    while True:
        if v == 0 and p["stiffness"] * abs(x) <= p["mu_c"]:
            out[times >= t] = x + p["rest_angle"], 0.0, 0.0
            return out
        sign = math.copysign(1.0, v) if v else -math.copysign(1.0, x)
        centre = -sign * p["mu_c"] / p["stiffness"]
        size, phase = math.hypot(x - centre, v / w), math.atan2(-v / w, x - centre)
        # The velocity −size·w·sin(wt + phase) vanishes next where wt + phase is a multiple of π.
        first = math.pi * (math.floor(phase / math.pi + 1e-12) + 1) - phase
        end = t + first / w
        inside = (times >= t) & (times <= end)
        angle = w * (times[inside] - t) + phase
        out[inside, 0] = p["rest_angle"] + centre + size * np.cos(angle)
        out[inside, 1] = -size * w * np.sin(angle)
        out[inside, 2] = -size * w**2 * np.cos(angle)
        if end >= times[-1]:
            return out
        t, x, v = end, centre + size * math.cos(first + phase), 0.0


CASES = {
    "released": {},
    "stops early": {"mu_c": 1.1},
    "pushed outwards": {"omega0": 1.3},
    "from below": {"theta0": -0.3, "omega0": -0.4},
    "from the middle": {"theta0": 0.05, "omega0": 1.0},
    "never moves": {"theta0": 0.06},
    "no friction": {"mu_c": 0.0},
}


@pytest.mark.parametrize("case", CASES)
def test_closed_form(case):
    p = {**BASE, **CASES[case]}
    y = simulate(COULOMB, p, TIMES, tolerance=1e-7)
    assert np.max(np.abs(y - closed_form(p, TIMES)[:, 0])) < 1.5e-7


def test_closed_form_at_default_settings():
    p = {**BASE, "omega0": -0.9}
    assert np.max(np.abs(simulate(COULOMB, p, TIMES) - closed_form(p, TIMES)[:, 0])) < 2e-9


def test_closed_form_agrees_with_the_independent_solver():
    p = {**BASE, "omega0": 1.3}
    truth = trajectory("linear", p, TIMES)
    np.testing.assert_allclose(closed_form(p, TIMES)[:, :2], truth[:, :2], atol=1e-9)


@pytest.mark.parametrize(("quantity", "column"), [("velocity", 1), ("acceleration", 2)])
def test_velocity_and_acceleration(quantity, column):
    """No sample lies on a turning point, where the acceleration jumps."""
    p = {**BASE, "omega0": 1.3}
    y = simulate(COULOMB, p, TIMES, quantity=quantity, tolerance=1e-5)
    assert np.max(np.abs(y - closed_form(p, TIMES)[:, column])) < 2e-5


@pytest.mark.parametrize(
    ("damping", "law", "changed"),
    [
        (("viscous", "coulomb"), "pendulum", {"mu_c": 0.5}),
        (("viscous", "coulomb", "quadratic"), "horizontal_pendulum", {"mu_c": 0.2, "omega0": 0.8}),
    ],
)
def test_sums_against_an_independent_solver(damping, law, changed):
    osc = Oscillator(damping, law)
    coefficients = {n: v for n, v in {"zeta": 0.05, "mu_q": 0.05}.items() if n in osc.parameters}
    p = {**coefficients, **LAWS[law], "epsilon": 0.0, **changed}
    y = simulate(osc, p, TIMES, tolerance=1e-7)
    assert np.max(np.abs(y - trajectory(law, p, TIMES)[:, 0])) < 2e-7


def test_negative_control():
    """tanh with ε = 0.1 is another motion, and far outside the tolerance."""
    y = simulate(COULOMB, {**BASE, "epsilon": 0.1}, TIMES, tolerance=1e-5)
    assert np.max(np.abs(y - closed_form(BASE, TIMES)[:, 0])) > 1e-3


def test_tangents_of_the_exact_motion():
    """Forward tangents through turning points and sticking against central differences of the closed form."""
    p = {**BASE, "omega0": 1.3}
    plan = make_plan(COULOMB, p, TIMES, tolerance=1e-7)
    run = compiled_record(COULOMB)
    values = {n: jnp.asarray(p[n]) for n in COULOMB.parameters}
    for name in ("mu_c", "stiffness", "theta0", "omega0"):
        direction = {n: jnp.asarray(float(n == name)) for n in values}
        tangent = np.asarray(jax.jvp(lambda q: run(plan, q), (values,), (direction,))[1])
        d = 1e-6 * max(1.0, abs(p[name]))
        up, down = ({**p, name: p[name] + s * d} for s in (1, -1))
        difference = (closed_form(up, TIMES)[:, 0] - closed_form(down, TIMES)[:, 0]) / (2 * d)
        assert np.max(np.abs(tangent - difference)) < 2e-4 * max(1.0, float(np.max(np.abs(difference))))
