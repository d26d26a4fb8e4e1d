"""Evidence against quadrature over the natural parameters, with a likelihood by an independent solver."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.evidence import EVIDENCES, Draws, nested
from bayesdamp.inference.evidence.bridge import bridge
from bayesdamp.inference.mode import log_evidence_about
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.types import Evidence
from tests.inference.evidence.weighing_problems import (
    CASES,
    LIMIT,
    exact_draws,
    posterior_grid,
    problem,
    quadrature,
)

METHODS = [
    pytest.param(m, marks=[pytest.mark.slow] if m == "nested" else [])
    for m in EVIDENCES.names()
    if not EVIDENCES.get(m).approximate
]


@lru_cache
def evidence(case: str, method: str, seed: int = 1) -> Evidence:
    target, mode = problem(case)
    draws = exact_draws(case, seed) if EVIDENCES.get(method).needs_draws else None
    return EVIDENCES.get(method).evidence("model", target, mode, seed, draws)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES)
def test_evidence_is_that_of_quadrature(case, method):
    result = evidence(case, method)
    assert result.outcome == "ok", result
    assert abs(result.log_evidence - quadrature(case)) < LIMIT
    assert result.stderr < LIMIT / 2


@pytest.mark.parametrize("case", CASES)
def test_evidence_of_nested_sampling_around_the_mode_is_that_of_quadrature(case, monkeypatch):
    """This is used if sampling from the prior takes too long, which is pretended here. Negative control: without the
    factor of two of each half-normal prior, the evidence is another one."""
    monkeypatch.setattr(nested, "LIKELIHOODS_PER_CHECK", 1)
    monkeypatch.setattr(nested, "log_evidence_about", lambda *_: -1e9)
    monkeypatch.setattr(nested, "EFFECTIVE_DRAWS", 10_000)
    target, mode = problem(case)
    result = EVIDENCES.get("nested").evidence("model", target, mode, 1)
    assert result.outcome == "ok", result
    assert "around the mode" in result.diagnostic
    assert abs(result.log_evidence - quadrature(case)) < LIMIT
    reflected = int(np.sum(target.reflected))
    assert abs(result.log_evidence - reflected * np.log(2.0) - quadrature(case)) > LIMIT


@pytest.mark.slow
@pytest.mark.parametrize("method", ["importance", "bridge"])
def test_the_stated_error_is_the_scatter_over_seeds(method):
    """Thirty seeds (99.9 % bounds of chi²/29)."""
    values = [evidence("two touching", method, seed) for seed in range(30)]
    ratio = np.var([v.log_evidence for v in values], ddof=1) / np.mean([v.stderr**2 for v in values])
    assert 0.40 < ratio < 2.1


def chain_ratio(shuffled: bool) -> float:
    """Return the variance of 150 bridges between normals that are one sd apart, over the variance that they state. The
    draws come from chains whose neighbours correlate by 0.9, in their order or shuffled."""
    rng = np.random.default_rng(3)
    bridges = []
    for _ in range(150):
        x = rng.standard_normal((4, 400))
        for i in range(1, 400):
            x[:, i] = 0.9 * x[:, i - 1] + np.sqrt(1 - 0.81) * x[:, i]
        if shuffled:
            x = rng.permutation(x.ravel()).reshape(x.shape)
        bridges.append(bridge(x + 0.5, rng.standard_normal(1000) - 0.5))
    logs, errors = np.array([(s.log_evidence, s.stderr) for s in bridges]).T
    return float(np.var(logs, ddof=1) / np.mean(errors**2))


def test_the_error_of_a_bridge_allows_for_autocorrelation():
    """99.9 % bounds of chi²/149. Negative control: shuffled chains have too small an error."""
    assert 0.66 < chain_ratio(shuffled=False) < 1.43
    assert chain_ratio(shuffled=True) > 1.43


def test_a_bridge_is_not_trusted_if_the_halves_of_the_chains_disagree():
    """The second halves are three sds away."""
    target, mode = problem("one far")
    z = exact_draws("one far", 1).z.copy()
    z[:, 500:] += 3 * mode.sd()
    result = EVIDENCES.get("bridge").evidence("m", target, mode, 1, Draws(z))
    assert result.outcome.startswith("not to be trusted")


def test_evidence_of_laplaces_method_is_that_of_quadrature():
    for case in ("one far", "one shared", "two shared"):
        assert log_evidence_about(problem(case)[1]) == pytest.approx(quadrature(case), abs=2 * LIMIT)


def test_draws_of_nuts_under_a_shared_scale_are_those_of_quadrature():
    """Means within five Monte Carlo errors, sds within 5 %."""
    target, mode = problem("two shared")
    posterior = SAMPLERS.get("nuts").sample(target, mode, Settings(draws=1000, seed=3))
    axes, logs = posterior_grid("two shared", 56)
    mass = np.exp(logs - logsumexp(logs))
    for i, (name, axis) in enumerate(zip(target.names, axes, strict=True)):
        p = mass.sum(axis=1 - i)
        mean, sd = p @ axis, np.sqrt(p @ axis**2 - (p @ axis) ** 2)
        error = sd / np.sqrt(posterior.summaries[name]["ess_bulk"])
        assert posterior.draws[..., i].mean() == pytest.approx(mean, abs=5 * error)
        assert posterior.draws[..., i].std() == pytest.approx(sd, rel=0.05)
