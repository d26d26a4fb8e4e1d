"""Effective samples a second: NUTS of this package beside NumPyro's and BlackJAX's NUTS on diffrax, and beside PINTS
and emcee on SciPy's odeint.

The posterior is the same, written out once more for each of them: for JAX in units of its sds, for SciPy in scores.
Each is set up as its documentation does it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import emcee
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS
from scipy.integrate import odeint

from bayesdamp.inference.diagnostics import ess_bulk, ess_tail
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Seed, Signal
from tests.benchmarks.ledger import ratio, table
from tests.benchmarks.test_likelihood import diffrax_solver

TOLERANCE = 1e-7
"""Of diffrax's and of odeint's steps, with which a log density is right to 0.002 (measured)."""
CHAINS, WARMUP, DRAWS = 4, 500, 500
WALKERS, WALKS = 32, 400
STEPS = 2500
"""Of PINTS's chains, of which the first half is left out."""
APART = 4.5
"""Monte Carlo standard errors: a false-alarm rate below 1e-4 over five parameters."""
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.003}


@lru_cache
def problem() -> tuple[Target, Mode]:
    """The paper's viscous pendulum, 1,001 samples, noise of 1 % of θ0; stiffness and start unknown too. And
    its mode."""
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    known = {"gravity": 1.0, "spring_angle": 0.0}
    t = np.linspace(0.0, 10.0, 1001)
    y = simulate(osc, {**TRUTH, **known}, t) + 0.003 * np.random.default_rng(1).standard_normal(t.size)
    priors: dict[str, Prior] = {
        "zeta": HalfNormal(scale=0.45),
        "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6),
        "omega0": Normal(mean=0.0, sd=2.7),
        "noise_sd": LogNormal(median=0.003, sigma=1.0),
    }
    posterior = Target(Signal(t, y), osc, "gaussian", priors, known)
    return posterior, find_mode(posterior, {Seed("truth"): TRUTH}, noise_level=TRUTH["noise_sd"])


def on_diffrax() -> tuple[Callable[[jax.Array], jax.Array], np.ndarray]:
    """The log density as one writes it in JAX, of scores in the posterior's sds about its mode, and these sds, (d,):
    in the scores' own units the warm-up of BlackJAX came to a tenth of the effective size."""
    posterior, mode = problem()
    solve, y, sds = diffrax_solver("viscous", posterior.signal.t), posterior.signal.y, mode.sd()

    def height(v: jax.Array) -> jax.Array:
        z = mode.z + sds * v
        of = zip(posterior.priors.items(), z, strict=True)
        p = {**posterior.known, **{n: type(q).transform(x, *q.numbers) for (n, q), x in of}}
        r = (y - solve(TOLERANCE, p)) / p["noise_sd"]
        return -0.5 * (r @ r) - y.size * jnp.log(p["noise_sd"]) - 0.5 * (z @ z)

    density = jax.custom_jvp(height)  # forward through the solver, also where a sampler asks for a gradient
    density.defjvp(lambda at, to: (height(*at), jax.jacfwd(height)(*at) @ to[0]))
    return density, sds


def on_odeint(z: np.ndarray) -> float:
    """The log density as one writes it with SciPy, of scores (d,); of the positive half of a reflected one."""
    posterior, _ = problem()
    t, y = posterior.signal.t, posterior.signal.y

    def slope(state: tuple[float, float], _: float, zeta: float, stiffness: float) -> tuple[float, float]:
        return state[1], -2 * zeta * state[1] - stiffness * state[0] + np.cos(state[0])

    p = {n: float(v) for n, v in posterior.values(np.asarray(z)).items()}
    if z[0] < 0 or not np.all(np.isfinite(list(p.values()))):
        return -np.inf
    start, rates = [p["theta0"], p["omega0"]], (p["zeta"], p["stiffness"])
    theta = odeint(slope, start, t, args=rates, rtol=TOLERANCE, atol=TOLERANCE)[:, 0]
    r = (y - theta) / p["noise_sd"]
    return float(-0.5 * r @ r - t.size * np.log(p["noise_sd"]) - 0.5 * z @ z)


class Run(NamedTuple):
    """Least effective sizes, bulk and tail; means and sds of the parameters; CPU seconds with
    compilation and without."""

    sizes: dict[str, float]
    means: np.ndarray
    sds: np.ndarray
    cold: float
    warm: float


def natural(z: np.ndarray) -> np.ndarray:
    """Scores (..., d) as the parameters themselves."""
    return np.stack(list(problem()[0].values(z).values()), axis=-1)


def starts(count: int) -> np.ndarray:
    """Starts of chains about the mode, (count, d), with the posterior's own spread."""
    mode = problem()[1]
    return np.random.default_rng(2).standard_normal((count, mode.z.size)) @ mode.factor.T


def run_twice(sample: Callable[[int], np.ndarray]) -> Run:
    """Run a sampler, of a seed to draws (chain, draw, d), twice: the first run compiles."""
    times, draws = [], np.empty(0)
    for seed in (1, 2):
        began = time.process_time()
        draws = sample(seed)
        times.append(time.process_time() - began)
    each = np.moveaxis(draws, -1, 0)
    sizes = {"bulk": min(map(ess_bulk, each)), "tail": min(map(ess_tail, each))}
    return Run(sizes, draws.mean(axis=(0, 1)), draws.std(axis=(0, 1)), *times)


