"""The prior of coefficients that share an unknown scale: the same in NumPy and in JAX, normalised, with its slope."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.special import gammaln

from bayesdamp.inference.model import batches
from bayesdamp.inference.model.build import build_target
from bayesdamp.inference.model.defaults import Reference, default_prior
from bayesdamp.inference.model.density import log_posterior, log_prior, prior_precision
from bayesdamp.inference.model.gradient import curvature, value_and_gradient
from bayesdamp.inference.model.linearised import linearise
from bayesdamp.inference.model.target import SHARED_ABSENT, Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import (
    SHARED_SCALES,
    SHARED_SIGMAS,
    HalfNormal,
    Normal,
    SharedHalfNormal,
    joint_log_density,
    joint_slope,
    log_prior_of,
    shared_log_density,
    shared_precision,
)
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Signal, System

EVERY = ("viscous", "coulomb", "quadratic")
T = np.linspace(0.0, 5.0, 200)
NOISE = 0.003 * np.random.default_rng(0).standard_normal(T.size)
SIGNAL = Signal(T, 0.3 * np.exp(-0.05 * T) * np.cos(4.47 * T) + NOISE)
REFERENCE = Reference(0.3, 4.47)


def target(*damping: str, priors: dict | None = None) -> Target:
    system = System("linear", {"rest_angle": 0.0, "epsilon": 0.03}, {})
    return build_target(
        SIGNAL, damping, system, features(SIGNAL), REFERENCE, term_priors=priors, beside=EVERY
    )


def scores(one: Target, seed: int, size: float = 1.0) -> np.ndarray:
    z = one.scores(
        {"zeta": 0.05, "mu_c": 0.02, "mu_q": 0.04, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.0}
    )
    rng = np.random.default_rng(seed)
    return np.where(one.shared, size * np.abs(rng.standard_normal(z.size)), z)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_joint_density_is_normalised(count) -> None:
    """Over the radius: a share 2^-count of a sphere. Negative control: that of one coefficient more."""
    surface = np.log(2) + 0.5 * count * np.log(np.pi) - gammaln(0.5 * count) - count * np.log(2.0)

    def total(n: int) -> float:
        def along(u: float) -> float:  # the logarithm of the radius
            return float(np.exp(shared_log_density(np.exp(2 * u), n) + surface + count * u))

        return sum(quad(along, a, a + 1.0)[0] for a in np.arange(-30.0, 5.0))

    assert total(count) == pytest.approx(1.0, abs=1e-6)
    assert abs(total(count + 1) - 1.0) > 0.1


def test_one_scale_is_a_product_of_half_normals() -> None:
    x = np.array([0.02, 0.3])
    expected = np.sum(stats.halfnorm(scale=0.5).logpdf(x))
    assert shared_log_density(np.sum(x**2), 2, [0.5]) == pytest.approx(expected)
    assert shared_precision(np.sum(x**2), 2, [0.5]) == pytest.approx(4.0)
    assert abs(shared_log_density(np.sum(x**2), 2) - expected) > 0.3


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


@pytest.mark.parametrize("damping", [("viscous",), ("viscous", "coulomb"), EVERY], ids="+".join)
@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0])
def test_jax_and_numpy_agree(damping, size) -> None:
    one = target(*damping)
    assert one.layout == target(*EVERY).layout
    context, z = one.context(one.plan(scores(one, 1), 1e-5)[0]), scores(one, 2, size)
    found = float(log_prior(one.layout, context, jnp.asarray(z)))
    assert found == pytest.approx(float(batches.log_prior(one, z)), rel=1e-12)
    present = np.array([n in one.live for n in one.names])
    positive = np.asarray(one.layout.reflected)
    own = float(log_prior_of(z[present], positive[present], one.shared[present]))
    folds = np.sum(positive & present) * np.log(2.0)
    absent = float(np.sum(stats.norm.logpdf(z[~present])))
    assert found == pytest.approx(own - folds + absent, rel=1e-12)
    assert int(one.shared.sum()) == len(damping)


@pytest.mark.parametrize("damping", [("viscous",), ("viscous", "coulomb")], ids="+".join)
@pytest.mark.parametrize("size", [1e-3, 1.0])
def test_slopes_of_the_prior(damping, size) -> None:
    """By central differences; and the curvature is that of a parabola which touches the log prior from below."""
    one = target(*damping)
    context, z = one.context(one.plan(scores(one, 1), 1e-5)[0]), scores(one, 2, size)
    precision = np.asarray(prior_precision(one.layout, context, jnp.asarray(z)))
    step = 1e-5 * size
    for i in np.flatnonzero(np.asarray(one.layout.reflected)):
        ends = [float(batches.log_prior(one, z + sign * step * np.eye(z.size)[i])) for sign in (1, -1)]
        assert -precision[i] * z[i] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5)
    rng = np.random.default_rng(3)
    for _ in range(20):
        other = np.where(one.shared, z * np.exp(rng.standard_normal(z.size)), z)
        below = batches.log_prior(one, z) - 0.5 * np.sum(precision * (other**2 - z**2))
        assert batches.log_prior(one, other) >= below - 1e-9


def test_gradient_and_curvature_of_the_posterior() -> None:
    """Both by central differences of the log posterior, also of coefficients of a thousandth of the prior's unit."""
    one = target("viscous", "coulomb")
    for size in (1e-3, 1.0):
        z = jnp.asarray(scores(one, 2, size))
        context = one.context(one.plan(np.asarray(z), 1e-7)[0])
        height = jax.jit(lambda at, context=context: log_posterior(one.layout, context, at))
        gradient = np.asarray(value_and_gradient(one.layout, context, z)[1])
        found = curvature(one.layout, context, linearise(one.layout, context, z), z)
        assert np.asarray(found[1]) == pytest.approx(gradient, rel=1e-6)
        for i in np.flatnonzero(one.shared):
            step = 1e-5 * size * np.eye(z.size)[i]
            slope = float(height(z + step) - height(z - step)) / (2 * step.sum())
            assert gradient[i] == pytest.approx(slope, rel=1e-3)
        assert np.all(np.linalg.eigvalsh(np.asarray(found[2])) > 0)


