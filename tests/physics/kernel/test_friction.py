"""Exact dry friction (ε = 0) in kernels: the sign itself, with sticking, against closed forms and SciPy's solver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.draws import turning_amplitudes
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS, QUANTITIES, Windows
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


@pytest.mark.parametrize("case", CASES)
def test_closed_form(case: str) -> None:
    """No sample lies on a turning point, where the acceleration jumps."""
    p = {**BASE, **CASES[case]}
    truth = with_coulomb(p, TIMES)
    for order, quantity in enumerate(QUANTITIES):
        found = solved(solver_of(quantity=quantity), p, tangents=NONE).y
        assert np.max(np.abs(found - truth[:, order])) < LIMITS[order] * 0.3 * W**order


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


@pytest.mark.parametrize(
    ("damping", "law", "changed"),
    [
        (("viscous", "coulomb"), "pendulum", {"mu_c": 0.5}),
        (("viscous", "coulomb", "quadratic"), "horizontal_pendulum", {"mu_c": 0.2, "omega0": 0.8}),
    ],
)
def test_sums_against_an_independent_solver(damping, law, changed) -> None:  # type: ignore[no-untyped-def]
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


@pytest.mark.parametrize(("excess", "moves"), [(0.8, False), (0.0, True)])
def test_static_friction_holds_more_than_kinetic(excess: float, moves: bool) -> None:
    """Between μ_k and (1 + s) μ_k."""
    p = {**STRIBECK, "static_excess": excess, "theta0": 0.05 + 0.4 / 20.0}
    assert bool(np.ptp(solved(solver_of(("stribeck",)), p).y) > 1e-3) is moves


@pytest.mark.parametrize(("u", "moves"), [(0.1, True), (-0.1, False)])
def test_friction_that_depends_on_the_position_holds_where_it_is_larger(u: float, moves: bool) -> None:
    """μ_p (1 + s u), u the displacement over 0.3: 0.57 and 0.63, and a pull of 0.6 at either."""
    p = {**BASE, "mu_p": 0.6, "friction_slope": -0.5, "reference_amplitude": 0.3, "theta0": 0.05 + 0.3 * u}
    assert bool(np.ptp(solved(solver_of(("dry_position",)), p).y) > 0) is moves


@pytest.mark.parametrize("case", ["pushed outwards", "from below", "stops early", "no friction"])
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


@pytest.mark.parametrize("terms", [("viscous", "coulomb"), ("viscous", "stribeck")])
@pytest.mark.parametrize("order", [0, 1])
def test_tangents_are_central_differences(terms: tuple[str, ...], order: int) -> None:
    """By every parameter and knot, but at samples that a turning point passes between the two motions. The control:
    there those of the velocity jump."""
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


@pytest.mark.parametrize("theta0", [0.35, -0.25])
def test_tangents_of_a_start_at_rest_are_those_of_the_motion_that_follows(theta0: float) -> None:
    """By the start's velocity there are two, by its sign: the one towards rest is taken, and differs from the other."""
    p = {**BASE, "theta0": theta0}
    made, d = solver_of(), 1e-6
    tangents = solved(made, p).tangents
    inwards = -math.copysign(d, theta0 - p["rest_angle"])
    plain = with_coulomb(p, TIMES)[:, 0]
    one, other = (
        (with_coulomb({**p, "omega0": s * inwards}, TIMES)[:, 0] - plain) / (s * inwards) for s in (1, -1)
    )
    assert np.max(np.abs(tangents[:, made.names.index("omega0")] - one)) < 1e-5 * np.max(np.abs(one))
    assert np.max(np.abs(one - other)) > 0.01 * np.max(np.abs(one))
    up, down = (with_coulomb({**p, "theta0": theta0 + s * d}, TIMES)[:, 0] for s in (1, -1))
    assert np.max(np.abs(tangents[:, made.names.index("theta0")] - (up - down) / (2 * d))) < 1e-5


