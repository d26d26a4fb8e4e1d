"""Trajectories of 1,001 samples at a maximum error of 1e-6 rad against scipy.integrate.odeint."""

from __future__ import annotations

import math
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.solver.plan import compiled_record
from scipy.integrate import odeint

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from tests.benchmarks.ledger import ratio
from tests.benchmarks.timing import in_turns, table
from tests.physics.independent import LAWS, PAPER, trajectory

TIMES = np.linspace(0.0, 10.0, 1001)
ERROR = 1e-6
"""rad"""
SINGLE, BATCH, SIZE = 3.0, 15.0, 256


def slope_of(model: str, p: dict[str, float]):
    """The equation on plain floats, as one writes it for odeint."""
    k, g, s, eps = p["stiffness"], p["gravity"], p["spring_angle"], p["epsilon"]
    c = p[TERMS.get(model).parameter]
    tanh, cos = math.tanh, math.cos
    return {
        "viscous": lambda y, t: (y[1], -2 * c * y[1] - k * (y[0] - s) + g * cos(y[0])),
        "coulomb": lambda y, t: (y[1], -c * tanh(y[1] / eps) - k * (y[0] - s) + g * cos(y[0])),
        "quadratic": lambda y, t: (y[1], -c * y[1] * abs(y[1]) - k * (y[0] - s) + g * cos(y[0])),
    }[model]


@lru_cache
def measured(model: str) -> dict[str, float]:
    """Seconds a trajectory and largest errors of odeint, of one of ours, and of one in a batch."""
    law = "horizontal_pendulum"
    coefficient = TERMS.get(model).parameter
    p = {coefficient: PAPER[coefficient], **LAWS[law]}
    truth = trajectory(law, p, TIMES, longest=0.01)[:, 0]
    slope, start = slope_of(model, p), (p["theta0"], p["omega0"])

    # The loosest tolerance of odeint's, in quarter decades, with which it keeps to the error.
    for tolerance in 10.0 ** np.arange(-5.0, -11.0, -0.25):

        def theirs(tolerance=tolerance):
            return odeint(slope, start, TIMES, rtol=tolerance, atol=tolerance)[:, 0]

        their_error = np.max(np.abs(theirs() - truth))
        if their_error <= ERROR:
            break

    osc = Oscillator((model,), law)
    plan = make_plan(osc, p, TIMES, tolerance=ERROR)
    one = {n: jnp.asarray(p[n]) for n in osc.parameters}
    run = compiled_record(osc)
    rng = np.random.default_rng(0)
    many = {n: jnp.asarray(p[n] * (1 + 1e-3 * rng.standard_normal(SIZE))) for n in osc.parameters}
    batch = jax.jit(jax.vmap(lambda q: plan.record(osc, q)))
    last = {n: float(v[-1]) for n, v in many.items()}
    error = np.max(np.abs(np.asarray(run(plan, one)) - truth))
    batch_error = np.max(
        np.abs(np.asarray(batch(many))[-1] - trajectory(law, last, TIMES, longest=0.01)[:, 0])
    )
    odeint_s, single_s, batch_s = in_turns(
        theirs, lambda: run(plan, one).block_until_ready(), lambda: batch(many).block_until_ready()
    )
    return {
        "odeint_s": odeint_s,
        "odeint_error": float(their_error),
        "single_s": single_s,
        "error": float(error),
        "batch_s": batch_s / SIZE,
        "batch_error": float(batch_error),
        "single": odeint_s / single_s,
        "batch": odeint_s / (batch_s / SIZE),
        "steps": float(plan.count),
    }


MODELS = ("viscous", "coulomb", "quadratic")


def test_table():
    for model in MODELS:
        ratio(f"trajectory, {model}: odeint / ours", measured(model)["single"])
        ratio(f"trajectory, {model}: odeint / ours of {SIZE}", measured(model)["batch"])
    table(
        f"1,001 samples within {ERROR:g} rad, microseconds a trajectory",
        ["model", "odeint", "error", "ours", "error", "steps", "ratio", f"of {SIZE}", "error", "ratio"],
        [
            [
                model,
                f"{1e6 * m['odeint_s']:.0f}",
                f"{m['odeint_error']:.1e}",
                f"{1e6 * m['single_s']:.0f}",
                f"{m['error']:.1e}",
                f"{m['steps']:.0f}",
                f"{m['single']:.1f}",
                f"{1e6 * m['batch_s']:.1f}",
                f"{m['batch_error']:.1e}",
                f"{m['batch']:.1f}",
            ]
            for model in MODELS
            for m in [measured(model)]
        ],
    )


@pytest.mark.parametrize("model", MODELS)
def test_both_keep_to_the_error(model):
    m = measured(model)
    assert max(m["odeint_error"], m["error"], m["batch_error"]) <= ERROR


@pytest.mark.parametrize("model", MODELS)
def test_one_trajectory(model):
    assert measured(model)["single"] >= SINGLE


@pytest.mark.parametrize("model", MODELS)
def test_batch(model):
    assert measured(model)["batch"] >= BATCH
