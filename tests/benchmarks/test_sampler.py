"""Effective samples a second: NUTS of this package against NumPyro's on diffrax and against emcee on SciPy's odeint.

The posterior is the same, written out once more for each of them: for JAX in units of its sds, for SciPy in scores.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from importlib.util import find_spec

import emcee
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS
from scipy.integrate import odeint

from bayesdamp.inference import diagnostics
from bayesdamp.inference.diagnostics import ess_bulk
from bayesdamp.inference.mode import Mode, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Posterior, Seed, Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.test_likelihood import diffrax_solver
from tests.benchmarks.timing import table

TOLERANCE = 1e-7
"""Of diffrax's and of odeint's steps, with which a log density is right to 0.002 (measured)."""
WALKERS, STEPS = 32, 400
CHAINS, WARMUP, DRAWS = 4, 500, 500
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


def effective(draws: dict[str, np.ndarray]) -> float:
    """The smallest bulk effective size over the parameters, each of shape (chain, draw)."""
    return min(ess_bulk(x) for x in draws.values())


@lru_cache
def ours() -> tuple[Posterior, list[float]]:
    """Draws, and CPU seconds of a first run and of one after it."""
    times, found = [], None
    for seed in (1, 2):
        began = time.process_time()
        settings = Settings(chains=CHAINS, warmup=WARMUP, draws=DRAWS, seed=seed)
        found = SAMPLERS.get("nuts").sample(*problem(), settings)
        times.append(time.process_time() - began)
    assert found is not None
    return found, times


@lru_cache
def measured() -> dict[str, dict[str, float]]:
    posterior, mode = problem()
    found, times = ours()
    mine = {n: found.draws[..., i] for i, n in enumerate(found.names)}
    result = {"ours": _row(mine, times, float(np.mean(found.stats["n_steps"])))}
    if not find_spec("diffrax"):
        pytest.skip("diffrax is not installed: pip install bayesdamp[bench]")
    density, sds = on_diffrax()
    kernel = NUTS(potential_fn=lambda v: -density(v), dense_mass=True, max_tree_depth=10)
    mcmc = MCMC(
        kernel,
        num_warmup=WARMUP,
        num_samples=DRAWS,
        num_chains=CHAINS,
        chain_method="vectorized",
        progress_bar=False,
    )
    start = np.random.default_rng(2).standard_normal((CHAINS, mode.z.size)) @ mode.factor.T / sds
    times = []
    for seed in (1, 2):
        began = time.process_time()
        mcmc.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(start), extra_fields=("num_steps",))
        v = np.asarray(mcmc.get_samples(group_by_chain=True))
        times.append(time.process_time() - began)
    values = posterior.values(mode.z + sds * v)
    steps = float(np.mean(np.asarray(mcmc.get_extra_fields()["num_steps"])))
    result["numpyro"] = _row(values, times, steps)
    for name, draws in mine.items():
        error = np.hypot(diagnostics.monte_carlo_error(draws), diagnostics.monte_carlo_error(values[name]))
        result["ours"][f"differs {name}"] = abs(float(draws.mean() - values[name].mean())) / error
    return result


@lru_cache
def by_emcee() -> dict[str, float]:
    """emcee's default stretch move on a likelihood by SciPy's odeint, from the posterior's own spread."""
    posterior, mode = problem()
    rng = np.random.default_rng(3)
    start = mode.z + rng.standard_normal((WALKERS, mode.z.size)) @ mode.factor.T
    start[:, 0] = np.abs(start[:, 0])
    sampler = emcee.EnsembleSampler(WALKERS, mode.z.size, on_odeint)
    sampler.random_state = np.random.RandomState(4).get_state()
    state = sampler.run_mcmc(start, STEPS // 4)
    sampler.reset()
    began = time.process_time()
    sampler.run_mcmc(state, STEPS)
    spent = time.process_time() - began
    draws = np.asarray(sampler.get_chain())  # (steps, walkers, d)
    values = posterior.values(draws)
    # Walkers of one ensemble are not independent chains: the autocorrelation time is that of their mean, emcee's own.
    times = emcee.autocorr.integrated_time(draws, tol=0)
    size = draws.shape[0] * draws.shape[1] / float(np.max(times))
    means = {n: float(v.mean()) for n, v in values.items()}
    return {"ess": size, "seconds": spent, "rate": size / spent, **means}


def _row(draws: dict[str, np.ndarray], times: list[float], steps: float) -> dict[str, float]:
    size = effective(draws)
    return {"ess": size, "seconds": times[1], "compiled": times[0], "steps": steps, "rate": size / times[1]}


def test_table():
    rows = measured()
    table(
        f"NUTS, {CHAINS} chains of {WARMUP} + {DRAWS} draws, five parameters, 1,001 samples",
        ["sampler", "least ESS", "steps a draw", "s", "s with compilation", "ESS/s"],
        [
            [
                n,
                *(f"{r[k]:.0f}" for k in ("ess", "steps")),
                *(f"{r[k]:.2f}" for k in ("seconds", "compiled")),
                f"{r['rate']:.0f}",
            ]
            for n, r in rows.items()
        ],
    )
    for name, other in {"numpyro": rows["numpyro"], "emcee on odeint": by_emcee()}.items():
        ratio(f"effective samples a second, one record: ours / {name}", rows["ours"]["rate"] / other["rate"])


def test_the_same_posterior():
    """Means within 4.5 Monte Carlo standard errors: false-alarm rate below 1e-4 over five parameters."""
    rows = measured()
    assert all(v < 4.5 for k, v in rows["ours"].items() if k.startswith("differs"))


def test_odeint_has_the_same_posterior():
    """Means within 4.5 of its standard errors; negative control: one sd away is further than that."""
    found, (posterior, mode) = by_emcee(), problem()
    sds = value_sds(posterior, mode.z, np.linalg.inv(mode.information))
    for name, value in posterior.values(mode.z).items():
        assert abs(found[name] - float(value)) < (4.5 * found["ess"] ** -0.5 + 0.1) * sds[name]
    assert (4.5 * found["ess"] ** -0.5 + 0.1) < 1
