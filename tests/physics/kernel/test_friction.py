"""Exact dry friction (ε = 0) with sticking, against closed forms and SciPy's solver."""

import math

import numpy as np
import pytest

from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE, QUANTITIES
from bayesdamp.physics.oscillator import Oscillator, simulate
from tests.physics.independent import LAWS, trajectory, with_coulomb
from tests.physics.kernel.test_march import G, H, central_difference

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
"""Errors of displacement, velocity and acceleration over their scales."""


def solver_of(terms: tuple[str, ...] = ("coulomb",), quantity: str = "angle") -> Solver:
    return Solver(terms, "linear", TIMES, quantity, 0.3, W, 0.0, KNOTS)


def solved(solver: Solver, p: dict[str, float], *args: object, **kwargs: object) -> Motion:
    values = np.array([{"rest": p["rest_angle"], **p}.get(name, 0.0) for name in solver.names])
    return solver.solve(values, np.ones(len(solver.terms), bool), *args, **kwargs)


@pytest.mark.parametrize("case", CASES)
def test_motions_with_dry_friction_are_those_of_the_closed_form(case: str) -> None:
    """No sample is at a turning point, where the acceleration jumps."""
    p = {**BASE, **CASES[case]}
    truth = with_coulomb(p, TIMES)
    for order, quantity in enumerate(QUANTITIES):
        y = solved(solver_of(quantity=quantity), p, tangents=NONE).y
        assert np.max(np.abs(y - truth[:, order])) < LIMITS[order] * 0.3 * W**order


def test_simulated_motions_with_dry_friction_are_those_of_another_solver() -> None:
    law = "horizontal_pendulum"
    osc = Oscillator(("viscous", "coulomb", "quadratic"), law)
    p = {**LAWS[law], "zeta": 0.05, "mu_c": 0.2, "mu_q": 0.05, "epsilon": 0.0, "omega0": 0.8}
    truth = trajectory(law, p, TIMES)
    for order, quantity in enumerate(QUANTITIES):
        assert np.max(np.abs(simulate(osc, p, TIMES, quantity) - truth[:, order])) < 5e-9 * W**order


STRIBECK = {**BASE, "mu_k": 0.3, "static_excess": 0.8, "stribeck_velocity": 0.3}


def test_motions_with_stribeck_friction_are_those_of_another_solver() -> None:
    mu, s, slow = (STRIBECK[n] for n in ("mu_k", "static_excess", "stribeck_velocity"))
    truth = trajectory(
        "linear", STRIBECK, TIMES, lambda v, sign: mu * (1 + s * math.exp(-((v / slow) ** 2))) * sign,
        grip=mu * (1 + s),
    )  # fmt: skip
    assert np.max(np.abs(solved(solver_of(("stribeck",)), STRIBECK).y - truth[:, 0])) < 1e-7


def test_static_friction_holds_a_body_up_to_its_limit() -> None:
    """Stribeck: a pull of 0.4 against (1 + s) μ_k of 0.54 and 0.3. Friction that depends on the position: a pull of 0.6
    against 0.63 and 0.57."""
    position = {**BASE, "mu_p": 0.6, "friction_slope": -0.5, "reference_amplitude": 0.3}
    for term, p, moves in (
        ("stribeck", {**STRIBECK, "static_excess": 0.8, "theta0": 0.05 + 0.4 / 20.0}, False),
        ("stribeck", {**STRIBECK, "static_excess": 0.0, "theta0": 0.05 + 0.4 / 20.0}, True),
        ("dry_position", {**position, "theta0": 0.05 - 0.03}, False),
        ("dry_position", {**position, "theta0": 0.05 + 0.03}, True),
    ):
        assert bool(np.ptp(solved(solver_of((term,)), p).y) > 1e-3) is moves


@pytest.mark.parametrize("terms", [("viscous", "coulomb"), ("viscous", "stribeck")])
def test_tangents_are_central_differences(terms: tuple[str, ...]) -> None:
    """By every parameter and knot, except at samples within 2 ms of a turning point."""
    p = {**BASE, **STRIBECK, "zeta": 0.05, "mu_k": 0.1, "mu_c": 0.15, "omega0": 0.2}
    solver = solver_of(terms)
    values = np.array([p[name] for name in solver.names])
    motion = solved(solver, p, G, H, ALL)
    turns = motion.times[:-1][np.diff(motion.times) == 0]
    apart = np.min(np.abs(TIMES[:, None] - turns), axis=1) > 2e-3
    assert turns.size > 8
    for i in range(values.size + G.size + H.size):
        difference = central_difference(solver, values, i, 1e-5, 1e-13)
        error = np.abs(motion.tangents[:, i] - difference) / np.max(np.abs(difference))
        assert np.max(error[apart]) < 5e-6


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_means_over_windows_are_those_of_the_samples(quantity: str) -> None:
    """Windows of 12 samples, in which friction may change its sign. Control: the middle of the window."""
    long, order = 2 * math.pi / W / 32, QUANTITIES.index(quantity)
    times = np.linspace(0.0, 9.9 - long, 200)[:, None] + long * np.linspace(0, 1, 12)
    solver = Solver(("coulomb",), "linear", times.mean(axis=1), quantity, 0.3, W, 0.0, KNOTS, times)
    p = {**BASE, "omega0": 1.3}
    truth = with_coulomb(p, times.ravel())[:, order].reshape(times.shape)
    motion = solved(solver, p)
    assert np.max(np.abs(motion.y - truth.mean(axis=1))) < 5e-8 * W**order
    assert np.max(np.abs(motion.y - truth[:, 5:7].mean(axis=1))) > 1e-4
    each = solved(solver.at(times.ravel(), quantity), p).tangents
    assert motion.tangents == pytest.approx(each.reshape(*times.shape, -1).mean(axis=1), rel=1e-8)
