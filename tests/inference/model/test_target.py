"""The posterior as a function: against SciPy, its gradient, its error budget, escapes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy import stats

from bayesdamp.inference.mode import BUDGET
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target, build_target, default_prior
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import SHARED_SIGMAS, HalfNormal, LogNormal, Normal, Prior, SharedHalfNormal, Uniform
from bayesdamp.types import Reference, Refusal, Seed, Signal, System
from tests.inference import problems
from tests.inference.problems import FEATURES


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


def test_posterior_at_the_truth():
    """Prior and likelihood against those of the reference's own code, on LSODA trajectories."""
    for name in problems.NAMES:
        built, target = problems.reference(name), problems.target(name)
        z = target.scores(built["truth"])
        result = Likelihood.near(target, z, 1e-8).log_likelihood(z)
        assert result == pytest.approx(built["at_truth"]["log_likelihood"], abs=2e-3), name
        prior = sum(float(p.log_density(built["truth"][n])) for n, p in target.priors.items())
        assert prior == pytest.approx(built["at_truth"]["log_prior"], abs=1e-9), name


@pytest.mark.parametrize("noise", ["gaussian", "correlated", "student_t"])
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


def test_error_budget():
    """A motion a thousand times more exact changes the log likelihood by less than the budget."""
    for name in problems.NAMES:
        mode = problems.mode(name)
        assert mode.likelihood_error < BUDGET
        finer = mode.likelihood.within(max(mode.step_error, 1e-9) / 1000)
        assert abs(mode.likelihood.log_posterior(mode.z) - finer.log_posterior(mode.z)) < BUDGET, name


def test_a_part_of_the_record():
    """Its samples alone count, and the motion starts at the record's first. Of independent noise two parts make up the
    whole; of correlated noise, the control, they do not."""
    for name, independent in (("viscous_coulomb", True), ("coulomb_correlated", False)):
        mode = problems.mode(name)
        whole, half = mode.likelihood, problems.target(name).signal.t.size // 2
        parts = [whole.on(slice(0, half)), whole.on(slice(half, None))]
        residuals = np.concatenate([p.residual(mode.z) for p in parts])
        np.testing.assert_allclose(residuals, whole.residual(mode.z), atol=1e-6)
        off = sum(p.log_likelihood(mode.z) for p in parts) - whole.log_likelihood(mode.z)
        assert abs(off) < BUDGET if independent else abs(off) > 1e-3


def test_escape_has_no_likelihood_and_no_nan():
    """A softening Duffing beyond its hilltop: −∞, in batches too, and the inner ones are finite."""
    t = np.linspace(0, 6, 80)
    priors: dict[str, Prior] = {"zeta": HalfNormal(scale=0.4), "cubic": Normal(mean=-60.0, sd=30.0)}
    priors["theta0"] = Normal(mean=0.3, sd=0.3)
    known = {"stiffness": 20.0, "rest_angle": 0.0, "omega0": 0.0, "noise_sd": 0.01}
    law = Oscillator(("viscous",), "duffing")
    target = Target(Signal(t, 0.3 * np.cos(4 * t)), law, "gaussian", priors, known)
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
    with pytest.raises(Refusal, match="finite likelihood"):
        find_mode(target, {Seed("outside"): {"zeta": 0.1, "cubic": -60.0, "theta0": 3.0}}, noise_level=0.01)


REFERENCE = Reference(0.3, 4.47)


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


def test_default_priors_are_as_wide_as_is_said():
    """Evidence depends on each of these numbers: none changes unseen. Damping has the same ratio for every term."""
    osc = Oscillator(("viscous", "coulomb", "quadratic"), "duffing")
    for term in osc.terms:
        prior = default_prior(term.parameter, osc, "gaussian", REFERENCE, FEATURES)
        assert isinstance(prior, SharedHalfNormal)
        assert prior.per_ratio * term.ratio_per_unit(0.3, 4.47) == pytest.approx(1.0)
    for name in STATED:
        result = default_prior(name, osc, "student_t", REFERENCE, FEATURES)
        assert type(result) is type(STATED[name])
        assert result.model_dump() == pytest.approx(STATED[name].model_dump()), name


def test_build_target():
    """What is known is known, what is free has its prior, ε is stated where it is neither."""
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


def test_draws_of_the_default_prior():
    """Damping ratios are spread over all scales, and those of one draw have one scale; each other score is normal."""
    t = np.linspace(0, 5, 100)
    system = System("linear", {"rest_angle": 0.0, "epsilon": 0.03}, {})
    terms = ("viscous", "coulomb", "quadratic")
    target = build_target(Signal(t, np.cos(4.5 * t)), terms, system, FEATURES, REFERENCE)
    z = target.prior_draws(20000, np.random.default_rng(0))
    sizes = np.abs(z[:, target.shared])

    def of_all_scales(x: np.ndarray) -> np.ndarray:
        return np.mean([stats.halfnorm(scale=s).cdf(x) for s in SHARED_SIGMAS], axis=0)

    assert stats.kstest(sizes[:, 0], of_all_scales).pvalue > 1e-4
    assert np.corrcoef(np.log(sizes).T)[0, 1] > 0.8
    assert np.all(np.abs(np.std(z[:, ~target.shared], axis=0) - 1) < 0.03)
