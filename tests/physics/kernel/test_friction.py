"""Exact dry friction (ε = 0) in kernels: the sign itself, with sticking, against closed forms and SciPy's solver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE, QUANTITIES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
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
"""Errors of displacement, velocity and acceleration, over the scale of each."""


def solver_of(terms: tuple[str, ...] = ("coulomb",), quantity: str = "angle") -> Solver:
    return Solver(terms, "linear", TIMES, quantity, 0.3, W, 0.0, KNOTS)


def solved(made: Solver, p: dict[str, float], *args: object, **kwargs: object) -> Motion:
    values = np.array([{"rest": p["rest_angle"], **p}.get(name, 0.0) for name in made.names])
    return made.solve(values, np.ones(len(made.terms), bool), *args, **kwargs)


@pytest.mark.parametrize("case", CASES)
def test_closed_form(case: str) -> None:
    """No sample lies on a turning point, where the acceleration jumps."""
    p = {**BASE, **CASES[case]}
    truth = with_coulomb(p, TIMES)
    for order, quantity in enumerate(QUANTITIES):
        found = solved(solver_of(quantity=quantity), p, tangents=NONE).y
        assert np.max(np.abs(found - truth[:, order])) < LIMITS[order] * 0.3 * W**order


@pytest.mark.parametrize(
    ("damping", "law", "changed"),
    [
        (("viscous", "coulomb"), "pendulum", {"mu_c": 0.5}),
        (("viscous", "coulomb", "quadratic"), "horizontal_pendulum", {"mu_c": 0.2, "omega0": 0.8}),
    ],
)
def test_sums_against_an_independent_solver(damping, law, changed) -> None:
    """Simulated, to the error that is asked for."""
    osc = Oscillator(damping, law)
    coefficients = {n: v for n, v in {"zeta": 0.05, "mu_q": 0.05}.items() if n in osc.parameters}
    p = {**coefficients, **LAWS[law], "epsilon": 0.0, **changed}
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


def test_static_friction_holds_up_to_its_own_size() -> None:
    """A pull between μ_k and (1 + s) μ_k; and μ_p (1 + s u), u the displacement over 0.3, of 0.57 and 0.63 against a
    pull of 0.6."""
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
    """By every parameter and knot, but at samples that a turning point passes between the two motions."""
    p = {**BASE, **STRIBECK, "zeta": 0.05, "mu_k": 0.1, "mu_c": 0.15, "omega0": 0.2}
    made = solver_of(terms)
    values = np.array([p[name] for name in made.names])
    motion = solved(made, p, G, H, ALL)
    turns = motion.times[:-1][np.diff(motion.times) == 0]
    apart = np.min(np.abs(TIMES[:, None] - turns), axis=1) > 2e-3
    assert turns.size > 8
    for i in range(values.size + G.size + H.size):
        difference = central_difference(made, values, i, 1e-5, 1e-13)
        error = np.abs(motion.tangents[:, i] - difference) / np.max(np.abs(difference))
        assert np.max(error[apart]) < 5e-6


def test_a_deviation_releases_a_body_that_is_held() -> None:
    """The pull grows by 2 h: it reaches the friction at a time in closed form, and from there on the motion is SciPy's.
    The control: with half the deviation it never does."""
    p = {**BASE, "mu_c": 0.3, "theta0": 0.05 + 0.28 / 20.0}
    h = np.array([0.0, 0.0, 0.2, 0.2, 0.2])
    made = solver_of()
    motion = solved(made, p, 0 * h, h)
    growth = 0.5 * (0.3 / 0.28 - 1)
    free = KNOTS[1] + growth / 0.2 * (KNOTS[2] - KNOTS[1])
    inside = TIMES[(free < TIMES) & (free + 0.5 > TIMES)]

    def slope(t: float, y: np.ndarray) -> list[float]:
        return [y[1], 0.3 - (1 + 2 * np.interp(t, KNOTS, h)) * 20.0 * (y[0] - 0.05)]

    fine = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.01}
    truth = solve_ivp(slope, (free, inside[-1]), (p["theta0"], 0.0), "DOP853", inside, **fine).y[0]
    assert np.all(truth <= p["theta0"])
    assert np.all(motion.y[free > TIMES] == p["theta0"])
    assert np.max(np.abs(motion.y[np.isin(TIMES, inside)] - truth)) < 1e-9
    assert np.all(solved(made, p, 0 * h, 0.15 * h).y == p["theta0"])


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_means_over_windows(quantity: str) -> None:
    """Means of the motion and of its tangents over windows of 12 samples, in which friction may change its sign."""
    long, order = 2 * math.pi / W / 32, QUANTITIES.index(quantity)
    times = np.linspace(0.0, 9.9 - long, 200)[:, None] + long * np.linspace(0, 1, 12)
    made = Solver(("coulomb",), "linear", times.mean(axis=1), quantity, 0.3, W, 0.0, KNOTS, times)
    p = {**BASE, "omega0": 1.3}
    truth = with_coulomb(p, times.ravel())[:, order].reshape(times.shape)
    motion = solved(made, p)
    assert np.max(np.abs(motion.y - truth.mean(axis=1))) < 5e-8 * W**order
    assert np.max(np.abs(motion.y - truth[:, 5:7].mean(axis=1))) > 1e-4  # control: the middle of the window
    each = solved(made.at(times.ravel(), quantity), p).tangents
    assert motion.tangents == pytest.approx(each.reshape(*times.shape, -1).mean(axis=1), rel=1e-8)
