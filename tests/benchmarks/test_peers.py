"""BlackJAX and PINTS beside NUTS of this package, bulk and tails; dynesty beside importance sampling. The posterior is
that of the paper's viscous pendulum in `test_sampler`; each is set up as its documentation does it."""

from __future__ import annotations

import time
import warnings
from functools import lru_cache, partial
from importlib.util import find_spec

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bayesdamp.inference.model.density import log_likelihood
from bayesdamp.inference.model.gradient import value_and_gradient
from scipy.integrate import odeint

from bayesdamp.inference.checks.convergence import ess_bulk, ess_tail
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence.methods.nested import scores
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.types import Seed
from tests.benchmarks.ledger import ratio
from tests.benchmarks.test_sampler import CHAINS, DRAWS, TRUTH, WARMUP, target
from tests.benchmarks.timing import table

STEPS = 2500
"""Of PINTS's chains, of which the first half is left out."""
APART = 4.5
"""Monte Carlo standard errors: a false-alarm rate below 1e-4 over five parameters."""


@lru_cache
def problem() -> tuple[Target, Mode]:
    posterior = target()
    return posterior, find_mode(posterior, {Seed("truth"): TRUTH}, noise_level=TRUTH["noise_sd"])


def sizes(draws: np.ndarray, cold: float, warm: float) -> dict[str, float]:
    """The least effective sizes of draws (chain, draw, d), bulk and tail, and CPU seconds."""
    each = [draws[..., i] for i in range(draws.shape[-1])]
    return {
        "bulk": min(map(ess_bulk, each)), "tail": min(map(ess_tail, each)), "cold": cold, "warm": warm,
        **{f"mean {i}": float(x.mean()) for i, x in enumerate(each)},
        **{f"error {i}": float(x.std() / np.sqrt(ess_bulk(x))) for i, x in enumerate(each)},
    }  # fmt: skip


@lru_cache
def ours() -> dict[str, float]:
    posterior, mode = problem()
    times, found = [], None
    for seed in (1, 2):  # the first compiles
        began = time.process_time()
        settings = Settings(chains=CHAINS, warmup=WARMUP, draws=DRAWS, seed=seed)
        found = SAMPLERS.get("nuts").sample(posterior, mode, settings)
        times.append(time.process_time() - began)
    assert found is not None
    return sizes(np.abs(found.draws), *times)


def natural(posterior: Target, z: np.ndarray) -> np.ndarray:
    """Scores (..., d) as the parameters themselves."""
    return np.abs(np.stack([np.asarray(v) for v in posterior.values(z).values()], axis=-1))


@lru_cache
def blackjax_nuts() -> dict[str, float]:
    """Its window adaptation and NUTS, a dense mass matrix, chains one by one in one program, in units of the
    posterior's sds: in the scores' own its adaptation came to a tenth of the effective size."""
    import blackjax

    posterior, mode = problem()
    centre, scale = jnp.asarray(mode.z), jnp.asarray(np.linalg.norm(mode.factor, axis=1))
    of_scores = partial(value_and_gradient, posterior.layout, mode.context)

    def slopes(v):
        value, gradient = of_scores(centre + scale * v)
        return value, scale * gradient

    @jax.custom_vjp
    def density(z):
        return slopes(z)[0]

    density.defvjp(slopes, lambda gradient, c: (c * gradient,))

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

    rng, times, draws = np.random.default_rng(2), [], None
    starts = rng.standard_normal((CHAINS, mode.z.size)) @ mode.factor.T / np.asarray(scale)
    for seed in (1, 2):
        began = time.process_time()
        keys = jax.random.split(jax.random.PRNGKey(seed), CHAINS)
        draws = np.stack([np.asarray(chain(k, jnp.asarray(s))) for k, s in zip(keys, starts, strict=True)])
        times.append(time.process_time() - began)
    assert draws is not None
    return sizes(natural(posterior, np.asarray(centre + scale * draws)), *times)


@lru_cache
def pints_adaptive() -> dict[str, float]:
    """Haario and Bardenet's adaptive chains, PINTS's usual choice, on a likelihood by odeint."""
    import pints

    posterior, mode = problem()
    t, y = posterior.signal.t, posterior.signal.y

    def slope(state, _, zeta, stiffness):
        return state[1], -2 * zeta * state[1] - stiffness * state[0] + np.cos(state[0])

    class Density(pints.LogPDF):
        def n_parameters(self) -> int:
            return mode.z.size

        def __call__(self, z: np.ndarray) -> float:
            p = {n: float(v) for n, v in posterior.values(np.asarray(z)).items()}
            start = [p["theta0"], p["omega0"]]
            rates = p["zeta"], p["stiffness"]
            theta = odeint(slope, start, t, args=rates, rtol=1e-8, atol=1e-10)[:, 0]
            r = (y - theta) / p["noise_sd"]
            return float(-0.5 * r @ r - t.size * np.log(p["noise_sd"]) - 0.5 * z @ z)

    np.random.seed(5)
    starts = list(mode.z + np.random.default_rng(2).standard_normal((3, mode.z.size)) @ mode.factor.T)
    run = pints.MCMCController(Density(), 3, starts, method=pints.HaarioBardenetACMC)
    run.set_max_iterations(STEPS)
    run.set_log_to_screen(False)
    began = time.process_time()
    draws = np.asarray(run.run())[:, STEPS // 2 :]
    spent = time.process_time() - began
    return sizes(natural(posterior, draws), spent, spent)


PEERS = {"blackjax": blackjax_nuts, "pints": pints_adaptive}


def missing(peer: str) -> None:
    if not find_spec(peer):
        pytest.skip(f"{peer} is not installed: pip install bayesdamp[bench]")


@pytest.mark.parametrize("peer", PEERS)
def test_effective_sizes(peer: str) -> None:
    missing(peer)
    posterior, _ = problem()
    mine, their = ours(), PEERS[peer]()
    rows = []
    for kind in ("bulk", "tail"):
        for when in ("cold", "warm"):
            rates = [m[kind] / m[when] for m in (mine, their)]
            ratio(f"effective samples a second, {kind}, {when}: ours / {peer}", rates[0] / rates[1])
            rows.append([kind, when, *(f"{r:.0f}" for r in rates), f"{rates[0] / rates[1]:.1f}"])
    header = ["of", "compilation", "ours a CPU s", f"{peer}'s", "ratio"]
    table(f"Effective samples a second beside {peer}", header, rows)
    for i in range(len(posterior.names)):
        apart = abs(mine[f"mean {i}"] - their[f"mean {i}"])
        assert apart < APART * np.hypot(mine[f"error {i}"], their[f"error {i}"])


def test_evidence_beside_dynesty() -> None:
    """Likelihoods for an evidence of equal error: those of dynesty times the square of the errors' ratio."""
    missing("dynesty")
    import dynesty

    posterior, mode = problem()
    reflected = np.asarray(posterior.layout.reflected)
    mine = EVIDENCES.get("importance").evidence("m", posterior, mode, 1)
    one = jax.jit(partial(log_likelihood, posterior.layout))
    sampler = dynesty.NestedSampler(
        lambda z: float(one(mode.context.compact, z)),
        lambda u: scores(u, reflected),
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
