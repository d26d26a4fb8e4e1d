"""The likelihood of a record of 1,000,000 samples against that of one of 10,000 over the same duration."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.gradient import value_and_gradient
from bayesdamp.physics.solver.steps import MeshPlan
from scipy.signal import lfilter

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Layout, Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Seed, Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.timing import in_turns, table

FEW, MANY, RATIO = 10_000, 1_000_000, 1.5
NOISE, NOISE_TIME = 0.003, 0.05
KNOWN = {"gravity": 1.0, "spring_angle": 0.0, "epsilon": 0.1}
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0}
TRUTH |= {"noise_sd": NOISE, "noise_time": NOISE_TIME}
NOISES = ("gaussian", "correlated")


def problem(noise: str, count: int) -> tuple[Target, Mode, float]:
    """The paper's viscous pendulum over ten seconds, its mode, and the seconds that condensing it took."""
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    t = np.linspace(0.0, 10.0, count)
    r = np.random.default_rng(1).standard_normal(count)
    if noise == "correlated":
        rho = np.exp(-t[1] / NOISE_TIME)
        r[1:] *= np.sqrt(1 - rho**2)
        r = lfilter([1.0], [1.0, -rho], r)
    y = simulate(osc, {**TRUTH, **KNOWN}, t) + NOISE * r
    priors: dict[str, Prior] = {
        "zeta": HalfNormal(scale=0.45),
        "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6),
        "omega0": Normal(mean=0.0, sd=2.7),
        "noise_sd": LogNormal(median=NOISE, sigma=1.0),
    }
    if noise == "correlated":
        priors["noise_time"] = LogNormal(median=0.1, sigma=1.5)
    target = Target(Signal(t, y), osc, noise, priors, KNOWN)
    mode = find_mode(target, {Seed("truth"): TRUTH}, noise_level=NOISE)
    began = time.process_time()
    target.context(mode.context.plan)
    return target, mode, time.process_time() - began


@lru_cache
def height(layout: Layout):
    """Compiled: the log posterior alone."""
    return jax.jit(partial(log_posterior, layout))


@lru_cache
def measured(noise: str) -> dict[str, float]:
    """Seconds of likelihood, gradient and information of both records, and how well both sums agree for the long."""
    runs, found = [], {}
    for count in (FEW, MANY):
        target, mode, found["condensing"] = problem(noise, count)
        plan = mode.context.plan
        assert isinstance(plan, MeshPlan)
        found[f"steps {count}"] = float(plan.count)
        functions, at = compiled(target.layout), jnp.asarray(mode.z)
        gradient = jax.jit(partial(value_and_gradient, target.layout))
        for f in (height(target.layout), gradient, functions.curvature):
            runs.append(lambda f=f, c=mode.context.compact, at=at: jax.block_until_ready(f(c, at)))
    times = in_turns(*runs)
    for i, name in enumerate(("likelihood", "gradient", "information")):
        found[f"{name} {FEW}"], found[f"{name} {MANY}"] = times[i], times[i + 3]
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((8, mode.z.size))
    points = [mode.z, *(mode.z + mode.factor @ (10 * u / np.linalg.norm(u)) for u in directions)]
    whole = replace(mode.context, compressed=None)
    ours, plain = (
        np.array([float(height(target.layout)(c, jnp.asarray(x))) for x in points])
        for c in (mode.context, whole)
    )
    found["apart"] = float(np.max(np.abs((ours - ours[0]) - (plain - plain[0]))))
    began = time.process_time()
    jax.block_until_ready(height(target.layout)(whole, at))
    found["plain"] = time.process_time() - began
    return found


def test_table():
    kinds = ("likelihood", "gradient", "information")
    for noise in NOISES:
        m = measured(noise)
        ratio(f"{MANY:,} samples, {noise}: the plain sum / ours", m["plain"] / m[f"likelihood {MANY}"])
        for kind in kinds:
            ratio(f"{kind}, {noise}: {FEW:,} samples / {MANY:,}", m[f"{kind} {FEW}"] / m[f"{kind} {MANY}"])
    table(
        f"microseconds, {FEW:,} and {MANY:,} samples in ten seconds",
        [
            "noise",
            *(f"{k} {c}" for k in kinds for c in ("short", "long", "ratio")),
            "plain sum",
            "condensing s",
            "apart",
        ],
        [
            [
                noise,
                *(
                    cell
                    for k in kinds
                    for a, b in [(m[f"{k} {FEW}"], m[f"{k} {MANY}"])]
                    for cell in (f"{1e6 * a:.0f}", f"{1e6 * b:.0f}", f"{b / a:.2f}")
                ),
                f"{1e6 * m['plain']:.0f}",
                f"{m['condensing']:.2f}",
                f"{m['apart']:.1e}",
            ]
            for noise in NOISES
            for m in [measured(noise)]
        ],
    )


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("kind", ["likelihood", "gradient", "information"])
def test_cost(noise, kind):
    m = measured(noise)
    assert m[f"{kind} {MANY}"] <= RATIO * m[f"{kind} {FEW}"]


@pytest.mark.parametrize("noise", NOISES)
def test_negative_control_the_plain_sum(noise):
    m = measured(noise)
    assert m["plain"] > RATIO * m[f"likelihood {FEW}"]


@pytest.mark.parametrize("noise", NOISES)
def test_agreement(noise):
    """Log likelihood differences within ten posterior sds of the mode, compressed and by the plain sum."""
    assert measured(noise)["apart"] < 1e-6
