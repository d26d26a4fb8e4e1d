"""Compiled solvers: motions against SciPy's eighth-order solver, tangents against central differences."""

import math
import os
import signal
import time
from functools import partial
from itertools import pairwise
from threading import Timer

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.machine import kill_as_interrupt
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, DampingTerm
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS, QUANTITIES
from bayesdamp.types import Refusal
from tests.physics.independent import LAWS, PAPER, drag, restoring

END = 8.0
TIMES = np.linspace(0.0, END, 321)
KNOTS = np.linspace(0.0, END, 5)
G = np.array([0.0, 0.3, -0.2, 0.1, 0.4])
H = np.array([0.01, -0.02, 0.015, 0.0, -0.01])
LIMIT = 2e-6
"""Error of a motion over its first amplitude, after about 360 steps with an error of 3e-8 each."""
FINE, USED = (1e-5, 1e-5, 1e-3), (5e-4, 5e-4, 2e-2)
"""Errors of tangents of displacement, velocity and acceleration over their largest value, with a step's error of 1e-12
and with the normal one. The interpolation is of the fifth degree, so its second derivative is of the third."""


def solver_of(law: str, quantity: str = "angle", **changed: float) -> tuple[Solver, np.ndarray]:
    """Return the solver of a law with the paper's terms, and the parameters."""
    p = {**PAPER, **LAWS[law], **changed}
    solver = Solver(PAPER_TERMS, law, TIMES, quantity, abs(p["theta0"]), math.sqrt(20.0), p["epsilon"], KNOTS)
    return solver, np.array([p[name] for name in solver.names])


def independent(law: str) -> np.ndarray:
    """Return θ, θ̇, θ̈ with the deviations G and H by SciPy, solved separately between the knots, (n, 3)."""
    p = {**PAPER, **LAWS[law]}
    spring, damp = restoring(law, p), drag(p)

    def slope(t: float, y: np.ndarray) -> list[float]:
        a = (1 + np.interp(t, KNOTS, G)) * damp(y[1], 0.0)
        return [y[1], -a - (1 + 2 * np.interp(t, KNOTS, H)) * spring(y[0])]

    state, rows = np.array([p["theta0"], p["omega0"]]), []
    for first, last in pairwise(KNOTS):
        inside = TIMES[(first <= TIMES) & ((last > TIMES) | (last == END))]
        run = solve_ivp(
            slope, (first, last), state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.1,
            t_eval=np.append(inside[inside < last], last),
        )  # fmt: skip
        state = run.y[:, -1]
        rows += [[*y, slope(t, y)[1]] for t, y in zip(inside, run.y.T[: inside.size])]
    return np.array(rows)


def test_a_signal_during_an_integration_interrupts_it() -> None:
    """In the middle of 20,000 cycles. Numba alone would raise a SystemError, which does not stop a run."""
    t = np.linspace(0.0, 3e4, 10)
    solver = Solver(("viscous",), "linear", t, "angle", 0.3, 5.0, 0.0, t[[0, -1]])
    p = np.array([1e-4, 25.0, 0.0, 0.3, 0.0])
    with kill_as_interrupt():
        Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM)).start()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(solved(solver, p).times.size)  # sleeps if it ends too early


def solved(solver: Solver, p: np.ndarray, *args: object, **kwargs: object) -> Motion:
    return solver.solve(p, np.ones(len(solver.terms), bool), *args, **kwargs)


@pytest.mark.parametrize("law", LAWS)
def test_motions_with_deviations_are_those_of_another_solver(law: str) -> None:
    """Displacement, velocity and acceleration. Control: without deviations."""
    truth = independent(law)
    for order, quantity in enumerate(QUANTITIES):
        solver, p = solver_of(law, quantity)
        y = solved(solver, p, G, H, tangents=NONE).y
        error = np.max(np.abs(y - truth[:, order])) / (solver.amplitude * solver.frequency**order)
        assert error < (LIMIT, 5 * LIMIT, 50 * LIMIT)[order]
        assert np.max(np.abs(solved(solver, p, tangents=NONE).y - truth[:, order])) > 1e-3


