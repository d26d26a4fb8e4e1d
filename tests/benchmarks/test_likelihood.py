"""One likelihood of 1,001 samples against odeint, solve_ivp and diffrax, by the compiled motion alone and as a log
posterior of scores; the gradient, and 1,000 s."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
from tests.benchmarks.ledger import ratio, table
from tests.benchmarks.timing import in_turns
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


def our_solver(terms: tuple[str, ...], t: np.ndarray, p: Mapping[str, float], tangents: int = NONE) -> Solve:
    """Tolerance to angles, or to their slopes too."""
    scales = abs(p["theta0"]), float(np.sqrt(p["stiffness"]))
    solver = Solver(terms, LAW, t, "angle", *scales, p["epsilon"], t[[0, -1]])
    values, active = np.array([p[name] for name in solver.names]), np.ones(len(terms), bool)

    def solve(tolerance: float) -> np.ndarray:
        motion = solver.solve(values, active, tangents=tangents, tolerance=tolerance)
        return motion.y if tangents == NONE else (motion.y @ motion.tangents)

    return solve


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


def measured(model: str) -> dict[str, float]:
    """CPU seconds of one likelihood of each, and the largest errors of the trajectory (rad)."""
    p = {TERMS.get(model).parameter: PAPER[TERMS.get(model).parameter], **LAWS[LAW]}
    truth = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    y = truth + NOISE * np.random.default_rng(1).standard_normal(TIMES.size)
    solvers: dict[str, Solve] = {"ours": our_solver((model,), TIMES, p), **others_of(model, p, TIMES)}
    if find_spec("diffrax"):
        theirs = diffrax_solver(model, TIMES)
        solvers["diffrax Tsit5"] = lambda tol: np.asarray(theirs(tol, p))
    found, runs = {}, {}
    for name, solve in solvers.items():
        tolerance, found[f"{name} error"] = loosest(solve, truth)
        runs[name] = lambda solve=solve, tolerance=tolerance: np.sum(((y - solve(tolerance)) / NOISE) ** 2)
    target = posterior_of(model, p, y)
    z = target.scores(p)
    likelihood = Likelihood.near(target, z, ERROR)
    found["posterior error"] = float(np.max(np.abs(y - likelihood.residual(z) - truth)))
    runs["posterior"] = lambda: likelihood.log_posterior(z)
    assert max(found.values()) <= ERROR
    return found | dict(zip(runs, in_turns(*runs.values(), rounds=7), strict=True))


def gradient() -> list[float]:
    """CPU seconds of a likelihood under all three terms, and of one with its slopes by seven parameters."""
    p = {**PAPER, **LAWS[LAW]}
    solve, slopes = our_solver(MODELS, TIMES, p), our_solver(MODELS, TIMES, p, PARAMETERS)
    y = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    return in_turns(lambda: np.sum((y - solve(1e-7)) ** 2), lambda: slopes(1e-7), rounds=7)


def long() -> list[float]:
    """CPU seconds of 1,000 s in 100,001 samples, after a tenth of which the motion is over: ours and odeint's."""
    times, p = np.linspace(0.0, 1000.0, 100_001), {"zeta": PAPER["zeta"], **LAWS[LAW]}
    ours, theirs = our_solver(("viscous",), times, p), others_of("viscous", p, times)["odeint"]
    close = ours(1e-13)
    tolerances = [loosest(solve, close)[0] for solve in (ours, theirs)]
    return in_turns(lambda: ours(tolerances[0]), lambda: theirs(tolerances[1]), rounds=3)


def test_one_likelihood() -> None:
    """All keep to the error."""
    rows = []
    for model in MODELS:
        m = measured(model)
        for name in [n for n in SOLVERS if n in m]:
            ratio(f"compiled likelihood, {model}: {name} / ours", m[name] / m["ours"], BARS.get(name))
            ratio(f"log posterior, {model}: {name} / ours", m[name] / m["posterior"])
            both = (
                c
                for n in (name, "ours", "posterior")
                for c in (f"{1e6 * m[n]:.0f}", f"{m[f'{n} error']:.1e}")
            )
            rows.append([model, name, *both, *(f"{m[name] / m[n]:.1f}" for n in ("ours", "posterior"))])
    header = [
        "model", "solver", "µs", "error", "ours", "error", "log posterior", "error", "ratio", "of log posterior",
    ]  # fmt: skip
    table(f"One compiled likelihood of 1,001 samples, within {ERROR:g} rad", header, rows)


def test_gradient_and_length() -> None:
    (one, with_gradient), (ours, odeints) = gradient(), long()
    ratio("gradient by 7 parameters: 2.5 likelihoods / ours", GRADIENT * one / with_gradient, 1.0)
    ratio("1,000 s, 100,001 samples: odeint / ours", odeints / ours, LONG)
    rows = [
        [name, f"{1e6 * own:.0f}", beside, f"{1e6 * other:.0f}", f"{own / other:.2f}"]
        for name, own, beside, other in (
            ("likelihood with 7 slopes", with_gradient, "likelihood", one),
            ("1,000 s by odeint", odeints, "ours", ours),
        )
    ]
    title = "A likelihood with its gradient, and 1,000 s in 100,001 samples"
    table(title, ["what", "µs", "beside", "µs", "ratio"], rows)
