"""Exact dry friction (ε = 0) in kernels: the sign itself, with sticking, against closed forms and SciPy's solver."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS, QUANTITIES
from bayesdamp.physics.kernel.windows import Windows
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from tests.physics.independent import LAWS, trajectory, with_coulomb

TIMES = np.linspace(0.0, 10.0, 1003)
KNOTS = np.linspace(0.0, 10.0, 5)
W = math.sqrt(20.0)
BASE = {"mu_c": 0.3, "stiffness": 20.0, "rest_angle": 0.05, "epsilon": 0.0, "theta0": 0.35, "omega0": 0.0}
CASES = {
    "released": {},
    "stops early": {"mu_c": 1.1},
    "pushed outwards": {"omega0": 1.3},
    "from below": {"theta0": -0.3, "omega0": -0.4},
    "from the middle": {"theta0": 0.05, "omega0": 1.0},
    "never moves": {"theta0": 0.06},
    "no friction": {"mu_c": 0.0},
}
LIMITS = (5e-8, 5e-7, 1e-5)
"""Errors of displacement, velocity and acceleration, over the scale of each."""


def solver_of(
    terms: tuple[str, ...] = ("coulomb",), quantity: str = "angle", *, epsilon: float = 0.0, times: np.ndarray = TIMES
) -> Solver:  # fmt: skip
    return Solver(terms, "linear", times, quantity, 0.3, W, epsilon, KNOTS)


def solved(made: Solver, p: dict[str, float], *args: object, **kwargs: object) -> Motion:
    values = np.array([{"rest": p["rest_angle"], **p}.get(name, 0.0) for name in made.names])
    found = made.solve(values, np.ones(len(made.terms), bool), *args, **kwargs)  # type: ignore[arg-type]
    assert found is not None
    return found


def test_closed_form() -> None:
    """No sample lies on a turning point, where the acceleration jumps."""
    for case in CASES:
        p = {**BASE, **CASES[case]}
        truth = with_coulomb(p, TIMES)
        for order, quantity in enumerate(QUANTITIES):
            found = solved(solver_of(quantity=quantity), p, tangents=NONE).y
            assert np.max(np.abs(found - truth[:, order])) < LIMITS[order] * 0.3 * W**order, case


def test_closed_form_agrees_with_the_independent_solver() -> None:
    p = {**BASE, "omega0": 1.3}
    np.testing.assert_allclose(
        with_coulomb(p, TIMES)[:, :2], trajectory("linear", p, TIMES)[:, :2], atol=1e-9
    )


def test_the_amplitude_falls_by_the_same_each_half_cycle_until_the_body_sticks() -> None:
    """By 2 μ_c/k. The control: friction that turns over within a hundredth of the peak velocity stops elsewhere."""
    motion = solved(solver_of(), BASE, tangents=NONE)
    again = np.flatnonzero(np.diff(motion.times) == 0)
    turns = np.concatenate([[BASE["theta0"]], motion.states[again, 0]]) - BASE["rest_angle"]
    lost = 2 * BASE["mu_c"] / BASE["stiffness"]
    assert np.abs(turns) == pytest.approx(0.3 - lost * np.arange(turns.size), abs=1e-8)
    assert np.diff(np.append(0.0, motion.times[again])) == pytest.approx(np.pi / W, abs=1e-7)
    assert abs(turns[-1]) < 0.5 * lost < abs(turns[-2])
    assert np.all(motion.states[again[-1] + 1 :, 1:] == 0)
    narrow = solved(solver_of(epsilon=0.01 * 0.3 * W), BASE, tangents=NONE)
    assert np.max(np.abs(narrow.y - motion.y)) > 1e-3


def test_a_sum_against_an_independent_solver() -> None:
    """Simulated, to the error that is asked for."""
    law = "horizontal_pendulum"
    osc = Oscillator(("viscous", "coulomb", "quadratic"), law)
    p = {"zeta": 0.05, "mu_q": 0.05, **LAWS[law], "epsilon": 0.0, "mu_c": 0.2, "omega0": 0.8}
    truth = trajectory(law, p, TIMES)
    for order, quantity in enumerate(QUANTITIES):
        assert np.max(np.abs(simulate(osc, p, TIMES, quantity) - truth[:, order])) < 5e-9 * W**order


STRIBECK = {**BASE, "mu_k": 0.3, "static_excess": 0.8, "stribeck_velocity": 0.3}


def test_stribeck_friction_against_an_independent_solver() -> None:
    mu, s, slow = (STRIBECK[n] for n in ("mu_k", "static_excess", "stribeck_velocity"))
    truth = trajectory(
        "linear", STRIBECK, TIMES, lambda v, sign: mu * (1 + s * math.exp(-((v / slow) ** 2))) * sign,
        grip=mu * (1 + s),
    )  # fmt: skip
    found = solved(solver_of(("stribeck",)), STRIBECK)
    assert np.max(np.abs(found.y - truth[:, 0])) < 1e-7


def test_friction_holds_a_body_up_to_its_static_value() -> None:
    """Stribeck's between μ_k and (1 + s) μ_k; that of the position, μ_p (1 + s u), of 0.57 and 0.63, a pull of 0.6."""
    for excess, moves in ((0.8, False), (0.0, True)):
        p = {**STRIBECK, "static_excess": excess, "theta0": 0.05 + 0.4 / 20.0}
        assert bool(np.ptp(solved(solver_of(("stribeck",)), p).y) > 1e-3) is moves
    for u, moves in ((0.1, True), (-0.1, False)):
        p = {
            **BASE,
            "mu_p": 0.6,
            "friction_slope": -0.5,
            "reference_amplitude": 0.3,
            "theta0": 0.05 + 0.3 * u,
        }
        assert bool(np.ptp(solved(solver_of(("dry_position",)), p).y) > 0) is moves


