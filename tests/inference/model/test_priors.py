"""Priors: densities, scores and their inverses against SciPy's distributions, and refusals."""

import math

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy import stats

from bayesdamp.priors import HalfNormal, LogNormal, LogUniform, Normal, Prior, Uniform

PRIORS = {
    "normal": (Normal(mean=-0.3, sd=2.0), stats.norm(-0.3, 2.0)),
    "halfnormal": (HalfNormal(scale=0.2), stats.halfnorm(scale=0.2)),
    "lognormal": (LogNormal(median=3.0, sigma=0.7), stats.lognorm(0.7, scale=3.0)),
    "uniform": (Uniform(low=-1.0, high=3.0), stats.uniform(-1.0, 4.0)),
    "loguniform": (LogUniform(low=0.01, high=5.0), stats.loguniform(0.01, 5.0)),
}


@pytest.mark.parametrize("name", PRIORS)
def test_density_and_scores_against_scipy(name):
    """Scores are normal with the probabilities of the distribution; half-normals are reflected at zero."""
    prior, law = PRIORS[name]
    x = np.asarray(law.ppf(np.linspace(0.001, 0.999, 41)))
    np.testing.assert_allclose(np.asarray(prior.log_density(x)), law.logpdf(x), atol=1e-10)
    h = 1e-6
    slope = (law.logpdf(x + h) - law.logpdf(x - h)) / (2 * h)
    np.testing.assert_allclose(prior.slope(x), slope, rtol=1e-5, atol=1e-6)
    for end in (law.support()[0] - 0.1, law.support()[1] + 0.1):
        assert float(prior.log_density(end)) == -math.inf or not math.isfinite(end)
    z = prior.score(x)
    share = 0.5 * (1 + law.cdf(x)) if prior.reflected else law.cdf(x)
    np.testing.assert_allclose(np.asarray(z), stats.norm.ppf(share), atol=1e-8)
    np.testing.assert_allclose(np.asarray(prior.value(z)), x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(np.asarray(prior.transform(z, *prior.numbers)), x, rtol=1e-10, atol=1e-12)


def test_only_half_normals_are_reflected():
    assert [name for name, (prior, _) in PRIORS.items() if prior.reflected] == ["halfnormal"]
    assert float(HalfNormal(scale=0.1).value(-2.0)) == float(HalfNormal(scale=0.1).value(2.0)) == 0.2


def test_scores_at_the_ends_are_finite():
    for prior, law in (PRIORS["uniform"], PRIORS["loguniform"]):
        assert np.all(np.isfinite(np.asarray(prior.score(np.array(law.support())))))


@pytest.mark.parametrize("table", [
    {"prior": "normal", "mean": 0.0, "sd": -1.0}, {"prior": "uniform", "low": 2.0, "high": 1.0},
    {"prior": "loguniform", "low": 0.0, "high": 1.0}, {"prior": "halfnormal", "scale": float("nan")},
    {"prior": "halfnormal", "scale": 1.0, "sd": 1.0}, {"prior": "cauchy", "scale": 1.0},
])  # fmt: skip
def test_invalid_priors_are_refused(table):
    with pytest.raises(ValidationError):
        TypeAdapter(Prior).validate_python(table)


def test_a_very_large_score_has_a_finite_value() -> None:
    """Proposals with heavy tails draw such scores."""
    assert math.isfinite(LogNormal.transform(2000.0, 1.0, 1.0))
