"""The posterior as a function: its value, its derivatives, and its numerical error."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target, build_target, default_prior
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import SHARED_SIGMAS, HalfNormal, LogNormal, LogUniform, Normal, Prior, Uniform
from bayesdamp.types import InputError, Reference, Signal, System
from tests.inference import problems
from tests.inference.problems import FEATURES, linear_target

MOST_CHANGE = 0.01
"""Largest change of the log likelihood, in nats, by the numerical error of the motion."""


def test_prior_and_likelihood_are_those_of_the_reference():
    """At the true parameters, where the reference's own code used trajectories of SciPy's DOP853."""
    for name in problems.NAMES:
        reference, target = problems.reference(name), problems.target(name)
        z = target.scores(reference["truth"])
        result = Likelihood.near(target, z, 1e-8).log_likelihood(z)
        assert result == pytest.approx(reference["at_truth"]["log_likelihood"], abs=2e-3), name
        prior = sum(float(p.log_density(reference["truth"][n])) for n, p in target.priors.items())
        assert prior == pytest.approx(reference["at_truth"]["log_prior"], abs=1e-9), name


def test_a_more_exact_motion_changes_the_log_likelihood_by_less_than_the_bound():
    """The tolerance is a thousandth."""
    for name in problems.NAMES:
        mode = problems.mode(name)
        finer = replace(mode.likelihood, tolerance=mode.likelihood.tolerance / 1000)
        assert abs(mode.likelihood.log_posterior(mode.z) - finer.log_posterior(mode.z)) < MOST_CHANGE, name


def test_the_likelihood_of_a_part_of_the_record_counts_only_its_samples():
    """The motion starts at the first sample of the record. Log likelihoods of two parts add up to that of the whole for
    independent noise, but not for correlated noise, which is the control."""
    for name, independent in (("viscous_coulomb", True), ("coulomb_correlated", False)):
        mode = problems.mode(name)
        whole, half = mode.likelihood, problems.target(name).signal.t.size // 2
        parts = [replace(whole, part=part) for part in (slice(0, half), slice(half, None))]
        residuals = np.concatenate([p.residual(mode.z) for p in parts])
        np.testing.assert_allclose(residuals, whole.residual(mode.z), atol=1e-6)
        late, t, values = residuals[half:], whole.target.signal.t[half:], whole.target.all_values(mode.z)
        own = whole.target.noise_model.log_likelihood(late, np.diff(t), values)
        assert parts[1].log_likelihood(mode.z) == pytest.approx(own, abs=1e-3)
        off = sum(p.log_likelihood(mode.z) for p in parts) - whole.log_likelihood(mode.z)
        assert abs(off) < MOST_CHANGE if independent else abs(off) > 1e-3


REFERENCE = Reference(0.3, 4.47)
STATED: dict[str, Prior] = {
    **dict.fromkeys(("spring_angle", "rest_angle", "theta0"), Normal(mean=FEATURES.rest, sd=0.6)),
    "stiffness": LogNormal(median=4.47**2, sigma=0.5),
    "gravity": Normal(mean=0.0, sd=0.5 * 4.47**2),
    "cubic": Normal(mean=0.0, sd=0.5 * 4.47**2 / 0.3**2),
    "omega0": Normal(mean=0.0, sd=2 * 0.3 * 4.47),
    "noise_sd": LogNormal(median=FEATURES.roughness, sigma=1.0),
    "noise_dof": LogNormal(median=6.0, sigma=0.8),
    "epsilon": LogUniform(low=0.0005 * 0.3 * 4.47, high=0.05 * 0.3 * 4.47),
}
"""Default priors. Other parts of the restoring force have half the stiffness, angles have twice the amplitude."""


def test_default_priors_have_the_stated_widths():
    """Evidence depends on each of these numbers. The coefficients of all terms have the same damping ratio."""
    osc = Oscillator(("viscous", "coulomb", "quadratic"), "duffing")
    for term in osc.terms:
        prior = default_prior(term.parameter, osc, "gaussian", REFERENCE, FEATURES)
        assert prior.per_ratio * term.ratio_per_unit(0.3, 4.47) == pytest.approx(1.0)
    for name in STATED:
        result = default_prior(name, osc, "student_t", REFERENCE, FEATURES)
        assert type(result) is type(STATED[name])
        assert result.model_dump() == pytest.approx(STATED[name].model_dump()), name
    with pytest.raises(InputError, match="'softness' of the restoring law duffing has no default prior"):
        default_prior("softness", osc, "gaussian", REFERENCE, FEATURES)


def test_build_target_uses_the_known_values_and_the_given_priors():
    """Otherwise priors are the default ones, and ε, which is neither known nor inferred here, has a default value."""
    t = np.linspace(0, 5, 100)
    signal, uniform = Signal(t, np.cos(4.5 * t)), Uniform(low=-1, high=1)
    free = {"theta0": None, "omega0": uniform, "noise_sd": None}
    system = System("linear", {"stiffness": 20.0, "rest_angle": 0.0}, free)
    term = {"coulomb": HalfNormal(scale=7.0)}
    target = build_target(signal, ("viscous", "coulomb"), system, FEATURES, REFERENCE, term_priors=term)
    assert target.names == ("zeta", "mu_c", "theta0", "omega0", "noise_sd")
    assert (target.priors["mu_c"], target.priors["omega0"]) == (HalfNormal(scale=7.0), uniform)
    assert target.known["epsilon"] == pytest.approx(0.02 * 0.3 * 4.47)
    sharp = System("linear", {**system.known, "epsilon": 0.0}, system.free)
    assert build_target(signal, ("coulomb",), sharp, FEATURES, REFERENCE).known["epsilon"] == 0.0


def test_draws_of_the_default_prior_have_one_scale_for_all_damping_ratios():
    """Against the mixture of half-normals (false alarm 1e-4). Scores of other parameters are standard normal."""
    t = np.linspace(0, 5, 100)
    system = System("linear", {"rest_angle": 0.0, "epsilon": 0.03}, {})
    terms = ("viscous", "coulomb", "quadratic")
    target = build_target(Signal(t, np.cos(4.5 * t)), terms, system, FEATURES, REFERENCE)
    z = target.prior_draws(20000, np.random.default_rng(0))
    sizes = np.abs(z[:, target.shared])
    each = stats.halfnorm(scale=SHARED_SIGMAS)
    assert stats.kstest(sizes[:, 0], lambda x: each.cdf(x[:, None]).mean(axis=1)).pvalue > 1e-4
    assert np.corrcoef(np.log(sizes).T)[0, 1] > 0.8
    assert np.all(np.abs(np.std(z[:, ~target.shared], axis=0) - 1) < 0.03)


@lru_cache
def sharing() -> tuple[Likelihood, np.ndarray]:
    """Return a likelihood whose two coefficients have priors of one unknown scale, and scores away from its mode."""
    t = np.linspace(0, 5, 60)
    y = 0.3 * np.exp(-0.2 * t) * np.cos(4.47 * t) + 0.01 * np.random.default_rng(2).standard_normal(t.size)
    system = System("linear", {"rest_angle": 0.0}, {})
    target = build_target(Signal(t, y), ("viscous", "coulomb"), system, FEATURES, REFERENCE)
    truth = {"zeta": 0.2, "mu_c": 0.02, "stiffness": 20.0, "theta0": 0.29, "omega0": -0.05, "noise_sd": 0.012}
    z = target.scores(truth)
    return Likelihood.near(target, z, 1e-9), z


def differences(function: Callable[[np.ndarray], np.ndarray | float], z: np.ndarray, d: float) -> np.ndarray:
    """Return the central differences of a function by each score."""
    return np.array([(function(z + s) - function(z - s)) / (2 * d) for s in d * np.eye(z.size)])


@pytest.mark.parametrize("louder", [1.0, 30.0])
def test_the_curvature_is_the_information_of_the_linearised_motion_of_the_noise_and_of_the_prior(louder):
    """JᵀJ/σ² by differences of the motion, and the second derivative of the density by log σ in closed form, also where
    the noise is far larger than the residuals. Control: without the prior the curvature is another one."""
    likelihood, z = sharing()
    z = z + np.log(louder) * np.eye(z.size)[-1]
    target, p = likelihood.target, likelihood.target.all_values(z)
    value, gradient, information = likelihood.curvature(z)
    assert value == pytest.approx(likelihood.log_posterior(z), rel=1e-12)
    assert gradient == pytest.approx(differences(likelihood.log_posterior, z, 1e-5), rel=1e-4, abs=1e-2)
    slopes = -differences(likelihood.residual, z, 1e-5)
    squares = float(np.sum(likelihood.residual(z) ** 2))
    expected = slopes @ slopes.T / p["noise_sd"] ** 2
    expected[-1, -1] += 2 * squares / p["noise_sd"] ** 2  # the score is the sd's logarithm, in units of one
    prior = np.diag(target.prior_precision(z))
    scale = np.sqrt(np.outer(np.diag(expected + prior), np.diag(expected + prior)))
    assert information / scale == pytest.approx((expected + prior) / scale, abs=1e-3)
    assert np.abs(information - expected)[0, 0] > 0.01 * prior[0, 0] > 0


def test_the_linearised_motion_is_exact_in_parameters_in_which_the_motion_is_linear():
    """The motion of a linear oscillator is linear in its start, but not in its stiffness, which is the control."""
    t = np.linspace(0, 5, 60)
    target = linear_target(t, 0.3 * np.cos(4.4 * t), "viscous", {"noise_sd": 0.02})
    z = target.scores({"zeta": 0.2, "stiffness": 20.0, "theta0": 0.3, "omega0": 0.1})
    likelihood = Likelihood.near(target, z, 1e-10)
    line = likelihood.line(z)
    assert likelihood.gradient_along(line, z) == pytest.approx(likelihood.gradient(z)[1], rel=1e-9)
    start, stiff = z + np.array([0, 0, 0.3, -0.2]), z + np.array([0, 0.3, 0, 0])
    for at, linear in ((start, True), (stiff, False)):
        along, exact = likelihood.gradient_along(line, at), likelihood.gradient(at)[1]
        assert (along[2:] == pytest.approx(exact[2:], rel=1e-5)) is linear


def test_scores_and_values_are_inverse_functions():
    """A coefficient without a value has a score of 0.5, and scores are at most 6."""
    likelihood, z = sharing()
    target = likelihood.target
    values = {n: float(v) for n, v in target.values(z).items()}
    assert target.scores(values) == pytest.approx(z, abs=1e-9)
    missing = target.scores({**{n: v for n, v in values.items() if n != "zeta"}, "theta0": 1e6})
    assert (missing[0], missing[target.names.index("theta0")]) == (0.5, 6.0)
    motion_alone = {n: p for n, p in target.priors.items() if n != "noise_sd"}
    with pytest.raises(ValueError, match="neither known nor inferred: noise_sd"):
        Target(target.signal, target.oscillator, "gaussian", motion_alone, target.known)
