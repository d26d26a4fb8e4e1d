"""Kernels against SciPy's solver of order eight, closed forms, and central differences."""

from __future__ import annotations

import math
import os
import signal
import time
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
"""Error of a motion over its first amplitude: steps of 3e-8 of it, and some sixty in each of the six cycles."""
FINE, USED = (1e-5, 1e-5, 1e-3), (5e-4, 5e-4, 2e-2)
"""Errors of tangents of displacement, velocity and acceleration over their largest value, at steps' errors of 1e-12 and
as used. The dense output is of the fifth degree, its second derivative of the third."""


def solver_of(law: str, quantity: str = "angle", **changed: float) -> tuple[Solver, np.ndarray]:
    """The solver of a law with the paper's terms, and its parameters."""
    p = {**PAPER, **LAWS[law], **changed}
    made = Solver(PAPER_TERMS, law, TIMES, quantity, abs(p["theta0"]), math.sqrt(20.0), p["epsilon"], KNOTS)
    return made, np.array([p[name] for name in made.names])


def independent(law: str) -> np.ndarray:
    """θ, θ̇, θ̈ at the times, (n, 3), piece by piece between the knots, with the deviations G and H."""
    p = {**PAPER, **LAWS[law]}
    spring, damp = restoring(law, p), drag(p)

    def slope(t: float, y: np.ndarray) -> list[float]:
        a = (1 + np.interp(t, KNOTS, G)) * damp(y[1], 0.0)
        return [y[1], -a - (1 + 2 * np.interp(t, KNOTS, H)) * spring(y[0])]

    state, found = np.array([p["theta0"], p["omega0"]]), []
    for first, last in pairwise(KNOTS):
        inside = TIMES[(first <= TIMES) & ((last > TIMES) | (last == END))]
        run = solve_ivp(
            slope, (first, last), state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.1,
            t_eval=np.append(inside[inside < last], last),
        )  # fmt: skip
        state = run.y[:, -1]
        kept = run.y.T[: inside.size]
        found += [[*y, slope(t, y)[1]] for t, y in zip(inside, kept)]
    return np.array(found)


def test_a_signal_during_an_integration_interrupts_it() -> None:
    """In the middle of 20,000 cycles; Numba would report a SystemError, which does not stop a run."""
    t = np.linspace(0.0, 3e4, 10)
    solver = Solver(("viscous",), "linear", t, "angle", 0.3, 5.0, 0.0, t[[0, -1]])
    with kill_as_interrupt():
        Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM)).start()
        with pytest.raises(KeyboardInterrupt):
            time.sleep(
                solved(solver, np.array([1e-4, 25.0, 0.0, 0.3, 0.0])).times.size
            )  # if it ends too early


def solved(made: Solver, p: np.ndarray, *args: object, **kwargs: object) -> Motion:
    return made.solve(p, np.ones(len(made.terms), bool), *args, **kwargs)


@pytest.mark.parametrize("law", LAWS)
def test_motion_is_that_of_another_solver(law: str) -> None:
    """Displacement, velocity and acceleration; each over the scale of its own. The control: without deviations."""
    truth = independent(law)
    for order, quantity in enumerate(QUANTITIES):
        made, p = solver_of(law, quantity)
        found = solved(made, p, G, H, tangents=NONE).y
        error = np.max(np.abs(found - truth[:, order])) / (made.amplitude * made.frequency**order)
        assert error < (LIMIT, 5 * LIMIT, 50 * LIMIT)[order]
        assert np.max(np.abs(solved(made, p, tangents=NONE).y - truth[:, order])) > 1e-3


