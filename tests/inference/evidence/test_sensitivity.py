"""What the evidence depends on: against quadrature under other priors, on half the record, and at zero."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import gaussian_kde, truncnorm

from bayesdamp.inference.checks.forecast import Ahead, carried_on
from bayesdamp.inference.evidence import sensitivity
from bayesdamp.inference.evidence.methods.importance import Importance
from bayesdamp.inference.evidence.savage_dickey import density_at_zero, savage_dickey
from bayesdamp.inference.evidence.sensitivity import (
    against_width,
    first_half,
    log_predictive,
    predict,
    under_priors,
    widened,
)
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Uniform
from bayesdamp.types import Evidence, Seed, Signal
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
    squares,
    trajectories,
)

TWO = "two touching"


def under_width(factor: float) -> float:
    """log evidence by quadrature with both half-normal priors that much wider."""
    axes, logs = posterior_grid(TWO, 56)
    for i, (name, axis) in enumerate(zip(("zeta", "mu_c"), axes)):
        other = HalfNormal(scale=factor * PRIORS[name].scale)  # type: ignore[union-attr]
        along = np.asarray(other.log_density(axis)) - np.asarray(PRIORS[name].log_density(axis))
        logs = logs + along.reshape((-1, 1) if i == 0 else (1, -1))
    return float(logsumexp(logs))


def importance(case: str) -> Evidence:
    target, mode = problem(case)
    return Importance().evidence("m", target, mode, 1)


def halves(target: Target, mode: Mode) -> tuple[Evidence, Ahead]:
    half = target.signal.t.size // 2
    return predict("m", first_half(mode), partial(carried_on, mode.likelihood, half=half), 1)


@pytest.mark.parametrize("enough", [sensitivity.ENOUGH, np.inf], ids=["as it comes", "all sampled anew"])
def test_widths_against_quadrature(enough, monkeypatch):
    monkeypatch.setattr(sensitivity, "ENOUGH", enough)
    target, mode = problem(TWO)
    evidence = importance(TWO)
    y, log_weights = evidence.arrays["y"], evidence.arrays["log_weights"]
    built = against_width(
        target.priors, ("zeta", "mu_c"), y, log_weights, lambda priors: under_priors(mode, priors), 1
    )
    exact = np.array([under_width(f) for f in built.factors])
    assert built.varied == ("zeta", "mu_c")
    assert built.factors[0] == pytest.approx(0.1)
    assert built.factors[-1] == pytest.approx(10.0)
    assert np.all(built.trusted)
    assert np.all(built.anew) if np.isinf(enough) else not np.any(built.anew[built.factors >= 1.0])
    # Five standard errors: false-alarm rate 1e-5.
    off = np.abs(built.log_evidence - exact)
    assert np.all(off < 5 * built.stderr + 2e-3)
    assert np.all(off[~built.anew] < LIMIT)
    # Negative control: prior densities without their constants would miss a log factor for each coefficient.
    flat = built.log_evidence + 2 * np.log(built.factors)
    assert np.all(np.abs(flat - exact)[np.abs(np.log(built.factors)) > 0.1] > LIMIT)


def test_only_scales_are_widened():
    assert widened(HalfNormal(scale=0.2), 3.0) == HalfNormal(scale=0.2 * 3.0)
    assert widened(LogNormal(median=0.2, sigma=0.5), 2.0) == LogNormal(median=0.2, sigma=1.0)
    assert widened(Uniform(low=0.0, high=1.0), 2.0) is None


def test_the_first_half_against_quadrature():
    target, mode = problem("one far")
    result, _ = halves(target, mode)
    half = TIMES.size // 2
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


def test_the_second_half_is_inside_its_interval_and_a_changed_one_is_not():
    """76 samples: 95 % of them give or take 8 % is a false-alarm rate below 2e-3. Negative control: a record whose
    second half was shifted by three sds of the noise."""
    target, mode = problem("one far")
    _, good = halves(target, mode)
    assert good.error.shape == good.sd.shape == (TIMES.size - TIMES.size // 2,)
    assert good.coverage > 0.87
    assert 0.75 < good.rms / good.expected < 1.25
    y = target.signal.y.copy()
    y[TIMES.size // 2 :] += 3 * KNOWN["noise_sd"]
    changed = replace(target, signal=Signal(TIMES, y))
    _, bad = halves(changed, find_mode(changed, {Seed("s"): {"mu_c": 0.1}}, noise_level=0.02))
    assert bad.coverage < 0.4
    assert bad.rms / bad.expected > 2


@pytest.mark.parametrize("mean", [-1.0, 0.0, 1.0, 2.0])
def test_density_at_zero_of_cut_off_normals(mean):
    """Twenty samples each: their mean within 4 of its errors (6e-5), their scatter as stated (99.9 % of chi²/19)."""
    law, rng = truncnorm(-mean, np.inf, loc=mean), np.random.default_rng(5)
    drawn = np.array([density_at_zero(law.rvs(4000, random_state=rng), 4000.0) for _ in range(20)])
    off = drawn[:, 0] - law.logpdf(0.0)
    assert abs(off.mean()) < 4 * drawn[:, 1].mean() / np.sqrt(20)
    assert 0.28 < np.var(off, ddof=1) / np.mean(drawn[:, 1] ** 2) < 2.4


def smaller(parameter: str) -> float:
    """log evidence of one coefficient alone by quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    x = 0.15 * (nodes + 1)
    y, still = CASES[TWO][1], np.zeros(80)
    square = squares(y, x, still) if parameter == "zeta" else squares(y, still, x)
    logs = log_density(square, KNOWN["noise_sd"]) + np.asarray(PRIORS[parameter].log_density(x))
    return float(logsumexp(logs + np.log(0.15 * weights)))


