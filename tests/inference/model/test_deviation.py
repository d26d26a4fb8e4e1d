"""The likelihood with deviations from the laws, against that of exact laws and against dense normal distributions."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Deviation
from bayesdamp.types import Refusal
from tests.inference.problems import FEATURES, linear_target
from tests.physics.independent import viscous

NOISE = 0.01
TIMES = np.linspace(0.0, 6.0, 120)
TRUTH = {"zeta": 0.05, "stiffness": 20.0, "theta0": 0.3}
KNOWN = {"omega0": 0.0, "noise_sd": NOISE}


@lru_cache
def exact() -> Likelihood:
    noise = NOISE * np.random.default_rng(3).standard_normal(TIMES.size)
    y = viscous(TIMES, TRUTH["zeta"], TRUTH["stiffness"] ** 0.5, TRUTH["theta0"]) + noise
    target = linear_target(TIMES, y, "viscous", KNOWN)
    return Likelihood.near(target, target.scores(TRUTH), 1e-8)


@lru_cache
def deviating(knots: int) -> Likelihood:
    """Return the likelihood with smooth deviations of so many knots, under two combinations of hyperparameters."""
    rng, columns = np.random.default_rng(5), np.polynomial.chebyshev.chebvander(TIMES / 3 - 1, knots)[:, 1:]
    basis, upper = np.linalg.qr(columns)
    maps = np.array([0.004, 0.03])[:, None, None] * rng.standard_normal((2, knots, knots))
    shift, effects = columns @ np.full(knots, 0.01), upper @ maps / NOISE
    noise = exact().motions, NOISE**2, TIMES.size
    deviation = Deviation(*noise, basis, shift, np.log([0.7, 0.3]), maps, effects, np.full(2, 0.5))
    return replace(exact(), target=replace(exact().target, deviation=deviation))


def scores() -> np.ndarray:
    return exact().target.scores(TRUTH) + 0.01 * np.random.default_rng(1).standard_normal((4, 3))


def test_without_knots_the_laws_are_exact() -> None:
    """Value, gradient and information agree to rounding. Control: with a knot they do not."""
    for z in scores():
        none, exactly, one_knot = (of.curvature(z) for of in (deviating(0), exact(), deviating(1)))
        for a, b, control in zip(none, exactly, one_knot, strict=True):
            assert a == pytest.approx(b, rel=1e-12, abs=1e-9)
            assert control != pytest.approx(b, rel=1e-6, abs=1e-6)
        assert deviating(0).log_likelihood(z) == pytest.approx(exact().log_likelihood(z), rel=1e-12)


def test_the_likelihood_is_that_of_a_mixture_of_dense_normal_distributions() -> None:
    """By SciPy. Control: that of the first combination alone is another one."""
    of, z = deviating(3), scores()[0]
    deviation = of.target.deviation
    r = of.residual(z) + deviation.shift
    logs = [stats.multivariate_normal(cov=covariance).logpdf(r) for covariance in dense(deviation)]
    assert of.log_likelihood(z) == pytest.approx(float(logsumexp(np.log([0.7, 0.3]) + logs)), rel=1e-9)
    assert of.log_likelihood(z) != pytest.approx(logs[0], abs=0.01)


def test_deviations_are_drawn_from_their_conditional_distribution() -> None:
    """Mean and covariance of 4,000 draws under one combination, within five standard errors, against the joint normal
    distribution. Control: the mean is far from the prior's, which is zero."""
    whole = deviating(2).target.deviation
    item = replace(whole, log_prior=np.zeros(1), maps=whole.maps[1:], effects=whole.effects[1:])
    r, rng = deviating(2).residual(scores()[0]), np.random.default_rng(2)
    drawn = np.array([item.draw_given(r, rng) for _ in range(4000)])
    prior = item.maps[0] @ item.maps[0].T
    columns = NOISE * item.basis @ item.effects[0] @ np.linalg.inv(item.maps[0])
    gain = prior @ columns.T @ np.linalg.inv(columns @ prior @ columns.T + NOISE**2 * np.eye(r.size))
    mean, covariance = gain @ (r + item.shift), prior - gain @ columns @ prior
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 5 * sd / np.sqrt(4000))
    assert np.cov(drawn.T) == pytest.approx(covariance, rel=0.1, abs=0.1 * float(sd.min()) ** 2)
    assert np.any(np.abs(mean) > 10 * sd / np.sqrt(4000))


def dense(deviation: Deviation) -> np.ndarray:
    """Return the covariance of record minus motion under each combination, (c, n, n)."""
    effects = deviation.basis @ deviation.effects * NOISE
    return NOISE**2 * np.eye(TIMES.size) + effects @ np.swapaxes(effects, 1, 2)


def test_whitening_and_information_are_those_of_the_dense_covariance() -> None:
    """Under one combination the scores are linear in the residuals, with unit covariance. Under two the information is
    the mean of the inverse covariances. Control: it is not that of the first alone."""
    whole = deviating(3).target.deviation
    whole = replace(whole, probabilities=np.array([0.2, 0.8]))
    covariances, gaps = dense(whole), np.diff(TIMES)
    for c in range(2):
        of = whole.under(c)
        zero = of.whiten(np.zeros(TIMES.size), gaps, {})
        linear = np.array([of.whiten(column, gaps, {}) - zero for column in np.eye(TIMES.size)]).T
        assert linear @ covariances[c] @ linear.T == pytest.approx(np.eye(TIMES.size), abs=1e-8)
        assert zero == pytest.approx(linear @ of.shift, abs=1e-8)
    v = np.stack([np.sin(2 * TIMES), np.cos(TIMES)])
    root = whole.information_root(v, gaps, {})
    each = [v @ np.linalg.solve(covariance, v.T) for covariance in covariances]
    assert root @ root.T == pytest.approx(0.2 * each[0] + 0.8 * each[1], rel=1e-8)
    assert root @ root.T != pytest.approx(each[0], rel=0.01)


def test_combinations_are_drawn_by_their_probabilities() -> None:
    """1,000 draws, within five standard errors, for residuals of several sizes, so that each combination is the most
    probable one for some of them. The whitened residuals are those of the most probable combination."""
    whole, rng, gaps = deviating(3).target.deviation, np.random.default_rng(4), np.diff(TIMES)
    most_probable = set()
    for size in (0.5, 1.0, 2.0, 4.0, 16.0):
        r = size * NOISE * whole.basis.sum(axis=1) - whole.shift
        normals = [stats.multivariate_normal(cov=covariance) for covariance in dense(whole)]
        logs = np.log([0.7, 0.3]) + [normal.logpdf(r + whole.shift) for normal in normals]
        best = int(np.argmax(logs))
        most_probable.add(best)
        assert whole.whiten(r, gaps, {}) == pytest.approx(whole.under(best).whiten(r, gaps, {}), abs=1e-12)
        p = float(np.exp(logs[1] - logsumexp(logs)))
        share = np.mean([whole.combination_given(r, rng) for _ in range(1000)])
        assert abs(share - p) < 5 * np.sqrt(p * (1 - p) / 1000) + 1e-3
    assert most_probable == {0, 1}


def test_a_mixture_has_no_density_of_single_samples() -> None:
    whole = deviating(3).target.deviation
    assert whole.priors(FEATURES) == whole.start(TIMES, np.diff(TIMES)) == {}
    with pytest.raises(Refusal, match="no sample has a density of its own"):
        whole.log_likelihoods(TIMES, np.diff(TIMES), {})