def central_difference(
    made: Solver,
    p: np.ndarray,
    i: int,
    step: float,
    tolerance: float,
    deviations: tuple[np.ndarray, ...] = (G, H),
) -> np.ndarray:
    """Return the derivative of a motion by the i-th of its parameters and deviations, at this error of steps."""
    ends = []
    for sign in (1.0, -1.0):
        given = np.concatenate([p, *deviations])
        given[i] += sign * step
        split = np.split(given, [p.size, p.size + G.size])
        ends.append(solved(made, *split, tangents=NONE, tolerance=tolerance).y)
    return (ends[0] - ends[1]) / (2 * step)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_tangents_are_central_differences(law: str, order: int) -> None:
    """By every parameter and every knot of g and h.

    Differences of motions at a step's error of 1e-12, over 1e-4 of a parameter: their own error is 1e-6. The tangents
    at that error are the differences; those as used are nearly.
    """
    made, p = solver_of(law, QUANTITIES[order])
    used, fine = (solved(made, p, G, H, ALL, **how).tangents for how in ({}, {"tolerance": 1e-12}))
    sizes = np.concatenate([np.maximum(np.abs(p), 0.1), np.ones(2 * KNOTS.size)])
    for i, size in enumerate(sizes):
        difference = central_difference(made, p, i, 1e-4 * size, 1e-12)
        scale = np.max(np.abs(difference))
        assert np.max(np.abs(fine[:, i] - difference)) < FINE[order] * scale
        assert np.max(np.abs(used[:, i] - difference)) < USED[order] * scale


def test_a_term_that_is_switched_off_does_nothing() -> None:
    """As with a coefficient of zero, but that no step ends where the friction would turn over."""
    made, p = solver_of("linear")
    off = made.solve(p, np.array([True, False, True]), tangents=PARAMETERS, tolerance=1e-12)
    absent, q = solver_of("linear", mu_c=0.0)
    assert off.y == pytest.approx(solved(absent, q, tolerance=1e-12).y, abs=1e-10)
    assert np.all(off.tangents[:, made.names.index("mu_c")] == 0)
    assert np.max(np.abs(off.y - solved(made, p).y)) > 1e-3  # control


@pytest.mark.parametrize("theta0", [0.6, 30.0])
def test_an_escaping_motion_is_none(theta0: float) -> None:
    """Beyond √(k/−β) = 0.577 from its rest a softening spring pushes outwards."""
    made, p = solver_of("duffing", theta0=theta0)
    assert made.solve(p, np.ones(3, bool), tangents=ALL) is None
    assert made.solve(p, np.ones(3, bool), tangents=NONE) is None


FACTOR = 2.0


class Foreign(DampingTerm):
    """A user's term whose kernel uses a name of its own module."""

    name, parameter, unit = "foreign", "c_foreign", "1/s"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        return FACTOR * v


def test_a_users_term_that_cannot_be_compiled() -> None:
    TERMS.add("foreign", Foreign())
    try:
        made = Solver(("foreign",), "linear", TIMES, "angle", 0.3, math.sqrt(20.0), 0.1, KNOTS)
        with pytest.raises(Refusal, match="uses 'FACTOR'; it may only use"):
            made.solve(np.array([0.8, 20.0, 0.0, 0.3, 0.0]), np.ones(1, bool))
    finally:
        TERMS.remove("foreign")


SHARP = 0.002
"""Width of friction's turning over, as a share of the peak velocity, that a long step jumps."""


def rubbing(epsilon: float, changed: float = 0.0, tolerance: float = 1e-6) -> np.ndarray:
    """Displacements, (n,), under friction that turns over within epsilon, the start's velocity changed by so much."""
    made, p = solver_of("linear", epsilon=epsilon)
    p[list(made.names).index("omega0")] += changed
    return solved(made, p, tangents=NONE, tolerance=tolerance).y


def test_friction_that_turns_over_at_once_is_stepped_to_its_edges() -> None:
    """Errors of steps of 1e-6 of the amplitude are about those with smooth friction, and follow parameters smoothly:
    with second differences of 9e-8. Steps that are blind to the edges have errors of 1e-3 and second differences of
    4e-4 (measured)."""
    osc, _ = solver_of("linear")
    epsilon, size = SHARP * osc.amplitude * osc.frequency, osc.amplitude
    truth = rubbing(epsilon, tolerance=1e-12)
    smooth = 50 * epsilon
    wide = np.max(np.abs(rubbing(smooth) - rubbing(smooth, tolerance=1e-12))) / size
    assert np.max(np.abs(rubbing(epsilon) - truth)) / size < 3 * wide
    changes = 1e-5 * size * osc.frequency * np.arange(9)
    errors = np.array([rubbing(epsilon, c) - rubbing(epsilon, c, 1e-12) for c in changes]) / size
    assert np.max(np.abs(np.diff(errors, 2, axis=0))) < 1e-6