def central_difference(
    solver: Solver, p: np.ndarray, i: int, step: float, tolerance: float, deviations=(G, H)
) -> np.ndarray:
    """Return the derivative of a motion by the i-th of its parameters and deviations, from motions at a tolerance."""
    ends = []
    for sign in (1.0, -1.0):
        given = np.concatenate([p, *deviations])
        given[i] += sign * step
        split = np.split(given, [p.size, p.size + G.size])
        ends.append(solved(solver, *split, tangents=NONE, tolerance=tolerance).y)
    return (ends[0] - ends[1]) / (2 * step)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_tangents_are_central_differences(law: str, order: int) -> None:
    """By every parameter and every knot of g and h, with the normal tolerance and with a step's error of 1e-12.

    The differences have a relative error of 1e-6: the step's error is 1e-12, and the change of a parameter 1e-4.
    """
    solver, p = solver_of(law, QUANTITIES[order])
    used, fine = (solved(solver, p, G, H, ALL, **options).tangents for options in ({}, {"tolerance": 1e-12}))
    sizes = np.concatenate([np.maximum(np.abs(p), 0.1), np.ones(2 * KNOTS.size)])
    for i, size in enumerate(sizes):
        difference = central_difference(solver, p, i, 1e-4 * size, 1e-12)
        scale = np.max(np.abs(difference))
        assert np.max(np.abs(fine[:, i] - difference)) < FINE[order] * scale
        assert np.max(np.abs(used[:, i] - difference)) < USED[order] * scale


def test_a_term_that_is_switched_off_has_no_force() -> None:
    """As with a coefficient of 0. Control: with the term."""
    solver, p = solver_of("linear")
    off = solver.solve(p, np.array([True, False, True]), tangents=PARAMETERS, tolerance=1e-12)
    absent, q = solver_of("linear", mu_c=0.0)
    assert off.y == pytest.approx(solved(absent, q, tolerance=1e-12).y, abs=1e-10)
    assert np.all(off.tangents[:, solver.names.index("mu_c")] == 0)
    assert np.max(np.abs(off.y - solved(solver, p).y)) > 1e-3


@pytest.mark.parametrize("theta0", [0.6, 30.0])
def test_a_motion_that_escapes_has_no_solution(theta0: float) -> None:
    """A softening spring pushes outwards beyond √(k/−β) = 0.577 from rest."""
    solver, p = solver_of("duffing", theta0=theta0)
    assert solved(solver, p, tangents=ALL) is None
    assert solved(solver, p, tangents=NONE) is None


FACTOR = 2.0


class Foreign(DampingTerm):
    """A user's term whose kernel uses a name of its own module."""

    name, parameter, unit = "foreign", "c_foreign", "1/s"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        return FACTOR * v


class Partial(Foreign):
    """A user's term whose kernel has no source code of its own."""

    kernel = partial(lambda k, x, v, epsilon: k * v, 2.0)


@pytest.mark.parametrize(
    ("term", "message"),
    [(Foreign, "uses 'FACTOR'; it may only use"), (Partial, r"with `def` in a \.py file")],
)
def test_a_users_term_that_cannot_be_compiled_is_refused(term: type[DampingTerm], message: str) -> None:
    TERMS.add("foreign", term())
    try:
        solver = Solver(("foreign",), "linear", TIMES, "angle", 0.3, math.sqrt(20.0), 0.1, KNOTS)
        with pytest.raises(Refusal, match=message):
            solved(solver, np.array([0.8, 20.0, 0.0, 0.3, 0.0]))
    finally:
        TERMS.remove("foreign")


def rubbing(epsilon: float, change: float = 0.0, tolerance: float = 1e-6) -> np.ndarray:
    """Return displacements (n,) under friction of width epsilon, with a changed velocity at the start."""
    solver, p = solver_of("linear", epsilon=epsilon)
    p[list(solver.names).index("omega0")] += change
    return solved(solver, p, tangents=NONE, tolerance=tolerance).y


def test_steps_end_where_narrow_friction_changes_its_sign() -> None:
    """A width of 0.2 % of the peak velocity, which a long step would jump over.

    Errors are about those of a wide friction, and depend smoothly on parameters (second differences of 9e-8). Steps
    that ignore the width have errors of 1e-3 and second differences of 4e-4 (measured).
    """
    solver, _ = solver_of("linear")
    size, epsilon = solver.amplitude, 0.002 * solver.amplitude * solver.frequency
    wide = np.max(np.abs(rubbing(50 * epsilon) - rubbing(50 * epsilon, tolerance=1e-12)))
    assert np.max(np.abs(rubbing(epsilon) - rubbing(epsilon, tolerance=1e-12))) < 3 * wide
    changes = 1e-5 * size * solver.frequency * np.arange(9)
    errors = np.array([rubbing(epsilon, c) - rubbing(epsilon, c, 1e-12) for c in changes]) / size
    assert np.max(np.abs(np.diff(errors, 2, axis=0))) < 1e-6
