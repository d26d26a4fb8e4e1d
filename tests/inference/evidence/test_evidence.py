"""Evidence against quadrature over the natural parameters, with a likelihood by other means."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.evidence import EVIDENCES, Draws, EvidenceMethod, nested
from bayesdamp.inference.evidence.bridge import bridge
from bayesdamp.inference.mode import log_evidence_near
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.numerics.orthant import ReflectedT
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
def test_against_quadrature(case, method):
    result = evidence(case, method)
    assert result.outcome == "ok", result
    assert abs(result.log_evidence - quadrature(case)) < LIMIT
    assert result.stderr < LIMIT / 2


@pytest.mark.parametrize("case", CASES)
def test_nested_sampling_around_the_mode_against_quadrature(case, monkeypatch):
    """As where from the prior it would take too long. Negative control: with the half-normal priors' two left out."""
    monkeypatch.setattr(nested, "LIKELIHOODS_PER_CHECK", 1)  # it asks at once
    monkeypatch.setattr(nested, "log_evidence_about", lambda *_: -1e9)  # and has a billion nats to go
    monkeypatch.setattr(nested, "EFFECTIVE_DRAWS", 10_000)
    target, mode = problem(case)
    result = EVIDENCES.get("nested").evidence("model", target, mode, 1)
    assert result.outcome == "ok", result
    assert "around the mode" in result.diagnostic
    assert abs(result.log_evidence - quadrature(case)) < LIMIT
    reflected = int(np.sum(target.reflected))
    assert abs(result.log_evidence - reflected * np.log(2.0) - quadrature(case)) > LIMIT


@pytest.mark.parametrize("method", METHODS)
def test_contract(method):
    plugin = EVIDENCES.get(method)
    assert isinstance(plugin, EvidenceMethod)
    assert plugin.name == method
    case = "two touching"
    result, other = evidence(case, method), evidence(case, method, 2)
    assert (result.method, result.model) == (method, "model")
    assert result.diagnostic
    assert result.evaluations > 0
    evidence.cache_clear()
    again = evidence(case, method)
    assert (again.log_evidence, again.stderr) == (result.log_evidence, result.stderr)
    assert other.log_evidence != result.log_evidence
    # Two seeds within five standard errors of each other: false-alarm rate below 1e-6.
    assert abs(other.log_evidence - result.log_evidence) < 5 * np.hypot(result.stderr, other.stderr)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["importance", "bridge"])
def test_stated_error_is_honest(method):
    """Thirty seeds on one target: their scatter is the stated standard error (99.9 % bounds of chi²/29)."""
    values = [evidence("two touching", method, seed) for seed in range(30)]
    ratio = np.var([v.log_evidence for v in values], ddof=1) / np.mean([v.stderr**2 for v in values])
    assert 0.40 < ratio < 2.1


def chain_ratio(shuffled: bool) -> float:
    """Variance of 150 bridges between normals one sd apart, over the variance that they state; the draws come from
    chains whose neighbours correlate by 0.9, in their order or shuffled."""
    rng = np.random.default_rng(3)
    collected = []
    for _ in range(150):
        x = rng.standard_normal((4, 400))
        for i in range(1, 400):
            x[:, i] = 0.9 * x[:, i - 1] + np.sqrt(1 - 0.81) * x[:, i]
        if shuffled:
            x = rng.permutation(x.ravel()).reshape(x.shape)
        collected.append(bridge(x + 0.5, rng.standard_normal(1000) - 0.5))
    logs, errors = np.array([(s.log_evidence, s.stderr) for s in collected]).T
    return float(np.var(logs, ddof=1) / np.mean(errors**2))


def test_bridge_counts_autocorrelation():
    """99.9 % bounds of chi²/149; shuffled chains, the negative control, claim to know too much."""
    assert 0.66 < chain_ratio(shuffled=False) < 1.43
    assert chain_ratio(shuffled=True) > 1.43


def test_bridge_distrusts_halves_that_disagree():
    """Negative control: chains that have moved on to somewhere else by their second half."""
    target, mode = problem("one far")
    z = exact_draws("one far", 1).z.copy()
    z[:, 500:] += 3 * mode.sd()
    result = EVIDENCES.get("bridge").evidence("m", target, mode, 1, Draws(z))
    assert result.outcome.startswith("not to be trusted")


@pytest.mark.parametrize("case", ["two touching", "one far"])
def test_negative_control_no_mirror_images(case):
    """A proposal on one side of an unfolded score: log 2 a coefficient is lost where all are far from zero, unseen
    by the weights; near zero what is lost is some part of it."""
    _target, mode = problem(case)
    proposal = ReflectedT(mode.z, mode.factor, np.zeros(mode.z.size, bool))
    z = proposal.draw(np.random.default_rng(1), 4000)
    weights = mode.likelihood.log_posteriors(z) - proposal.log_density(z)
    result = float(logsumexp(weights) - np.log(weights.size))
    if case == "one far":
        assert quadrature(case) - result == pytest.approx(np.log(2), abs=LIMIT)
    assert abs(result - quadrature(case)) > LIMIT


def test_laplaces_method_against_quadrature():
    for case in ("one far", "one shared", "two shared"):
        mode = problem(case)[1]
        assert log_evidence_near(mode.likelihood, mode.z) == pytest.approx(quadrature(case), abs=2 * LIMIT)


def test_nuts_under_a_shared_scale_against_quadrature():
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
