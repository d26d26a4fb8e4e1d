"""One likelihood of 1,001 samples against odeint, solve_ivp and diffrax, by the compiled motion alone and as a log
posterior of scores; the gradient, and 1,000 s."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import odeint, solve_ivp

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.timing import in_turns, table
from tests.physics.independent import LAWS, PAPER, trajectory

MODELS = ("viscous", "coulomb", "quadratic")
LAW, NOISE = "horizontal_pendulum", 0.003
TIMES = np.linspace(0.0, 10.0, 1001)
ERROR = 1e-6
"""rad"""
TOLERANCES = 10.0 ** np.arange(-5.0, -12.0, -0.25)
SOLVERS = ("odeint", "solve_ivp", "diffrax Tsit5")
BARS = {"odeint": 15.0, "diffrax Tsit5": 3.0}
"""At least, of one likelihood."""
GRADIENT, LONG = 2.5, 5.0
"""At most, of one likelihood; at least, against odeint's."""

Solve = Callable[[float], Any]


def slope_of(model: str, p: Mapping[str, float]) -> Callable[..., tuple[float, float]]:
    """The equation on plain floats, as one writes it for odeint."""
    k, g, s, eps = p["stiffness"], p["gravity"], p["spring_angle"], p["epsilon"]
    c = p[TERMS.get(model).parameter]
    tanh, cos = math.tanh, math.cos
    return {
        "viscous": lambda y, t: (y[1], -2 * c * y[1] - k * (y[0] - s) + g * cos(y[0])),
        "coulomb": lambda y, t: (y[1], -c * tanh(y[1] / eps) - k * (y[0] - s) + g * cos(y[0])),
        "quadratic": lambda y, t: (y[1], -c * y[1] * abs(y[1]) - k * (y[0] - s) + g * cos(y[0])),
    }[model]


def diffrax_solver(model: str, times: np.ndarray) -> Callable[[float, Mapping[str, Any]], jax.Array]:
    """Tolerance and parameters to angles by a method of diffrax's (that of Tsitouras), compiled once for all."""
    diffrax = pytest.importorskip("diffrax")
    name = TERMS.get(model).parameter

    def field(t: Any, y: Any, p: Any) -> Any:
        c, v = p[name], y[1]
        drag = {
            "viscous": lambda: 2 * c * v,
            "coulomb": lambda: c * jnp.tanh(v / p["epsilon"]),
            "quadratic": lambda: c * v * jnp.abs(v),
        }[model]()
        return v, -drag - p["stiffness"] * (y[0] - p["spring_angle"]) + p["gravity"] * jnp.cos(y[0])

    @jax.jit
    def solve(tolerance: Any, p: Any) -> jax.Array:
        return diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Tsit5(),
            t0=0.0,
            t1=float(times[-1]),
            dt0=0.01,
            y0=(jnp.asarray(p["theta0"]), jnp.asarray(p["omega0"])),
            args=p,
            saveat=diffrax.SaveAt(ts=jnp.asarray(times)),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            max_steps=100_000,
            throw=False,  # where a sampler tries a motion that needs more steps, its density is 0
            adjoint=diffrax.ForwardMode(),
        ).ys[0]

    return solve


def loosest(solve: Solve, truth: np.ndarray) -> tuple[float, float]:
    """The loosest tolerance, in quarter decades, with which a solver keeps to the error, and its error there."""
    for tolerance in TOLERANCES:
        error = float(np.max(np.abs(np.asarray(solve(tolerance)) - truth)))
        if error <= ERROR:
            return float(tolerance), error
    raise AssertionError("no tolerance keeps to the error")


def solver_of(terms: tuple[str, ...], t: np.ndarray, p: Mapping[str, float]) -> tuple[Solver, np.ndarray]:
    scales = abs(p["theta0"]), float(np.sqrt(p["stiffness"]))
    solver = Solver(terms, LAW, t, "angle", *scales, p["epsilon"], t[[0, -1]])
    return solver, np.array([p[name] for name in solver.names])


