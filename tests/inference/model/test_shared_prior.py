"""The prior of coefficients that share an unknown scale: normalised, with its slope."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.special import gammaln

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.priors import (
    SHARED_SIGMAS,
    Normal,
    SharedHalfNormal,
    joint_log_density,
    joint_slope,
    log_prior_of,
    shared_log_density,
    shared_precision,
)
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Reference, Signal, System

EVERY = ("viscous", "coulomb", "quadratic")
T = np.linspace(0.0, 5.0, 200)
NOISE = 0.003 * np.random.default_rng(0).standard_normal(T.size)
SIGNAL = Signal(T, 0.3 * np.exp(-0.05 * T) * np.cos(4.47 * T) + NOISE)
REFERENCE = Reference(0.3, 4.47)


def target(*damping: str) -> Target:
    system = System("linear", {"rest_angle": 0.0, "epsilon": 0.03}, {})
    return build_target(SIGNAL, damping, system, features(SIGNAL), REFERENCE)


def scores(target: Target, seed: int, size: float = 1.0) -> np.ndarray:
    z = target.scores(
        {"zeta": 0.05, "mu_c": 0.02, "mu_q": 0.04, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0}
    )
    rng = np.random.default_rng(seed)
    return np.where(target.shared, size * np.abs(rng.standard_normal(z.size)), z)


@pytest.mark.parametrize("count", [1, 3])
def test_the_joint_density_is_normalised(count) -> None:
    """Over the radius: a share 2^-count of a sphere. Negative control: that of one coefficient more."""
    surface = np.log(2) + 0.5 * count * np.log(np.pi) - gammaln(0.5 * count) - count * np.log(2.0)

    def total(n: int) -> float:
        def along(u: float) -> float:  # the logarithm of the radius
            return float(np.exp(shared_log_density(np.exp(2 * u), n) + surface + count * u))

        return sum(quad(along, a, a + 1.0)[0] for a in np.arange(-30.0, 5.0))

    assert total(count) == pytest.approx(1.0, abs=1e-6)
    assert abs(total(count + 1) - 1.0) > 0.1


def test_density_of_parameters_and_its_slope() -> None:
    """Joint with a normal; the slope by central differences. The density at −x is that of nothing."""
    priors = [SharedHalfNormal(4.5), Normal(0.1, 2.0), SharedHalfNormal(9.0)]
    x = np.array([0.002, 0.4, 0.007])
    squares = (0.002 / 0.45) ** 2 + (0.007 / 0.9) ** 2
    expected = shared_log_density(squares, 2) - np.log(0.45 * 0.9) + stats.norm(0.1, 2.0).logpdf(0.4)
    assert float(joint_log_density(priors, x)) == pytest.approx(float(expected))
    steps = 1e-5 * np.diag(x)
    slope = [
        float(joint_log_density(priors, x + h) - joint_log_density(priors, x - h)) / (2 * h.sum())
        for h in steps
    ]
    assert joint_slope(priors, x) == pytest.approx(slope, rel=1e-5)
    assert joint_log_density(priors, x * [1, 1, -1]) == -np.inf
    separate = sum(float(p.log_density(v)) for p, v in zip(priors, x, strict=True))
    assert abs(separate - expected) > 0.5  # control: as if each had a scale of its own


@pytest.mark.parametrize(("damping", "size"), [(("viscous", "coulomb"), 1e-6), (EVERY, 1.0)])
def test_the_prior_of_the_scores_is_that_of_the_parameters(damping, size) -> None:
    """By a change of variables; a reflected score is of either sign, which halves its density."""
    item = target(*damping)
    z = scores(item, 2, size)
    result = float(Likelihood.near(item, z, 1e-5).log_prior(z))
    own = float(log_prior_of(z, item.reflected, item.shared))
    assert result == pytest.approx(own - np.sum(item.reflected) * np.log(2.0), rel=1e-12)
    priors = list(item.priors.values())
    x = np.array([float(p.value(z[i])) for i, p in enumerate(priors)])
    rates = np.array([float(p.rate(z[i])) for i, p in enumerate(priors)])
    assert own == pytest.approx(float(joint_log_density(priors, x)) + np.sum(np.log(rates)), rel=1e-10)
    assert int(item.shared.sum()) == len(damping)
    separate = sum(float(p.log_density(v)) for p, v in zip(priors, x, strict=True)) + np.sum(np.log(rates))
    assert abs(separate - own) > 0.1  # control: as if each had a scale of its own


def test_the_curvature_of_the_prior() -> None:
    """It is that of a parabola that touches the log prior from below. Control: a flatter one does not stay there."""
    item = target("viscous", "coulomb")
    z = scores(item, 2, 1e-3)
    likelihood = Likelihood.near(item, z, 1e-5)
    squares, count = np.sum(z[item.shared] ** 2), int(item.shared.sum())
    precision = np.where(item.shared, shared_precision(squares, count), 1.0)
    rng = np.random.default_rng(3)
    others = np.array([np.where(item.shared, z * np.exp(rng.standard_normal(z.size)), z) for _ in range(20)])

    def above(share: float) -> np.ndarray:
        parabola = likelihood.log_prior(z) - 0.5 * (others**2 - z**2) @ (share * precision)
        return likelihood.log_prior(others) - parabola

    assert np.all(above(1.0) >= -1e-9)
    assert not np.all(above(0.7) >= -1e-9)


def test_draws_of_the_prior() -> None:
    """Ratios are spread over all scales, and those of one draw have one scale; each score is otherwise normal."""
    item = target(*EVERY)
    z = item.prior_draws(20000, np.random.default_rng(0))
    shared = z[:, item.shared]
    each = stats.kstest(
        np.abs(shared[:, 0]),
        lambda x: np.mean([stats.halfnorm(scale=s).cdf(x) for s in SHARED_SIGMAS], axis=0),
    )
    assert each.pvalue > 1e-4
    logs = np.log(np.abs(shared))
    assert np.corrcoef(logs.T)[0, 1] > 0.8
    assert np.all(np.abs(np.std(z[:, ~item.shared], axis=0) - 1) < 0.03)
