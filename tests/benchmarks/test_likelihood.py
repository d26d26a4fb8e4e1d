"""One likelihood of 1,001 samples beside SciPy's odeint. All trajectories are within 1e-6 rad of an independent one."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import odeint

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE
from tests.benchmarks.page import add_table
from tests.benchmarks.timing import in_turns
from tests.physics.independent import LAWS, PAPER, trajectory

MODELS = ("viscous", "coulomb", "quadratic")
LAW, NOISE = "horizontal_pendulum", 0.003
TIMES = np.linspace(0.0, 10.0, 1001)
ERROR = 1e-6
"""rad"""
TOLERANCES = 10.0 ** np.arange(-5.0, -12.0, -0.25)
"""Of these the largest one is used for which the error is small enough."""
BAR = 15.0
"""odeint's time over that of the compiled solver."""

Solve = Callable[[float], np.ndarray]


def scipy_solver(model: str, p: Mapping[str, float]) -> Solve:
    """Return the function from a tolerance to angles (n,), with the equation written as for odeint."""
    k, g, spring_angle, eps = p["stiffness"], p["gravity"], p["spring_angle"], p["epsilon"]
    c, tanh, cos = p[TERMS.get(model).parameter], math.tanh, math.cos
    slope = {
        "viscous": lambda y, t: (y[1], -2 * c * y[1] - k * (y[0] - spring_angle) + g * cos(y[0])),
        "coulomb": lambda y, t: (y[1], -c * tanh(y[1] / eps) - k * (y[0] - spring_angle) + g * cos(y[0])),
        "quadratic": lambda y, t: (y[1], -c * y[1] * abs(y[1]) - k * (y[0] - spring_angle) + g * cos(y[0])),
    }[model]
    start = p["theta0"], p["omega0"]
    return lambda tolerance: odeint(slope, start, TIMES, rtol=tolerance, atol=tolerance)[:, 0]


def compiled_solver(model: str, p: Mapping[str, float]) -> Solve:
    """Return the function from a tolerance to angles (n,), by the compiled solver of bayesdamp."""
    scales = abs(p["theta0"]), float(np.sqrt(p["stiffness"]))
    solver = Solver((model,), LAW, TIMES, "angle", *scales, p["epsilon"], TIMES[[0, -1]])
    values, active = np.array([p[name] for name in solver.names]), np.ones(1, bool)
    return lambda tolerance: solver.solve(values, active, tangents=NONE, tolerance=tolerance).y


def measured_times(model: str) -> list[float]:
    """Return the CPU seconds of a sum of squares by odeint and by the compiled solver."""
    name = TERMS.get(model).parameter
    p = {name: PAPER[name], **LAWS[LAW]}
    truth = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    y = truth + NOISE * np.random.default_rng(1).standard_normal(TIMES.size)

    def sum_of_squares(solve: Solve) -> Callable[[], float]:
        tolerance = next(x for x in TOLERANCES if np.abs(solve(float(x)) - truth).max() <= ERROR)
        return lambda: np.sum(((y - solve(tolerance)) / NOISE) ** 2)

    return in_turns(*map(sum_of_squares, (scipy_solver(model, p), compiled_solver(model, p))), rounds=7)


def test_likelihoods_within_the_same_error() -> None:
    times = {model: measured_times(model) for model in MODELS}
    ratios = {
        f"compiled likelihood, {model}: odeint / ours": slow / fast for model, (slow, fast) in times.items()
    }
    rows = [[model, *(f"{1e6 * t:.0f}" for t in each)] for model, each in times.items()]
    title = f"One likelihood of 1,001 samples, within {ERROR:g} rad"
    add_table(title, ["model", "odeint, µs", "compiled solver, µs"], rows, ratios, dict.fromkeys(ratios, BAR))