def others_of(model: str, p: Mapping[str, float], times: np.ndarray) -> dict[str, Solve]:
    slope, start = slope_of(model, p), (p["theta0"], p["omega0"])
    return {
        "odeint": lambda tol: odeint(slope, start, times, rtol=tol, atol=tol, mxstep=100_000)[:, 0],
        "solve_ivp": lambda tol: solve_ivp(
            lambda t, s: slope(s, t), (0.0, times[-1]), start, "DOP853", times, rtol=tol, atol=tol
        ).y[0],
    }


def posterior_of(model: str, p: Mapping[str, float], y: np.ndarray) -> Target:
    """The posterior of a record of known noise: its coefficient, stiffness and start."""
    priors: dict[str, Prior] = {
        TERMS.get(model).parameter: HalfNormal(scale=0.45),
        "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6),
        "omega0": Normal(mean=0.0, sd=2.7),
    }
    known = {n: v for n, v in p.items() if n not in priors} | {"noise_sd": NOISE}
    return Target(Signal(TIMES, y), Oscillator((model,), LAW), "gaussian", priors, known)


@lru_cache
def measured(model: str) -> dict[str, float]:
    """CPU seconds of one likelihood of each, and the largest errors of the trajectory (rad)."""
    p = {TERMS.get(model).parameter: PAPER[TERMS.get(model).parameter], **LAWS[LAW]}
    truth = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    y = truth + NOISE * np.random.default_rng(1).standard_normal(TIMES.size)
    solver, values = solver_of((model,), TIMES, p)
    active = np.ones(1, bool)

    def ours(tolerance: float) -> np.ndarray:
        motion = solver.solve(values, active, tangents=NONE, tolerance=tolerance)
        assert motion is not None
        return motion.y

    solvers: dict[str, Solve] = {"ours": ours, **others_of(model, p, TIMES)}
    if find_spec("diffrax"):
        theirs = diffrax_solver(model, TIMES)
        solvers["diffrax Tsit5"] = lambda tol: np.asarray(theirs(tol, p))
    found, runs = {}, {}
    for name, solve in solvers.items():
        tolerance, found[f"{name} error"] = loosest(solve, truth)

        def run(solve: Solve = solve, tolerance: float = tolerance) -> float:
            r = (y - solve(tolerance)) / NOISE
            return float(-0.5 * r @ r)

        runs[name] = run
    target = posterior_of(model, p, y)
    z = target.scores(p)
    likelihood = Likelihood.near(target, z, ERROR)
    found["posterior error"] = float(np.max(np.abs(likelihood.motion(z) - truth)))
    runs["posterior"] = lambda: likelihood.log_posterior(z)
    return found | dict(zip(runs, in_turns(*runs.values(), rounds=7), strict=True))


@lru_cache
def gradient() -> dict[str, float]:
    """CPU seconds of a likelihood under all three terms, and of one with its slopes by seven parameters."""
    terms = ("viscous", "coulomb", "quadratic")
    p = {**{TERMS.get(t).parameter: PAPER[TERMS.get(t).parameter] for t in terms}, **LAWS[LAW]}
    solver, values = solver_of(terms, TIMES, p)
    y = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    active, free = np.ones(3, bool), [n for n in solver.names if n != "spring_angle"]
    places = [solver.names.index(n) for n in free]

    def one() -> float:
        motion = solver.solve(values, active, tangents=NONE, tolerance=1e-7)
        assert motion is not None
        return float(np.sum((y - motion.y) ** 2))

    def both() -> np.ndarray:
        motion = solver.solve(values, active, tangents=PARAMETERS, tolerance=1e-7)
        assert motion is not None
        return ((y - motion.y) @ motion.tangents)[places]

    times = in_turns(one, both, rounds=7)
    return {"one": times[0], "with gradient": times[1], "parameters": float(len(places))}