def test_absent_terms_are_of_the_kind_that_present_ones_are() -> None:
    one = target("viscous", priors={"coulomb": HalfNormal(0.3)})
    other = target("coulomb", priors={"coulomb": HalfNormal(0.3)})
    assert one.layout == other.layout
    assert one.priors["mu_q"] == SHARED_ABSENT
    assert list(one.live[:1]) == ["zeta"]
    assert other.shared.sum() == 0


def test_draws_of_the_prior() -> None:
    """Ratios are spread over all scales, and those of one draw have one scale; each score is otherwise normal."""
    one = target(*EVERY)
    z = one.prior_draws(20000, np.random.default_rng(0))
    shared = z[:, one.shared]
    each = stats.kstest(
        np.abs(shared[:, 0]),
        lambda x: np.mean([stats.halfnorm(scale=s).cdf(x) for s in SHARED_SIGMAS], axis=0),
    )
    assert each.pvalue > 1e-4
    logs = np.log(np.abs(shared))
    assert np.corrcoef(logs.T)[0, 1] > 0.8
    assert np.all(np.abs(np.std(z[:, ~one.shared], axis=0) - 1) < 0.03)


def test_the_default_prior_is_stated_in_words() -> None:
    prior = default_prior("zeta", Oscillator(("viscous",), "linear"), "gaussian", REFERENCE, features(SIGNAL))
    assert "shared by the terms" in prior.describe()
    assert isinstance(prior, SharedHalfNormal)
    assert np.log(SHARED_SCALES).mean() == pytest.approx(0.5 * (np.log(1e-8) + np.log(0.3)))
    assert replace(target("viscous"), scales=(1.0,)).scales == (1.0,)
