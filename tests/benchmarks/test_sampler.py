"""NUTS of this package beside those of NumPyro and BlackJAX on diffrax; importance sampling beside dynesty.

The posterior is written out once more for JAX, in units of its sds; each is set up as its documentation does it.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS
from scipy.special import ndtri

from bayesdamp.inference.checks.diagnostics import ess_bulk, ess_tail, monte_carlo_error
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Seed, Signal
from tests.benchmarks.ledger import ratio
from tests.benchmarks.test_likelihood import diffrax_solver
from tests.benchmarks.timing import table

TOLERANCE = 1e-7
"""Of diffrax's steps, with which a log density is right to 0.002 (measured)."""
CHAINS, WARMUP, DRAWS = 4, 500, 500
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.003}
APART = 4.5
"""Monte Carlo standard errors: a false-alarm rate below 1e-4 over five parameters."""
Draw = Callable[[int], np.ndarray]


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


def on_diffrax() -> tuple[Callable[[jax.Array], jax.Array], np.ndarray, np.ndarray]:
    """The log density as one writes it in JAX, of scores in the posterior's sds about its mode; these sds, (d,), and
    starts of the chains. In the scores' own units the warm-up of BlackJAX came to a tenth of the effective size."""
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
    start = np.random.default_rng(2).standard_normal((CHAINS, mode.z.size)) @ mode.factor.T / sds
    return density, sds, start


def natural(v: np.ndarray) -> np.ndarray:
    """Scores in the posterior's sds, (..., d), as the parameters themselves."""
    posterior, mode = problem()
    return np.stack(list(posterior.values(mode.z + mode.sd() * v).values()), axis=-1)


def ours() -> Draw:
    settings = {"chains": CHAINS, "warmup": WARMUP, "draws": DRAWS}
    return lambda seed: SAMPLERS.get("nuts").sample(*problem(), Settings(**settings, seed=seed)).draws


def numpyro() -> Draw:
    density, _, start = on_diffrax()
    kernel = NUTS(potential_fn=lambda v: -density(v), dense_mass=True, max_tree_depth=10)
    mcmc = MCMC(
        kernel, num_warmup=WARMUP, num_samples=DRAWS, num_chains=CHAINS, chain_method="vectorized", progress_bar=False
    )  # fmt: skip

    def draw(seed: int) -> np.ndarray:
        mcmc.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(start))
        return natural(np.asarray(mcmc.get_samples(group_by_chain=True)))

    return draw


def blackjax() -> Draw:
    """Its window adaptation and NUTS, a dense mass matrix, chains one by one in one program."""
    blackjax = pytest.importorskip("blackjax")
    density, _, starts = on_diffrax()

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

    def draw(seed: int) -> np.ndarray:
        keys = jax.random.split(jax.random.PRNGKey(seed), CHAINS)
        return natural(np.stack([chain(k, jnp.asarray(s)) for k, s in zip(keys, starts, strict=True)]))

    return draw


@lru_cache
def measured(sampler: Callable[[], Draw]) -> tuple[np.ndarray, dict[str, float]]:
    """Draws, (chain, draw, d), and the least effective samples a CPU second, bulk and tail, of a first run and of one
    after it."""
    draw, rates, draws = sampler(), {}, np.empty(0)
    for seed, when in ((1, "cold"), (2, "warm")):
        began = time.process_time()
        draws = draw(seed)
        spent = time.process_time() - began
        for kind, size in (("bulk", ess_bulk), ("tail", ess_tail)):
            rates[f"{kind}, {when}"] = min(map(size, np.moveaxis(draws, -1, 0))) / spent
    return draws, rates


@pytest.mark.parametrize("peer", [numpyro, blackjax])
def test_effective_samples_a_second(peer: Callable[[], Draw]) -> None:
    """More than the peer's, from the same posterior."""
    (mine, own), (theirs, other) = measured(ours), measured(peer)
    for name in own:
        ratio(f"effective samples a second, {name}: ours / {peer.__name__}", own[name] / other[name])
    rows = [[n, f"{own[n]:.0f}", f"{other[n]:.0f}", f"{own[n] / other[n]:.1f}"] for n in own]
    header = ["of, compilation", "ours a CPU s", f"{peer.__name__}'s", "ratio"]
    table(f"Effective samples a second beside {peer.__name__}", header, rows)
    assert own["bulk, warm"] > other["bulk, warm"]
    for x, y in zip(np.moveaxis(mine, -1, 0), np.moveaxis(theirs, -1, 0), strict=True):
        assert abs(x.mean() - y.mean()) < APART * np.hypot(monte_carlo_error(x), monte_carlo_error(y))


def test_evidence_beside_dynesty() -> None:
    """Likelihoods for an evidence of equal error: those of dynesty times the square of the errors' ratio."""
    dynesty = pytest.importorskip("dynesty")
    posterior, mode = problem()
    mine = EVIDENCES.get("importance").evidence("m", posterior, mode, 1)
    sampler = dynesty.NestedSampler(
        mode.likelihood.log_likelihood,
        lambda u: ndtri(np.where(posterior.reflected, 0.5 * (1.0 + u), u)),
        mode.z.size,
        nlive=100,
        sample="rwalk",  # of a needle in the prior's box its ellipsoids alone hardly draw
        rstate=np.random.default_rng(1),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ellipsoids that are enlarged much
        sampler.run_nested(print_progress=False, dlogz=0.1)
    theirs = sampler.results
    error, count = float(theirs.logzerr[-1]), int(np.sum(theirs.ncall))
    equal = count * (error / mine.stderr) ** 2
    ratio("likelihoods of an evidence: dynesty / ours, at equal error", equal / mine.evaluations)
    header = ["method", "log evidence", "error", "likelihoods", "at the first's error, by its square"]
    rows = [
        ["importance", f"{mine.log_evidence:.3f}", f"{mine.stderr:.4f}", str(mine.evaluations), str(mine.evaluations)],
        ["dynesty", f"{float(theirs.logz[-1]):.3f}", f"{error:.4f}", str(count), f"{equal:.0f}"],
    ]  # fmt: skip
    table("An evidence beside dynesty (the mode's search not counted)", header, rows)
    assert abs(float(theirs.logz[-1]) - mine.log_evidence) < 4 * np.hypot(error, mine.stderr)
