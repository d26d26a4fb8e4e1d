"""The posterior as a function: against SciPy, its gradient, its error budget, escapes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.fit.mode import BUDGET
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import EPSILON_RANGE, Target, build_target, default_prior
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior, SharedHalfNormal, Uniform
from bayesdamp.types import Reference, Refusal, Seed, Signal, System
from tests.inference import problems
from tests.inference.problems import FEATURES
from tests.physics.independent import trajectory


@lru_cache
def heavy() -> tuple[Target, np.ndarray]:
    """The viscous + Coulomb record again, under Student's t; scores near its mode."""
    base = problems.target("viscous_coulomb")
    priors = {**base.priors, "noise_dof": LogNormal(median=6.0, sigma=0.8)}
    target = Target(base.signal, base.oscillator, "student_t", priors, base.known)
    values = problems.target("viscous_coulomb").values(problems.mode("viscous_coulomb").z)
    return target, target.scores({**{n: float(v) for n, v in values.items()}, "noise_dof": 5.0})


def case(noise: str) -> tuple[Target, np.ndarray]:
    if noise == "student_t":
        return heavy()
    name = "viscous_coulomb" if noise == "gaussian" else "coulomb_correlated"
    return problems.target(name), problems.mode(name).z


@pytest.mark.parametrize("name", problems.NAMES)
def test_posterior_at_the_truth(name):
    """Prior and likelihood against those of the reference's own code, on LSODA trajectories."""
    built, target = problems.reference(name), problems.target(name)
    z = target.scores(built["truth"])
    result = Likelihood.near(target, z, 1e-8).log_likelihood(z)
    assert result == pytest.approx(built["at_truth"]["log_likelihood"], abs=2e-3)
    prior = sum(float(p.log_density(built["truth"][n])) for n, p in target.priors.items())
    assert prior == pytest.approx(built["at_truth"]["log_prior"], abs=1e-9)


@pytest.mark.parametrize("noise", NOISES.names())
def test_gradient_is_that_of_differences(noise):
    """Off the mode, so that nothing vanishes; every score, those of the noise too."""
    target, z = case(noise)
    z = z + 0.3 * np.linspace(-0.02, 0.03, z.size)
    likelihood = Likelihood.near(target, z, 1e-9)
    value, gradient = likelihood.gradient(z)
    assert value == pytest.approx(likelihood.log_posterior(z), abs=1e-9)
    d = 1e-5
    differences = []
    for step in d * np.eye(z.size):
        up, down = (likelihood.log_posterior(z + sign * step) for sign in (1, -1))
        differences.append((up - down) / (2 * d))
    scale = np.max(np.abs(differences))
    np.testing.assert_allclose(gradient, differences, atol=1e-5 * scale + 1e-3)
    assert scale > 10  # negative control: the gradient does not vanish here


@pytest.mark.parametrize("noise", ["gaussian", "correlated"])
def test_slopes_in_natural_units_are_those_of_differences(noise):
    """By every inferred parameter; without the prior's. The control: with it they are others."""
    target, z = case(noise)
    likelihood, p = Likelihood.near(target, z, 1e-9), target.all_values(z)
    p["theta0"] *= 1.002
    value, slopes = likelihood.slopes_of(p)
    assert value == likelihood.log_likelihood_of(p)
    differences = []
    for name in target.names:
        h = 1e-5 * max(abs(p[name]), 0.01)
        up, down = (likelihood.log_likelihood_of({**p, name: p[name] + sign * h}) for sign in (1, -1))
        differences.append((up - down) / (2 * h))
    np.testing.assert_allclose(slopes, differences, rtol=1e-3, atol=1e-4 * np.max(np.abs(differences)))
    other = target.scores(p)
    rates = np.array([float(p.rate(x)) for p, x in zip(target.priors.values(), other, strict=True)])
    by_score = likelihood.gradient(other)[1]
    assert not np.allclose(by_score / rates, slopes, rtol=1e-6)
    by_data = (by_score + other) / rates
    np.testing.assert_allclose(by_data, slopes, rtol=1e-4, atol=1e-5 * np.max(np.abs(slopes)))