@lru_cache
def ours() -> Run:
    def sample(seed: int) -> np.ndarray:
        settings = Settings(chains=CHAINS, warmup=WARMUP, draws=DRAWS, seed=seed)
        return SAMPLERS.get("nuts").sample(*problem(), settings).draws

    return run_twice(sample)


def numpyro_nuts() -> Run:
    pytest.importorskip("diffrax")
    density, sds = on_diffrax()
    mcmc = MCMC(
        NUTS(potential_fn=lambda v: -density(v), dense_mass=True, max_tree_depth=10),
        num_warmup=WARMUP, num_samples=DRAWS, num_chains=CHAINS, chain_method="vectorized", progress_bar=False,
    )  # fmt: skip

    def sample(seed: int) -> np.ndarray:
        mcmc.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(starts(CHAINS) / sds))
        return natural(problem()[1].z + sds * np.asarray(mcmc.get_samples(group_by_chain=True)))

    return run_twice(sample)


def blackjax_nuts() -> Run:
    """Its window adaptation and NUTS, a dense mass matrix, chains one by one in one program."""
    blackjax = pytest.importorskip("blackjax")
    density, sds = on_diffrax()

    @jax.jit
    def chain(key, start):
        first, second = jax.random.split(key)
        adapted = blackjax.window_adaptation(blackjax.nuts, density, is_mass_matrix_diagonal=False)
        (state, parameters), _ = adapted.run(first, start, num_steps=WARMUP)
        kernel = blackjax.nuts(density, **parameters).step

        def step(state, key):
            state, _ = kernel(key, state)
            return state, state.position

        return jax.lax.scan(step, state, jax.random.split(second, DRAWS))[1]

    def sample(seed: int) -> np.ndarray:
        keys = jax.random.split(jax.random.PRNGKey(seed), CHAINS)
        each = [chain(key, jnp.asarray(start)) for key, start in zip(keys, starts(CHAINS) / sds, strict=True)]
        return natural(problem()[1].z + sds * np.stack([np.asarray(draws) for draws in each]))

    return run_twice(sample)


def pints_adaptive() -> Run:
    """Haario and Bardenet's adaptive chains, PINTS's usual choice, on a likelihood by odeint."""
    pints = pytest.importorskip("pints")
    mode = problem()[1]

    class Density(pints.LogPDF):
        def n_parameters(self) -> int:
            return mode.z.size

        def __call__(self, z: np.ndarray) -> float:
            return on_odeint(z)

    def sample(seed: int) -> np.ndarray:
        np.random.seed(seed)
        run = pints.MCMCController(Density(), 3, list(mode.z + starts(3)), method=pints.HaarioBardenetACMC)
        run.set_max_iterations(STEPS)
        run.set_log_to_screen(False)
        return natural(np.asarray(run.run())[:, STEPS // 2 :])

    return run_twice(sample)


def emcee_stretch() -> Run:
    """emcee's default move on a likelihood by odeint. Walkers of one ensemble are not independent chains: the
    autocorrelation time is that of their mean, emcee's own."""
    mode = problem()[1]
    start = mode.z + starts(WALKERS)
    start[:, 0] = np.abs(start[:, 0])
    sampler = emcee.EnsembleSampler(WALKERS, mode.z.size, on_odeint)
    sampler.random_state = np.random.RandomState(4).get_state()
    state = sampler.run_mcmc(start, WALKS // 4)
    sampler.reset()
    began = time.process_time()
    sampler.run_mcmc(state, WALKS)
    spent = time.process_time() - began
    draws = np.asarray(sampler.get_chain())  # (steps, walkers, d)
    size = draws[..., 0].size / float(np.max(emcee.autocorr.integrated_time(draws, tol=0)))
    values = natural(draws)
    return Run({"bulk": size}, values.mean(axis=(0, 1)), values.std(axis=(0, 1)), spent, spent)


PEERS = {"numpyro": numpyro_nuts, "blackjax": blackjax_nuts, "pints": pints_adaptive, "emcee": emcee_stretch}


@pytest.mark.parametrize("peer", PEERS)
def test_effective_sizes(peer: str) -> None:
    """And means of the same posterior; 0.1 sd for what the autocorrelation time of few steps is off. Negative control:
    one sd away is further than that."""
    mine, their = ours(), PEERS[peer]()
    rows = []
    for kind, size in their.sizes.items():
        for when, own, other in (("cold", mine.cold, their.cold), ("warm", mine.warm, their.warm)):
            rates = mine.sizes[kind] / own, size / other
            ratio(f"effective samples a second, {kind}, {when}: ours / {peer}", rates[0] / rates[1])
            rows.append([kind, when, *(f"{rate:.0f}" for rate in rates), f"{rates[0] / rates[1]:.1f}"])
    header = ["of", "compilation", "ours a CPU s", f"{peer}'s", "ratio"]
    table(f"Effective samples a second beside {peer}", header, rows)
    within = APART * np.hypot(mine.sizes["bulk"] ** -0.5, their.sizes["bulk"] ** -0.5) + 0.1
    assert np.all(np.abs(mine.means - their.means) < within * mine.sds)
    assert within < 1
