"""One log likelihood of 1,001 samples, trajectories within 1e-6 rad, against odeint, solve_ivp and diffrax."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from importlib.util import find_spec

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.residuals import residual
from scipy.integrate import odeint, solve_ivp

from bayesdamp.inference.fit.mode import plans
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal
from bayesdamp.types import Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.test_trajectories import ERROR, MODELS, TIMES, slope_of
from tests.benchmarks.timing import in_turns, table
from tests.physics.independent import LAWS, PAPER, trajectory

LAW, NOISE, SIZE = "horizontal_pendulum", 0.003, 256
TOLERANCES = 10.0 ** np.arange(-5.0, -12.0, -0.25)
SOLVERS = ("odeint", "solve_ivp", "diffrax")
AWAY = 1e-3
"""Scores; the posterior's standard deviations are a few 1e-4."""
MANY, OF_MANY = 15.0, 30.0
"""At least, each of a batch against one of odeint's, and of diffrax's."""

Solve = Callable[[float], np.ndarray]


def diffrax_solver(model: str, p: dict[str, float], method: str = "Dopri8") -> Callable[[float], jax.Array]:
    """Tolerance to angles by a method of diffrax's (the eighth-order one of Dormand and Prince), compiled once for all
    tolerances."""
    import diffrax

    coefficient, k, g, eps = p[TERMS.get(model).parameter], p["stiffness"], p["gravity"], p["epsilon"]

    def drag(v: jax.Array) -> jax.Array:
        return {
            "viscous": lambda: 2 * coefficient * v,
            "coulomb": lambda: coefficient * jnp.tanh(v / eps),
            "quadratic": lambda: coefficient * v * jnp.abs(v),
        }[model]()

    def field(t, y, args):
        return y[1], -drag(y[1]) - k * (y[0] - p["spring_angle"]) + g * jnp.cos(y[0])

    @jax.jit
    def solve(tolerance):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            getattr(diffrax, method)(),
            t0=0.0,
            t1=float(TIMES[-1]),
            dt0=0.01,
            y0=(jnp.asarray(p["theta0"]), jnp.asarray(p["omega0"])),
            saveat=diffrax.SaveAt(ts=jnp.asarray(TIMES)),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            max_steps=100_000,
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


@lru_cache
def measured(model: str) -> dict[str, float]:
    """Seconds of one likelihood, and largest errors of the trajectory (rad), of each solver."""
    name = TERMS.get(model).parameter
    p = {name: PAPER[name], **LAWS[LAW]}
    truth = trajectory(LAW, p, TIMES, longest=0.01)[:, 0]
    y = truth + NOISE * np.random.default_rng(1).standard_normal(TIMES.size)
    slope, start = slope_of(model, p), (p["theta0"], p["omega0"])

    def density(theta: np.ndarray) -> float:
        r = (y - theta) / NOISE
        return float(-0.5 * r @ r)

    solvers: dict[str, Solve] = {
        "odeint": lambda tol: odeint(slope, start, TIMES, rtol=tol, atol=tol)[:, 0],
        "solve_ivp": lambda tol: solve_ivp(
            lambda t, s: slope(s, t),
            (0.0, TIMES[-1]),
            start,
            method="DOP853",
            t_eval=TIMES,
            rtol=tol,
            atol=tol,
        ).y[0],
    }
    found, runs = {}, {}
    if find_spec("diffrax"):
        theirs = diffrax_solver(model, p)
        solvers["diffrax"] = lambda tol: np.asarray(theirs(tol))
    for solver, solve in solvers.items():
        tolerance, found[f"{solver} error"] = loosest(solve, truth)
        runs[solver] = lambda solve=solve, tolerance=tolerance: density(solve(tolerance))

    osc = Oscillator((model,), LAW)
    priors = {
        name: HalfNormal(scale=0.45),
        "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6),
        "omega0": Normal(mean=0.0, sd=2.7),
    }
    known = {n: v for n, v in p.items() if n not in priors} | {"noise_sd": NOISE}
    target = Target(Signal(TIMES, y), osc, "gaussian", priors, known)
    z = target.scores({n: p[n] for n in priors})
    plan = plans(target, z, ERROR)[0]
    context = target.context(plan).compact
    one = jax.jit(partial(log_posterior, target.layout))
    many = jax.jit(jax.vmap(partial(log_posterior, target.layout), in_axes=(None, 0)))
    # Some posterior standard deviations away: where a plan is corrected it is far better than it need be.
    batch = z + AWAY * np.random.default_rng(0).standard_normal((SIZE, z.size))
    errors = []
    for away in batch[:3]:
        values = {**p, **{n: float(v) for n, v in target.values(away).items()}}
        there = trajectory(LAW, values, TIMES, longest=0.01)[:, 0]
        errors.append(np.max(np.abs(y - residual(target, plan, away) - there)))
    found["ours error"] = float(max(errors))
    runs["ours"] = lambda: one(context, z).block_until_ready()
    runs[f"ours, of {SIZE}"] = lambda: many(context, batch).block_until_ready()
    for solver, seconds in zip(runs, in_turns(*runs.values()), strict=True):
        found[solver] = seconds / (SIZE if solver.startswith("ours,") else 1)
    return found


def others(m: dict[str, float]) -> list[str]:
    return [solver for solver in SOLVERS if solver in m]


def test_table():
    rows = []
    for model in MODELS:
        m = measured(model)
        for solver in others(m):
            ratio(f"likelihood, {model}: {solver} / ours", m[solver] / m["ours"])
            bar = OF_MANY if solver == "diffrax" else MANY if solver == "odeint" else None
            ratio(f"likelihood, {model}: {solver} / ours of {SIZE}", m[solver] / m[f"ours, of {SIZE}"], bar)
            both = [m["ours"], m[f"ours, of {SIZE}"]]
            rows.append(
                [
                    model,
                    solver,
                    f"{1e6 * m[solver]:.0f}",
                    f"{m[f'{solver} error']:.1e}",
                    *(f"{1e6 * s:.1f}" for s in both),
                    f"{m['ours error']:.1e}",
                    *(f"{m[solver] / s:.1f}" for s in both),
                ]
            )
    header = ["model", "solver", "µs", "error", "ours", f"of {SIZE}", "error", "ratio", f"ratio of {SIZE}"]
    table(f"One likelihood of 1,001 samples, trajectories within {ERROR:g} rad", header, rows)


@pytest.mark.parametrize("model", MODELS)
def test_all_keep_to_the_error(model):
    m = measured(model)
    assert max(v for k, v in m.items() if k.endswith("error")) <= ERROR


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("solver", SOLVERS)
def test_one_likelihood_is_faster(solver, model):
    m = measured(model)
    if solver not in m:
        pytest.skip(f"{solver} is not installed: pip install bayesdamp[bench]")
    assert m[solver] > m["ours"]


@pytest.mark.parametrize("model", MODELS)
def test_many_likelihoods(model):
    m = measured(model)
    assert m["odeint"] >= MANY * m[f"ours, of {SIZE}"]