def test_information_is_the_curvature_at_the_mode():
    """Gauss–Newton against differences of the gradient; they differ by what the residuals contribute. (Where a
    coefficient touches zero the posterior has a kink in its score, and no curvature.)"""
    mode = problems.mode("coulomb_correlated")
    d, n = 1e-5, mode.z.size
    hessian = np.empty((n, n))
    for i, step in enumerate(d * np.eye(n)):
        up, down = (mode.likelihood.gradient(mode.z + sign * step)[1] for sign in (1, -1))
        hessian[i] = -(up - down) / (2 * d)
    white = mode.factor.T @ hessian @ mode.factor
    np.testing.assert_allclose(white, np.eye(n), atol=0.3)
    np.testing.assert_allclose(mode.factor @ mode.factor.T @ mode.information, np.eye(n), atol=1e-6)


def test_linearised_posterior_touches_the_exact_one():
    """Equal at the mode, and with the same gradient; elsewhere they part."""
    mode = problems.mode("viscous_coulomb")
    likelihood = mode.likelihood
    line = likelihood.line(mode.z)
    assert likelihood.log_posterior_along(line, mode.z) == pytest.approx(
        likelihood.log_posterior(mode.z), abs=1e-9
    )
    slope, gradient = likelihood.gradient_along(line, mode.z), likelihood.gradient(mode.z)[1]
    np.testing.assert_allclose(slope, gradient, atol=1e-4)
    far = mode.z + mode.factor @ np.full(mode.z.size, 30.0)
    along = likelihood.log_posterior_along(line, far)
    assert abs(along - likelihood.log_posterior(far)) > 0.1
    # Off the mode the gradient along the line is that of the density along it.
    near = mode.z + mode.factor @ np.linspace(-1.0, 1.0, mode.z.size)
    differences = [
        (likelihood.log_posterior_along(line, near + s) - likelihood.log_posterior_along(line, near - s))
        / 2e-5
        for s in 1e-5 * np.eye(mode.z.size)
    ]
    np.testing.assert_allclose(likelihood.gradient_along(line, near), differences, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("name", problems.NAMES)
def test_error_budget(name):
    """A motion a thousand times more exact changes the log likelihood by less than the budget."""
    mode = problems.mode(name)
    assert mode.likelihood_error < BUDGET
    finer = mode.likelihood.within(max(mode.step_error, 1e-9) / 1000)
    assert abs(mode.likelihood.log_posterior(mode.z) - finer.log_posterior(mode.z)) < BUDGET
    # Negative control: a trajectory as rough as a tenth of the noise is out of budget.
    sd = mode.likelihood.target.all_values(mode.z)["noise_sd"]
    wobble = 0.1 * sd * np.sin(4 * mode.likelihood.target.signal.t)
    r = mode.likelihood.residual(mode.z)
    change = mode.likelihood.log_noise(r, mode.z) - mode.likelihood.log_noise(r + wobble, mode.z)
    assert abs(change) > BUDGET


def test_motions_three_sds_away():
    """Of a likelihood that is made at the mode (ε at 2 % of the peak velocity), at parameters three posterior sds away
    in sixteen directions, against the independent solver: within its tolerance."""
    target, mode = problems.target("coulomb_correlated"), problems.mode("coulomb_correlated")
    osc, times = target.oscillator, target.signal.t
    likelihood = Likelihood.near(target, mode.z, 1e-6)
    rng = np.random.default_rng(8)
    worst, moved = 0.0, 0.0
    at_mode = trajectory(osc.restoring, target.all_values(mode.z), times, longest=0.01)[:, 0]
    for _ in range(16):
        direction = rng.standard_normal(mode.z.size)
        z = mode.z + 3 * mode.factor @ (direction / np.linalg.norm(direction))
        truth = trajectory(osc.restoring, target.all_values(z), times, longest=0.01)[:, 0]
        worst = max(worst, float(np.max(np.abs(likelihood.motion(z) - truth))))
        moved = max(moved, float(np.max(np.abs(truth - at_mode))))
    assert worst < 1e-6
    assert moved > 1e-3  # the parameters do move the trajectory


def test_a_part_of_the_record():
    """Its samples alone count, in the noise too; the motion starts at the record's first. Of independent noise two
    parts make up the whole."""
    target, mode = problems.target("viscous_coulomb"), problems.mode("viscous_coulomb")
    whole, half = mode.likelihood, target.signal.t.size // 2
    parts = [whole.on(slice(0, half)), whole.on(slice(half, None))]
    residuals = np.concatenate([p.residual(mode.z) for p in parts])
    np.testing.assert_allclose(residuals, whole.residual(mode.z), atol=1e-6)
    assert sum(p.log_likelihood(mode.z) for p in parts) == pytest.approx(
        whole.log_likelihood(mode.z), abs=BUDGET
    )
    gradient = sum(p.gradient(mode.z)[1] for p in parts)
    np.testing.assert_allclose(
        mode.factor.T @ (gradient + mode.z - whole.gradient(mode.z)[1]), 0.0, atol=BUDGET
    )
    correlated = problems.mode("coulomb_correlated")
    both = [
        correlated.likelihood.on(s).log_likelihood(correlated.z) for s in (slice(0, half), slice(half, None))
    ]
    assert abs(sum(both) - correlated.likelihood.log_likelihood(correlated.z)) > 1e-3  # control


def duffing(theta0: float) -> tuple[Target, Signal]:
    t = np.linspace(0, 6, 80)
    signal = Signal(t, 0.3 * np.cos(4 * t))
    priors: dict[str, Prior] = {
        "zeta": HalfNormal(scale=0.4),
        "cubic": Normal(mean=-60.0, sd=30.0),
        "theta0": Normal(mean=theta0, sd=0.3),
    }
    known = {"stiffness": 20.0, "rest_angle": 0.0, "omega0": 0.0, "noise_sd": 0.01}
    return Target(signal, Oscillator(("viscous",), "duffing"), "gaussian", priors, known), signal


def test_escape_has_no_likelihood_and_no_nan():
    """A softening Duffing beyond its hilltop: −∞, in batches too, and the inner ones are finite."""
    target, _ = duffing(0.3)
    likelihood = Likelihood.near(target, target.scores({"zeta": 0.1, "cubic": -60.0, "theta0": 0.3}), 1e-6)
    starts = [0.3, 0.5, 0.65, 0.8, 1.2, 3.0]
    z = np.array([target.scores({"zeta": 0.1, "cubic": -60.0, "theta0": x}) for x in starts])
    result = likelihood.log_posteriors(z)
    assert not np.any(np.isnan(result))
    assert np.all(np.isfinite(result[:2]))
    assert np.all(result[3:] == -np.inf)
    value, gradient = likelihood.gradient(z[4])
    assert value == -np.inf
    assert np.all(np.isfinite(gradient))
    assert likelihood.slopes_of(target.all_values(z[4]))[0] == -np.inf


def test_nothing_but_escapes_is_refused():
    target, _ = duffing(3.0)
    with pytest.raises(Refusal, match="finite likelihood"):
        find_mode(target, {Seed("outside"): {"zeta": 0.1, "cubic": -60.0, "theta0": 3.0}}, noise_level=0.01)


def test_scores_and_values_go_back_and_forth():
    target = problems.target("viscous_coulomb")
    truth = problems.reference("viscous_coulomb")["truth"]
    z = target.scores(truth)
    assert {n: float(v) for n, v in target.values(z).items()} == pytest.approx(truth)
    assert target.all_values(z) == pytest.approx({**target.known, **truth})
    assert np.all(np.abs(target.scores({"noise_sd": 1e30, "zeta": 1e30})) <= 6)


def test_prior_of_the_scores_is_standard_normal():
    mode = problems.mode("viscous_coulomb")
    prior = float(mode.likelihood.log_prior(mode.z))
    assert prior == pytest.approx(stats.norm.logpdf(mode.z).sum(), abs=1e-12)
    total = mode.likelihood.log_posterior(mode.z)
    assert mode.likelihood.log_likelihood(mode.z) + prior == pytest.approx(total, abs=1e-9)


REFERENCE = Reference(0.3, 4.47)


def test_default_priors_scale_with_the_study():
    """Damping: the same equivalent ratio for every term; the others follow amplitude, frequency and roughness."""
    osc = Oscillator(("viscous", "coulomb", "quadratic"), "horizontal_pendulum")
    for term in osc.terms:
        prior = default_prior(term.parameter, osc, "gaussian", REFERENCE, FEATURES)
        assert isinstance(prior, SharedHalfNormal)
        assert prior.per_ratio * term.ratio_per_unit(0.3, 4.47) == pytest.approx(1.0)
    gravity = default_prior("gravity", osc, "gaussian", REFERENCE, FEATURES)
    assert isinstance(gravity, Normal)
    assert gravity.mean == 0  # either sign
    epsilon = default_prior("epsilon", osc, "gaussian", REFERENCE, FEATURES)
    assert epsilon.high == pytest.approx(EPSILON_RANGE[1] * REFERENCE.peak_velocity)  # type: ignore[union-attr]
    double = default_prior("theta0", osc, "gaussian", Reference(0.6, 4.47), FEATURES)
    assert double.sd == 2 * default_prior("theta0", osc, "gaussian", REFERENCE, FEATURES).sd  # type: ignore[union-attr]
    with pytest.raises(KeyError):
        default_prior("colour", osc, "gaussian", REFERENCE, FEATURES)


STATED: dict[str, Prior] = {
    "stiffness": LogNormal(median=4.47**2, sigma=0.5),
    "gravity": Normal(mean=0.0, sd=0.5 * 4.47**2),
    "cubic": Normal(mean=0.0, sd=0.5 * 4.47**2 / 0.3**2),
    "spring_angle": Normal(mean=FEATURES.rest, sd=0.6),
    "rest_angle": Normal(mean=FEATURES.rest, sd=0.6),
    "theta0": Normal(mean=FEATURES.rest, sd=0.6),
    "omega0": Normal(mean=0.0, sd=2 * 0.3 * 4.47),
    "noise_sd": LogNormal(median=FEATURES.roughness, sigma=1.0),
    "noise_dof": LogNormal(median=6.0, sigma=0.8),
}
"""Half the stiffness for what stands beside it, twice the amplitude for angles and start."""


@pytest.mark.parametrize("noise", NOISES.names())
def test_default_priors_are_as_wide_as_is_said(noise: str):
    """Evidence depends on each of these numbers: none changes unseen."""
    osc = Oscillator(("viscous",), "duffing")
    own = set(NOISES.get(noise).parameters) & set(STATED)
    for name in (set(STATED) - {"noise_sd", "noise_dof"}) | own:
        result = default_prior(name, osc, noise, REFERENCE, FEATURES)
        assert type(result) is type(STATED[name])
        assert result.model_dump() == pytest.approx(STATED[name].model_dump()), name


def test_build_target():
    """What is known is known, what is free has its prior, ε is stated where it is neither."""
    t = np.linspace(0, 5, 100)
    signal = Signal(t, np.cos(4.5 * t))
    system = System(
        "linear",
        {"stiffness": 20.0, "rest_angle": 0.0},
        {"theta0": None, "omega0": Uniform(low=-1, high=1), "noise_sd": None},
    )
    term = {"coulomb": HalfNormal(scale=7.0)}
    target = build_target(signal, ("viscous", "coulomb"), system, FEATURES, REFERENCE, term_priors=term)
    assert target.names == ("zeta", "mu_c", "theta0", "omega0", "noise_sd")
    assert target.priors["mu_c"] == HalfNormal(scale=7.0)
    assert target.priors["omega0"] == Uniform(low=-1, high=1)
    assert target.known["epsilon"] == pytest.approx(0.02 * 0.3 * 4.47)
    sharp = System("linear", {**system.known, "epsilon": 0.0}, system.free)
    assert build_target(signal, ("coulomb",), sharp, FEATURES, REFERENCE).known["epsilon"] == 0.0
    with pytest.raises(ValueError, match="neither known nor inferred: noise_sd"):
        Target(
            signal,
            target.oscillator,
            "gaussian",
            {},
            {**target.known, **dict.fromkeys(target.names[:4], 1.0)},
        )