@pytest.mark.parametrize("case", ["pushed outwards", "stops early"])
def test_tangents_are_differences_of_the_closed_form(case: str) -> None:
    p = {**BASE, **CASES[case], "omega0": CASES[case].get("omega0", 0.1)}
    made = solver_of()
    tangents = solved(made, p).tangents
    for i, name in enumerate(made.names):
        d = 1e-6
        up, down = ({**p, name: p[name] + s * d} for s in (1, -1))
        if name == "mu_c" and p[name] == 0:
            continue
        difference = (with_coulomb(up, TIMES)[:, 0] - with_coulomb(down, TIMES)[:, 0]) / (2 * d)
        assert np.max(np.abs(tangents[:, i] - difference)) < 1e-6 * np.max(np.abs(difference))


G = np.array([0.0, 0.3, -0.2, 0.1, 0.4])
H = np.array([0.01, -0.02, 0.015, 0.0, -0.01])


@pytest.mark.parametrize("order", [0, 1])
def test_tangents_are_central_differences(order: int) -> None:
    """By every parameter and knot, but at samples that a turning point passes between the two motions. The control:
    there those of the velocity jump."""
    terms = ("viscous", "stribeck")
    p = {**BASE, **STRIBECK, "zeta": 0.05, "mu_k": 0.1, "mu_c": 0.15, "omega0": 0.2}
    made = solver_of(terms, QUANTITIES[order])
    values, on = np.array([p[name] for name in made.names]), np.ones(2, bool)
    motion = solved(made, p, G, H, ALL)
    turns = motion.times[:-1][np.diff(motion.times) == 0]
    apart = np.min(np.abs(TIMES[:, None] - turns), axis=1) > 2e-3
    assert turns.size > 8
    for i in range(values.size + G.size + H.size):
        ends = []
        for sign in (1.0, -1.0):
            given = np.concatenate([values, G, H])
            given[i] += sign * 1e-5
            split = np.split(given, [values.size, values.size + G.size])
            end = made.solve(split[0], on, split[1], split[2], NONE, tolerance=1e-13)
            assert end is not None
            ends.append(end.y)
        difference = (ends[0] - ends[1]) / 2e-5
        error = np.abs(motion.tangents[:, i] - difference) / np.max(np.abs(difference))
        assert np.max(error[apart]) < (5e-6, 1e-4)[order]
    if order == 1:
        before, after = (
            solved(solver_of(terms, "velocity", times=turns + d), p, G, H, ALL).tangents
            for d in (-1e-6, 1e-6)
        )
        assert np.min(np.max(np.abs(after - before) / np.max(np.abs(before), axis=0), axis=1)) > 1e-3


def test_windows() -> None:
    """Means of samples over an eightieth of a cycle. In a window with a turning point the acceleration jumps, and two
    points are right to a hundredth of the jump times the window's length squared."""
    count, long = 500, 2 * math.pi / W / 80
    times = np.linspace(0.0, 9.9 - long, count)[:, None] + long * np.linspace(0, 1, 12)
    made = Solver(("coulomb",), "linear", times.mean(axis=1), "angle", 0.3, W, 0.0, KNOTS, Windows.of(times))
    p = {**BASE, "omega0": 1.3}
    truth = with_coulomb(p, times.ravel())[:, 0].reshape(times.shape)
    motion = solved(made, p, tangents=PARAMETERS)
    error = np.abs(motion.y - truth.mean(axis=1))
    assert np.max(error) < 5e-8 + 0.02 * 2 * p["mu_c"] * long**2
    assert np.median(error) < 5e-8
    assert np.max(np.abs(motion.y - truth[:, 0])) > 1e-3  # control
    weights = np.random.default_rng(1).standard_normal(count)
    assert motion.pulled(weights) == pytest.approx(weights @ motion.tangents, rel=1e-9)


def test_what_is_rounded_off_stays_so() -> None:
    """The square root of the velocity, steep at rest, holds no body beside exact friction."""
    terms = ("coulomb", "power")
    p = {**BASE, "c_power": 0.1, "exponent": 0.5, "reference_velocity": 1.3, "omega0": 0.2}
    motion = solved(solver_of(terms), p, tangents=PARAMETERS)

    def force(v: float, sign: float) -> float:
        return p["mu_c"] * sign + 0.1 * math.sqrt(1.3 * abs(v)) * math.copysign(1.0, v)

    assert np.max(np.abs(motion.y - trajectory("linear", p, TIMES, force)[:, 0])) < 1e-4
    assert np.all(np.isfinite(motion.tangents))
