"""The evidence under other priors and of half the record, and ratios of densities at zero, against quadrature."""

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
    """Return the log evidence by quadrature with both half-normal priors wider by this factor."""
    axes, logs = posterior_grid(TWO, 56)
    for i, (name, axis) in enumerate(zip(("zeta", "mu_c"), axes)):
        other = HalfNormal(scale=factor * PRIORS[name].scale)
        along = np.asarray(other.log_density(axis)) - np.asarray(PRIORS[name].log_density(axis))
        logs = logs + along.reshape((-1, 1) if i == 0 else (1, -1))
    return float(logsumexp(logs))


def importance_evidence(case: str) -> Evidence:
    target, mode = problem(case)
    return Importance().evidence("m", target, mode, 1)


def test_evidence_under_wider_and_narrower_priors_is_that_of_quadrature():
    """Within five standard errors (false alarm 1e-5). Negative control: prior densities without their constants would
    miss the log of the factor for each coefficient."""
    target, mode = problem(TWO)
    evidence = importance_evidence(TWO)
    y, log_weights = evidence.arrays["y"], evidence.arrays["log_weights"]
    widths = evidence_by_prior_width(
        target.priors, ("zeta", "mu_c"), y, log_weights, lambda priors: under_priors(mode, priors), 1
    )
    exact = np.array([under_width(f) for f in widths.factors])
    assert widths.varied == ("zeta", "mu_c")
    assert widths.factors[0] == pytest.approx(0.1)
    assert widths.factors[-1] == pytest.approx(10.0)
    assert np.all(widths.trusted)
    assert not np.any(widths.anew[widths.factors >= 1.0])
    off = np.abs(widths.log_evidence - exact)
    assert np.all(off < 5 * widths.stderr + 2e-3)
    assert np.all(off[~widths.anew] < LIMIT)
    flat = widths.log_evidence + 2 * np.log(widths.factors)
    assert np.all(np.abs(flat - exact)[np.abs(np.log(widths.factors)) > 0.1] > LIMIT)


def test_the_evidence_of_the_first_half_and_the_prediction_of_the_second_are_those_of_quadrature():
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
    ahead, error = log_predictive(importance_evidence("one far"), result)
    assert abs(ahead - (quadrature("one far") - exact)) < LIMIT
    assert error < LIMIT / 2


@pytest.mark.parametrize("mean", [-1.0, 1.0])
def test_the_density_at_zero_of_truncated_normals_is_the_closed_form(mean):
    """For twenty samples: the mean within four of its errors (6e-5), the scatter as stated (99.9 % of chi²/19)."""
    law, rng = truncnorm(-mean, np.inf, loc=mean), np.random.default_rng(5)
    drawn = np.array(
        [density_at_zero(law.rvs(4000, random_state=rng), 4000.0, np.ones(4000)) for _ in range(20)]
    )
    off = drawn[:, 0] - law.logpdf(0.0)
    assert abs(off.mean()) < 4 * drawn[:, 1].mean() / np.sqrt(20)
    assert 0.28 < np.var(off, ddof=1) / np.mean(drawn[:, 1] ** 2) < 2.4


def test_savage_dickey_with_a_shared_scale_is_the_ratio_of_evidences_by_quadrature():
    """Within four standard errors. Negative control: the plain ratio of posterior to prior density at zero, which
    assumes that the smaller model has the same prior of the other coefficient."""
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


def test_savage_dickey_refuses_zeros_far_away_and_other_priors():
    target, _ = problem("one far")
    y = exact_draws("one far", 1).z
    scores = {"mu_c": y[..., 0]}
    far = savage_dickey(target.priors, "mu_c", scores)
    assert far.outcome.startswith("not applicable: the log Bayes factor is beyond 5 nats")
    other = savage_dickey({"mu_c": Normal(mean=0.1, sd=0.1)}, "mu_c", scores)
    assert other.outcome == "not applicable: the coefficient has no draws or no half-normal prior"
