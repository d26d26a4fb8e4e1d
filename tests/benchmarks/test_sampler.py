"""Effective samples a second: NUTS of this package against NumPyro's and against emcee on SciPy's odeint.

The posterior is the same; theirs is not whitened. One record, and a hundred in one compilation.
"""

from __future__ import annotations

import time
from functools import lru_cache

import emcee
import jax
import jax.numpy as jnp
import numpy as np
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.samplers._many import sample_many
from numpyro.infer import MCMC, NUTS
from scipy.integrate import odeint

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.checks.convergence import ess_bulk
from bayesdamp.inference.fit.laplace import value_sds
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal
from bayesdamp.types import Seed, Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.timing import table

RATIO = 15.0
RATIO_OF_MANY = 50.0
RECORDS = 100
WALKERS, STEPS = 32, 400
CHAINS, WARMUP, DRAWS = 4, 500, 500
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.003}


def target(seed: int = 1) -> Target:
    """The paper's viscous pendulum, 1,001 samples, noise of 1 % of θ0; stiffness and start unknown too."""
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    known = {"gravity": 1.0, "spring_angle": 0.0}
    t = np.linspace(0.0, 10.0, 1001)
    y = simulate(osc, {**TRUTH, **known}, t) + 0.003 * np.random.default_rng(seed).standard_normal(t.size)
    priors = {
        "zeta": HalfNormal(scale=0.45),
        "stiffness": LogNormal(median=20.0, sigma=0.5),
        "theta0": Normal(mean=0.05, sd=0.6),
        "omega0": Normal(mean=0.0, sd=2.7),
        "noise_sd": LogNormal(median=0.003, sigma=1.0),
    }
    return Target(Signal(t, y), osc, "gaussian", priors, known)


def effective(draws: dict[str, np.ndarray]) -> float:
    """The smallest bulk effective size over the parameters, each of shape (chain, draw)."""
    return min(ess_bulk(x) for x in draws.values())


@lru_cache
def measured() -> dict[str, dict[str, float]]:
    posterior = target()
    mode = find_mode(posterior, {Seed("truth"): TRUTH}, noise_level=0.003)
    settings = Settings(chains=CHAINS, warmup=WARMUP, draws=DRAWS, seed=1)
    nuts = SAMPLERS.get("nuts")
    times, found = [], None
    for seed in (1, 2):  # the first compiles
        began = time.process_time()
        found = nuts.sample(posterior, mode, Settings(**{**settings.__dict__, "seed": seed}))
        times.append(time.process_time() - began)
    assert found is not None
    ours = {n: found.draws[..., i] for i, n in enumerate(found.names)}
    result = {"ours": _row(ours, times, float(np.mean(found.stats["n_steps"])))}

    # The same log posterior by its parameters: natural ones, logarithms of the positive; scores are affine in them.
    priors = posterior.priors
    shift, scale = np.zeros(len(priors)), np.ones(len(priors))
    for i, p in enumerate(priors.values()):
        if isinstance(p, Normal):
            shift[i], scale[i] = p.mean, p.sd
        elif isinstance(p, LogNormal):
            shift[i], scale[i] = np.log(p.median), p.sigma
        else:
            assert isinstance(p, HalfNormal)
            scale[i] = p.scale

    def potential(x):
        return -log_posterior(posterior.layout, mode.context, (x - shift) / scale)

    kernel = NUTS(
        potential_fn=potential, dense_mass=True, max_tree_depth=10, forward_mode_differentiation=True
    )
    mcmc = MCMC(
        kernel,
        num_warmup=WARMUP,
        num_samples=DRAWS,
        num_chains=CHAINS,
        chain_method="vectorized",
        progress_bar=False,
    )
    start = shift + scale * (
        mode.z + np.random.default_rng(2).standard_normal((CHAINS, len(priors))) @ mode.factor.T
    )
    times = []
    for seed in (1, 2):
        began = time.process_time()
        mcmc.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(start), extra_fields=("num_steps",))
        x = np.asarray(mcmc.get_samples(group_by_chain=True))
        times.append(time.process_time() - began)
    values = posterior.values((x - shift) / scale)
    steps = float(np.mean(np.asarray(mcmc.get_extra_fields()["num_steps"])))
    result["numpyro"] = _row({n: v for n, v in values.items()}, times, steps)
    for name, draws in ours.items():
        error = np.hypot(diagnostics.monte_carlo_error(draws), diagnostics.monte_carlo_error(values[name]))
        result["ours"][f"differs {name}"] = abs(float(draws.mean() - values[name].mean())) / error
    return result


