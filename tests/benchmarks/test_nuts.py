"""Effective samples a second: NUTS of bayesdamp beside NumPyro's NUTS, on one posterior."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from numpyro.infer import MCMC, NUTS

from bayesdamp.inference.diagnostics import ess_bulk, ess_tail
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Signal
from tests.benchmarks.page import add_table
from tests.physics.independent import trajectory

TIMES = np.linspace(0.0, 10.0, 1001)
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.003}
KNOWN = {"gravity": 1.0, "spring_angle": 0.0}
CHAINS, WARMUP, DRAWS = 4, 500, 500
STANDARD_ERRORS = 4.5
"""By which the means of five parameters may differ: a false alarm in 30,000 seeds."""


def problem() -> tuple[Target, Mode]:
    """Return the posterior of the paper's viscous pendulum, with noise of 1 % of the first angle, and its mode."""
    noise = TRUTH["noise_sd"] * np.random.default_rng(1).standard_normal(TIMES.size)
    y = trajectory("horizontal_pendulum", {**TRUTH, **KNOWN}, TIMES)[:, 0] + noise
    priors: dict[str, Prior] = {
        "zeta": HalfNormal(scale=0.45), "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6), "omega0": Normal(mean=0.0, sd=2.7),
        "noise_sd": LogNormal(median=0.003, sigma=1.0),
    }  # fmt: skip
    oscillator = Oscillator(("viscous",), "horizontal_pendulum")
    target = Target(Signal(TIMES, y), oscillator, "gaussian", priors, KNOWN)
    return target, find_mode(target, [TRUTH], noise_level=TRUTH["noise_sd"])


def angles(p: Mapping[str, jax.Array]) -> jax.Array:
    """Return the motion (n,) by a Runge-Kutta step of fourth order a sample, which is right to 1e-6 rad."""
    h = TIMES[1]

    def slope(s: jax.Array) -> jax.Array:
        return jnp.array([s[1], -2 * p["zeta"] * s[1] - p["stiffness"] * s[0] + jnp.cos(s[0])])

    def step(s: jax.Array, _: None) -> tuple[jax.Array, jax.Array]:
        a = slope(s)
        b = slope(s + h / 2 * a)
        c = slope(s + h / 2 * b)
        d = slope(s + h * c)
        return s + h / 6 * (a + 2 * b + 2 * c + d), s[0]

    return jax.lax.scan(step, jnp.array([p["theta0"], p["omega0"]]), None, TIMES.size)[1]


def run_twice(sample: Callable[[int], np.ndarray]) -> tuple[np.ndarray, dict[str, float]]:
    """Run a function from a seed to draws (chain, draw, parameter) twice, because the first run compiles. Return draws
    and CPU seconds."""
    seconds, draws = {}, np.empty(0)
    for seed, kind in enumerate(("with compilation", "compiled")):
        start = time.process_time()
        draws = sample(seed)
        seconds[kind] = time.process_time() - start
    return draws, seconds


def our_sampler(target: Target, mode: Mode) -> Callable[[int], np.ndarray]:
    def sample(seed: int) -> np.ndarray:
        settings = Settings(chains=CHAINS, warmup=WARMUP, draws=DRAWS, seed=seed)
        return SAMPLERS.get("nuts").sample(target, mode, settings).draws

    return sample


def numpyro_sampler(target: Target, mode: Mode) -> Callable[[int], np.ndarray]:
    """NumPyro's NUTS with a dense mass matrix. Parameters are normal scores about the mode in units of their sds."""
    y, sds = target.signal.y, mode.sd()

    def potential(v: jax.Array) -> jax.Array:
        z = mode.z + sds * v
        scores = zip(target.priors.items(), z, strict=True)
        p = {name: type(prior).transform(x, *prior.numbers) for (name, prior), x in scores}
        r = (y - angles(p)) / p["noise_sd"]
        return 0.5 * (r @ r) + y.size * jnp.log(p["noise_sd"]) + 0.5 * (z @ z)

    mcmc = MCMC(
        NUTS(potential_fn=potential, dense_mass=True), num_warmup=WARMUP, num_samples=DRAWS, num_chains=CHAINS,
        chain_method="vectorized", progress_bar=False,
    )  # fmt: skip
    starts = np.random.default_rng(2).standard_normal((CHAINS, mode.z.size)) @ mode.factor.T / sds

    def sample(seed: int) -> np.ndarray:
        mcmc.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(starts))
        z = mode.z + sds * np.asarray(mcmc.get_samples(group_by_chain=True))
        return np.stack(list(target.values(z).values()), axis=-1)

    return sample


def test_effective_samples_a_second() -> None:
    """Both have the same means. Control: means that are an sd apart are not taken for the same."""
    runs = [run_twice(sampler(*problem())) for sampler in (our_sampler, numpyro_sampler)]
    sizes = {
        name: [min(map(function, np.moveaxis(draws, -1, 0))) for draws, _ in runs]
        for name, function in (("bulk", ess_bulk), ("tail", ess_tail))
    }
    rows, ratios = [], {}
    for name, pair in sizes.items():
        for kind in runs[0][1]:
            rates = [size / seconds[kind] for size, (_, seconds) in zip(pair, runs, strict=True)]
            ratios[f"effective samples a second, {name}, {kind}: ours / NumPyro"] = rates[0] / rates[1]
            rows.append([name, kind, *(f"{rate:.0f}" for rate in rates)])
    header = ["effective samples", "compilation", "ours a CPU s", "NumPyro's a CPU s"]
    add_table("NUTS beside NumPyro's", header, rows, ratios)
    ours, theirs = (draws.mean(axis=(0, 1)) for draws, _ in runs)
    within = STANDARD_ERRORS * np.hypot(*(size**-0.5 for size in sizes["bulk"]))
    assert np.all(np.abs(ours - theirs) < within * runs[0][0].std(axis=(0, 1)))
    assert within < 1