def test_a_body_that_is_held_stays_and_depends_on_its_start_alone() -> None:
    motion = solved(solver_of(), {**BASE, "theta0": 0.06}, tangents=ALL)
    assert np.all(motion.y == 0.06)
    wanted = np.zeros(motion.tangents.shape)
    wanted[:, solver_of().names.index("theta0")] = 1.0
    assert np.all(motion.tangents == wanted)


def test_a_deviation_releases_a_body_that_is_held() -> None:
    """The pull grows by 2 h: it reaches the friction at a time in closed form, and from there on the motion is SciPy's.
    The control: with half the deviation it never does."""
    p = {**BASE, "mu_c": 0.3, "theta0": 0.05 + 0.28 / 20.0}
    h = np.array([0.0, 0.0, 0.2, 0.2, 0.2])
    made = solver_of()
    motion = solved(made, p, 0 * h, h, ALL)
    growth = 0.5 * (0.3 / 0.28 - 1)
    free = KNOTS[1] + growth / 0.2 * (KNOTS[2] - KNOTS[1])
    inside = TIMES[(free < TIMES) & (free + 0.5 > TIMES)]

    def slope(t: float, y: np.ndarray) -> list[float]:
        return [y[1], 0.3 - (1 + 2 * np.interp(t, KNOTS, h)) * 20.0 * (y[0] - 0.05)]

    truth = solve_ivp(
        slope, (free, inside[-1]), (p["theta0"], 0.0), "DOP853", inside, rtol=1e-12, atol=1e-14, max_step=0.01
    ).y[0]
    assert np.all(truth <= p["theta0"])
    assert np.all(motion.y[free > TIMES] == p["theta0"])
    assert np.max(np.abs(motion.y[np.isin(TIMES, inside)] - truth)) < 1e-9
    assert np.all(solved(made, p, 0 * h, 0.15 * h).y == p["theta0"])
    d, k = 1e-6, made.names.index("stiffness")
    up, down = (
        solved(made, {**p, "stiffness": 20.0 + s * d}, 0 * h, h, NONE, tolerance=1e-13).y for s in (1, -1)
    )
    assert (
        np.max(np.abs(motion.tangents[:, k] - (up - down) / (2 * d))) < 1e-4 * np.max(np.abs(up - down)) / d
    )


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


def test_turning_amplitudes_count_each_turning_point_once() -> None:
    _, sizes = turning_amplitudes(solved(solver_of(), BASE, tangents=NONE))
    lost = BASE["mu_c"] / BASE["stiffness"]
    wanted = 0.3 - lost * np.arange(1, 21, 2)
    assert sizes == pytest.approx(wanted[: sizes.size], abs=1e-3 * lost)
    assert sizes.size == 10


def test_works_are_those_of_the_sign() -> None:
    """Coulomb's over a path is its length, and structural damping's half the square of the displacement."""
    made = solver_of(("coulomb", "structural"))
    x = np.concatenate([np.linspace(0.3, -0.3, 2001), np.linspace(-0.3, 0.3, 2001)])
    v, on = np.repeat([-1e-9, 1e-9], 2001), np.ones(2, bool)
    found = made.works(x, v, np.gradient(x), np.zeros((1, 1)), on)[0]
    assert found == pytest.approx([1.2, 0.18], rel=2e-3)
    assert made.works(x, v, np.gradient(x), np.zeros((1, 1)), on, 1e-3)[0, 0] < 1e-3  # control


@pytest.mark.parametrize("terms", [("coulomb", "power"), ("power",)])
def test_what_is_rounded_off_stays_so(terms: tuple[str, ...]) -> None:
    """The square root of the velocity, steep at rest, holds no body: beside exact friction and alone."""
    p = {**BASE, "c_power": 0.1, "exponent": 0.5, "reference_velocity": 1.3, "omega0": 0.2}
    p["mu_c"] *= "coulomb" in terms
    motion = solved(solver_of(terms), p, tangents=PARAMETERS)

    def force(v: float, sign: float) -> float:
        return p["mu_c"] * sign + 0.1 * math.sqrt(1.3 * abs(v)) * math.copysign(1.0, v)

    assert np.max(np.abs(motion.y - trajectory("linear", p, TIMES, force)[:, 0])) < 1e-4
    assert np.all(np.isfinite(motion.tangents))