@lru_cache
def long() -> dict[str, float]:
    """1,000 s in 100,001 samples, after a tenth of which the motion is over."""
    times = np.linspace(0.0, 1000.0, 100_001)
    p = {"zeta": PAPER["zeta"], **LAWS[LAW]}
    solver, values = solver_of(("viscous",), times, p)
    their = others_of("viscous", p, times)["odeint"]
    close = replace(solver).solve(values, np.ones(1, bool), tangents=NONE, tolerance=1e-13)
    assert close is not None

    def ours(tolerance: float) -> np.ndarray:
        motion = solver.solve(values, np.ones(1, bool), tangents=NONE, tolerance=tolerance)
        assert motion is not None
        return motion.y

    found: dict[str, float] = {}
    runs = []
    for name, solve in (("ours", ours), ("odeint", their)):
        tolerance, found[f"{name} error"] = loosest(solve, close.y)
        runs.append(lambda solve=solve, tolerance=tolerance: solve(tolerance))
    return found | dict(zip(("ours", "odeint"), in_turns(*runs, rounds=3), strict=True))


def growth() -> list[list[str]]:
    """CPU seconds of a likelihood against samples, cycles and terms."""
    rows = []
    for samples, cycles, terms in (
        (1_000, 7, 1), (10_000, 7, 1), (100_000, 7, 1), (1_000, 70, 1), (1_000, 700, 1), (1_000, 7, 3),
    ):  # fmt: skip
        names = ("viscous", "coulomb", "quadratic")[:terms]
        p = {**{TERMS.get(t).parameter: 0.003 for t in names}, **LAWS[LAW]}
        times = np.linspace(0.0, cycles * 2 * np.pi / np.sqrt(20.0), samples)
        solver, values = solver_of(names, times, p)
        (spent,) = in_turns(
            lambda s=solver, v=values, n=terms: s.solve(v, np.ones(n, bool), tangents=NONE, tolerance=1e-7),
            rounds=3,
        )
        rows.append([f"{samples:,}", str(cycles), str(terms), f"{1e6 * spent:.0f}"])
    return rows


def test_table() -> None:
    rows = []
    for model in MODELS:
        m = measured(model)
        for name in [n for n in SOLVERS if n in m]:
            ratio(f"compiled likelihood, {model}: {name} / ours", m[name] / m["ours"], BARS.get(name))
            ratio(f"log posterior, {model}: {name} / ours", m[name] / m["posterior"])
            rows.append(
                [
                    model, name,
                    *(c for n in (name, "ours", "posterior") for c in (f"{1e6 * m[n]:.0f}", f"{m[f'{n} error']:.1e}")),
                    *(f"{m[name] / m[n]:.1f}" for n in ("ours", "posterior")),
                ]
            )  # fmt: skip
    header = [
        "model", "solver", "µs", "error", "ours", "error", "log posterior", "error", "ratio", "of log posterior",
    ]  # fmt: skip
    table(f"One compiled likelihood of 1,001 samples, within {ERROR:g} rad", header, rows)
    g, far = gradient(), long()
    ratio("gradient by 7 parameters: 2.5 likelihoods / ours", GRADIENT * g["one"] / g["with gradient"], 1.0)
    ratio("1,000 s, 100,001 samples: odeint / ours", far["odeint"] / far["ours"], LONG)
    table(
        "A likelihood with its gradient, and 1,000 s in 100,001 samples",
        ["what", "µs", "beside", "µs", "ratio"],
        [
            ["likelihood with 7 slopes", f"{1e6 * g['with gradient']:.0f}", "likelihood", f"{1e6 * g['one']:.0f}",
             f"{g['with gradient'] / g['one']:.2f}"],
            ["1,000 s", f"{1e6 * far['ours']:.0f}", "odeint", f"{1e6 * far['odeint']:.0f}",
             f"{far['odeint'] / far['ours']:.1f}"],
        ],
    )  # fmt: skip
    table("Growth of one compiled likelihood", ["samples", "cycles", "terms", "µs"], growth())


def test_all_keep_to_the_error() -> None:
    for found in (*map(measured, MODELS), long()):
        assert max(v for k, v in found.items() if k.endswith("error")) <= ERROR