@lru_cache
def on_odeint() -> dict[str, float]:
    """emcee's default stretch move on a likelihood by SciPy's odeint, from the posterior's own spread."""
    posterior = target()
    t, y = posterior.signal.t, posterior.signal.y
    mode = find_mode(posterior, {Seed("truth"): TRUTH}, noise_level=0.003)

    def slope(state, _, zeta, stiffness):
        theta, omega = state
        return omega, -2 * zeta * omega - stiffness * theta + np.cos(theta)

    def log_probability(z: np.ndarray) -> float:
        p = {n: float(v) for n, v in posterior.values(np.asarray(z)).items()}
        if z[0] < 0 or not np.all(np.isfinite(list(p.values()))):
            return -np.inf
        theta = odeint(
            slope, [p["theta0"], p["omega0"]], t, args=(p["zeta"], p["stiffness"]), rtol=1e-8, atol=1e-10
        )[:, 0]
        r = (y - theta) / p["noise_sd"]
        return float(-0.5 * r @ r - t.size * np.log(p["noise_sd"]) - 0.5 * z @ z)

    rng = np.random.default_rng(3)
    start = mode.z + rng.standard_normal((WALKERS, mode.z.size)) @ mode.factor.T
    start[:, 0] = np.abs(start[:, 0])
    sampler = emcee.EnsembleSampler(WALKERS, mode.z.size, log_probability)
    sampler.random_state = np.random.RandomState(4).get_state()
    state = sampler.run_mcmc(start, STEPS // 4)
    sampler.reset()
    began = time.process_time()
    sampler.run_mcmc(state, STEPS)
    spent = time.process_time() - began
    draws = sampler.get_chain()  # (steps, walkers, d)
    values = posterior.values(draws)
    # Walkers of one ensemble are not independent chains: the autocorrelation time is that of their mean, emcee's own.
    times = emcee.autocorr.integrated_time(draws, tol=0)
    size = draws.shape[0] * draws.shape[1] / float(np.max(times))
    means = {n: float(v.mean()) for n, v in values.items()}
    return {"ess": size, "seconds": spent, "rate": size / spent, **means}


@lru_cache
def of_many() -> dict[str, float]:
    """A hundred records through one program, which is compiled in that time."""
    targets = [target(seed) for seed in range(RECORDS)]
    modes = [find_mode(one, {Seed("truth"): TRUTH}, noise_level=0.003) for one in targets]
    settings = Settings(
        chains=CHAINS, warmup=WARMUP, draws=DRAWS + 1
    )  # a shape that nothing has compiled yet
    began = time.process_time()
    found = sample_many(targets, modes, settings, range(RECORDS))
    spent = time.process_time() - began
    size = sum(effective({n: p.draws[..., i] for i, n in enumerate(p.names)}) for p in found)
    return {"ess": size, "seconds": spent, "rate": size / spent}


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
    theirs = {"numpyro": rows["numpyro"], "emcee on odeint": on_odeint()}
    ours = {"one record": rows["ours"], f"{RECORDS} records, compiled in that time": of_many()}
    for name, row in ours.items():
        for other, their in theirs.items():
            ratio(f"effective samples a second, {name}: ours / {other}", row["rate"] / their["rate"])
    table(
        "effective samples a second",
        ["ours", "ESS/s", *(f"times {name}" for name in theirs)],
        [
            [name, f"{row['rate']:.0f}", *(f"{row['rate'] / other['rate']:.0f}" for other in theirs.values())]
            for name, row in ours.items()
        ],
    )


def test_the_same_posterior():
    """Means within 4.5 Monte Carlo standard errors: false-alarm rate below 1e-4 over five parameters."""
    rows = measured()
    assert all(v < 4.5 for k, v in rows["ours"].items() if k.startswith("differs"))


def test_effective_samples_a_second():
    ours = measured()["ours"]["rate"]
    assert ours >= RATIO * measured()["numpyro"]["rate"]
    assert ours >= RATIO * on_odeint()["rate"]


def test_effective_samples_a_second_of_many_records():
    ours = of_many()["rate"]
    assert ours >= RATIO_OF_MANY * measured()["numpyro"]["rate"]
    assert ours >= RATIO_OF_MANY * on_odeint()["rate"]


def test_odeint_has_the_same_posterior():
    """Means within 4.5 of its standard errors; negative control: one sd away is further than that."""
    found, posterior = on_odeint(), target()
    mode = find_mode(posterior, {Seed("truth"): TRUTH}, noise_level=0.003)
    sds = value_sds(posterior, mode.z, np.linalg.inv(mode.information))
    for name, value in posterior.values(mode.z).items():
        assert abs(found[name] - float(value)) < (4.5 * found["ess"] ** -0.5 + 0.1) * sds[name]
    assert (4.5 * found["ess"] ** -0.5 + 0.1) < 1
