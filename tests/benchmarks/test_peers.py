"""BlackJAX and PINTS beside NUTS of this package, bulk and tails; dynesty beside importance sampling. The posterior is
that of the paper's viscous pendulum in `test_sampler`; each is set up as its documentation does it."""

from __future__ import annotations

import time
import warnings
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ndtri

from bayesdamp.inference.diagnostics import ess_bulk, ess_tail
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.model.target import Target
from tests.benchmarks import test_sampler
from tests.benchmarks.ledger import ratio
from tests.benchmarks.test_sampler import CHAINS, DRAWS, WARMUP, on_diffrax, on_odeint, problem
from tests.benchmarks.timing import table

STEPS = 2500
"""Of PINTS's chains, of which the first half is left out."""
APART = 4.5
"""Monte Carlo standard errors: a false-alarm rate below 1e-4 over five parameters."""


def sizes(draws: np.ndarray, cold: float, warm: float) -> dict[str, float]:
    """The least effective sizes of draws (chain, draw, d), bulk and tail, and CPU seconds."""
    each = [draws[..., i] for i in range(draws.shape[-1])]
    return {
        "bulk": min(map(ess_bulk, each)), "tail": min(map(ess_tail, each)), "cold": cold, "warm": warm,
        **{f"mean {i}": float(x.mean()) for i, x in enumerate(each)},
        **{f"error {i}": float(x.std() / np.sqrt(ess_bulk(x))) for i, x in enumerate(each)},
    }  # fmt: skip


def ours() -> dict[str, float]:
    found, times = test_sampler.ours()
    return sizes(found.draws, *times)


def natural(posterior: Target, z: np.ndarray) -> np.ndarray:
    """Scores (..., d) as the parameters themselves."""
    return np.stack(list(posterior.values(z).values()), axis=-1)


@lru_cache
def blackjax_nuts() -> dict[str, float]:
    """Its window adaptation and NUTS on diffrax, a dense mass matrix, chains one by one in one program."""
    blackjax = pytest.importorskip("blackjax")
    posterior, mode = problem()
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

    rng, times, draws = np.random.default_rng(2), [], None
    starts = rng.standard_normal((CHAINS, mode.z.size)) @ mode.factor.T / sds
    for seed in (1, 2):
        began = time.process_time()
        keys = jax.random.split(jax.random.PRNGKey(seed), CHAINS)
        draws = np.stack([np.asarray(chain(k, jnp.asarray(s))) for k, s in zip(keys, starts, strict=True)])
        times.append(time.process_time() - began)
    assert draws is not None
    return sizes(natural(posterior, mode.z + sds * draws), *times)


@lru_cache
def pints_adaptive() -> dict[str, float]:
    """Haario and Bardenet's adaptive chains, PINTS's usual choice, on a likelihood by odeint."""
    pints = pytest.importorskip("pints")
    posterior, mode = problem()

    class Density(pints.LogPDF):
        def n_parameters(self) -> int:
            return mode.z.size

        def __call__(self, z: np.ndarray) -> float:
            return on_odeint(z)

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


@pytest.mark.parametrize("peer", PEERS)
def test_effective_sizes(peer: str) -> None:
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
