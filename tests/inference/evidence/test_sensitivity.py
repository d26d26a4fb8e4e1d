"""What the evidence depends on: against quadrature under other priors, on half the record, and at zero."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import truncnorm

from bayesdamp.inference.checks import predict_second_half
from bayesdamp.inference.evidence.importance import Importance
from bayesdamp.inference.sensitivity import (
    density_at_zero,
    evidence_by_prior_width,
    first_half,
    log_predictive,
    predict_from_half,
    savage_dickey,
    under_priors,
)
from bayesdamp.priors import HalfNormal, Normal
from bayesdamp.types import Evidence
from tests.inference.evidence.weighing_problems import (
    CASES,
    KNOWN,
    LIMIT,
    PRIORS,
    TIMES,
    exact_draws,
    log_density,
    posterior_grid,
    problem,
    quadrature,
    trajectories,
)

TWO = "two touching"


def under_width(factor: float) -> float:
    """log evidence by quadrature with both half-normal priors that much wider."""
    axes, logs = posterior_grid(TWO, 56)
    for i, (name, axis) in enumerate(zip(("zeta", "mu_c"), axes)):
        other = HalfNormal(scale=factor * PRIORS[name].scale)
        along = np.asarray(other.log_density(axis)) - np.asarray(PRIORS[name].log_density(axis))
        logs = logs + along.reshape((-1, 1) if i == 0 else (1, -1))
    return float(logsumexp(logs))


def importance(case: str) -> Evidence:
    target, mode = problem(case)
    return Importance().evidence("m", target, mode, 1)


def test_widths_against_quadrature():
    target, mode = problem(TWO)
    evidence = importance(TWO)
    y, log_weights = evidence.arrays["y"], evidence.arrays["log_weights"]
    built = evidence_by_prior_width(
        target.priors, ("zeta", "mu_c"), y, log_weights, lambda priors: under_priors(mode, priors), 1
    )
    exact = np.array([under_width(f) for f in built.factors])
    assert built.varied == ("zeta", "mu_c")
    assert built.factors[0] == pytest.approx(0.1)
    assert built.factors[-1] == pytest.approx(10.0)
    assert np.all(built.trusted)
    assert not np.any(built.anew[built.factors >= 1.0])
    # Five standard errors: false-alarm rate 1e-5.
    off = np.abs(built.log_evidence - exact)
    assert np.all(off < 5 * built.stderr + 2e-3)
    assert np.all(off[~built.anew] < LIMIT)
    # Negative control: prior densities without their constants would miss a log factor for each coefficient.
    flat = built.log_evidence + 2 * np.log(built.factors)
    assert np.all(np.abs(flat - exact)[np.abs(np.log(built.factors)) > 0.1] > LIMIT)


def test_the_first_half_against_quadrature():
    mode, half = problem("one far")[1], TIMES.size // 2
    predict = partial(predict_second_half, mode.likelihood, half=half)
    result, _ = predict_from_half("m", first_half(mode), predict, 1)
    nodes, weights = np.polynomial.legendre.leggauss(80)
    low, high = 0.0, 0.3
    mu = low + 0.5 * (high - low) * (nodes + 1)
    square = np.sum((CASES["one far"][1] - trajectories(np.zeros(80), mu))[:, :half] ** 2, axis=1)
    logs = log_density(square, KNOWN["noise_sd"], half) + np.asarray(PRIORS["mu_c"].log_density(mu))
    exact = float(logsumexp(logs + np.log(0.5 * (high - low) * weights)))
    assert abs(result.log_evidence - exact) < LIMIT
    ahead, error = log_predictive(importance("one far"), result)
    assert abs(ahead - (quadrature("one far") - exact)) < LIMIT
    assert error < LIMIT / 2


@pytest.mark.parametrize("mean", [-1.0, 1.0])
def test_density_at_zero_of_cut_off_normals(mean):
    """Twenty samples each: their mean within 4 of its errors (6e-5), their scatter as stated (99.9 % of chi²/19)."""
    law, rng = truncnorm(-mean, np.inf, loc=mean), np.random.default_rng(5)
    drawn = np.array(
        [density_at_zero(law.rvs(4000, random_state=rng), 4000.0, np.ones(4000)) for _ in range(20)]
    )
    off = drawn[:, 0] - law.logpdf(0.0)
    assert abs(off.mean()) < 4 * drawn[:, 1].mean() / np.sqrt(20)
    assert 0.28 < np.var(off, ddof=1) / np.mean(drawn[:, 1] ** 2) < 2.4


def test_savage_dickey_with_a_shared_scale():
    """Within four standard errors of quadrature. Negative control: the plain ratio of posterior to prior density at
    zero, which takes the other coefficient's prior for that of the smaller model."""
    target, _ = problem("two shared")
    draws = exact_draws("two shared", 1).z
    scores = dict(zip(target.names, np.moveaxis(draws, -1, 0), strict=True))
    ratio = savage_dickey(target.priors, "mu_c", scores)
    wanted = quadrature("one shared") - quadrature("two shared")
    assert ratio.outcome == "ok"
    assert ratio.stderr < 0.2
    assert ratio.log_bayes_factor == pytest.approx(wanted, abs=4 * ratio.stderr + 0.03)
    alone = savage_dickey({"mu_c": target.priors["mu_c"]}, "mu_c", scores)
    assert abs(alone.log_bayes_factor - wanted) > 4 * ratio.stderr + 0.03


def test_savage_dickey_says_where_it_is_not_valid():
    target, _ = problem("one far")
    y = exact_draws("one far", 1).z
    scores = {"mu_c": y[..., 0]}
    far = savage_dickey(target.priors, "mu_c", scores)
    assert far.outcome.startswith("not applicable: the log Bayes factor is beyond 5 nats")
    other = savage_dickey({"mu_c": Normal(mean=0.1, sd=0.1)}, "mu_c", scores)
    assert other.outcome == "not applicable: the coefficient has no draws or no half-normal prior"