@pytest.mark.parametrize(("without", "left"), [("zeta", "mu_c"), ("mu_c", "zeta")])
def test_savage_dickey_is_the_bayes_factor_of_a_nested_pair(without, left):
    """Within four standard errors (6e-5) of quadrature. Negative control: a kernel estimate that does not know where
    the axis ends loses half the density, log 2."""
    target, _ = problem(TWO)
    y = exact_draws(TWO, 1).z
    scores = dict(zip(target.names, np.moveaxis(y, -1, 0), strict=True))
    ratio = savage_dickey(target.priors, without, scores)
    exact = smaller(left) - quadrature(TWO)
    assert ratio.outcome == "ok"
    assert ratio.stderr < 0.2
    assert abs(ratio.log_bayes_factor - exact) < 4 * ratio.stderr
    blind = float(gaussian_kde(y[..., target.names.index(without)].ravel()).logpdf(0.0)[0])
    assert abs(blind - 0.5 * np.log(2 / np.pi) - exact) > 4 * ratio.stderr


def test_savage_dickey_says_where_it_is_not_valid():
    target, _ = problem("one far")
    y = exact_draws("one far", 1).z
    scores = {"mu_c": y[..., 0]}
    far = savage_dickey(target.priors, "mu_c", scores)
    assert far.outcome.startswith("not applicable: beyond 5 nats")
    other = savage_dickey({"mu_c": Normal(mean=0.1, sd=0.1)}, "mu_c", scores)
    assert other.outcome == "not applicable: its prior is not a half-normal"


@pytest.mark.parametrize("sd", [1e-4, 0.02])
def test_draws_far_from_zero_say_nothing_of_it(sd):
    """And nothing is warned of: the density there is given an endless error."""
    x = 1.0 + sd * np.random.default_rng(5).standard_normal(4000)
    assert density_at_zero(x, 4000.0)[1] == np.inf
    near = np.abs(sd * np.random.default_rng(5).standard_normal(4000))
    assert density_at_zero(near, 4000.0)[1] < 0.1  # the control
