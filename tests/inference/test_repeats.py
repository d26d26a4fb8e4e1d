"""Runs with the same coefficients, against quadrature over coefficients, factors of the runs and their spread."""

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.special import erf, logsumexp
from scipy.stats import norm

from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.repeats import SPREAD_SCALE, RecordLikelihood, Repeats, join_runs
from bayesdamp.inference.deviation.specimen import ratio_likelihood
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.numerics.weights import quantiles
from bayesdamp.priors import HalfNormal, Normal, Prior, SharedHalfNormal
from bayesdamp.types import Reference, Signal
from tests.inference.runs import Summed, by_quadrature, run_of
from tests.physics.independent import viscous

EXACTLY = np.zeros(1)
"""Log prior of the sizes of deviations, with one combination."""
NATS = 0.05
"""Error of Laplace's method over the factors and of the cells of the spread."""
MONTE_CARLO = 4 / np.sqrt(4000)
"""Four standard errors of a mean of draws, in sds: a false alarm in 16,000 seeds."""


def run_at(place: float, sd: float, log: float | np.ndarray = 0.0) -> RecordLikelihood:
    return run_of(["zeta"], [place], np.array([[sd**2]]), log)


def line(prior: Prior, low: float, high: float, points: int = 801) -> tuple[np.ndarray, np.ndarray]:
    """Return a grid of a coefficient, even in its logarithm, and the log prior masses."""
    x = np.geomspace(low, high, points)
    return x[:, None], prior.log_density(x) + np.log(np.gradient(x))


def assert_agreement(repeats: Repeats, truth: Summed, grid: np.ndarray, share: float = 0.05) -> None:
    """Compare evidence, means, sds and quantiles of the spread.

    share: admissible difference of means in sds. For a wide spread the posterior is nearly log-normal, and the draws
    are normal.
    """
    assert repeats.log_evidence == pytest.approx(truth.log_evidence, abs=NATS)
    for i in range(grid.shape[1]):
        mean = float(truth.mass @ grid[:, i])
        sd = float(np.sqrt(truth.mass @ (grid[:, i] - mean) ** 2))
        assert repeats.draws[:, i].mean() == pytest.approx(mean, abs=(MONTE_CARLO + share) * sd)
        assert repeats.draws[:, i].std() == pytest.approx(sd, rel=0.1)
    spread = truth.each.sum(axis=0)
    levels = (0.5, 0.975)
    expected = quantiles(truth.spreads, spread / spread.sum(), levels)
    assert np.quantile(repeats.spreads, levels) == pytest.approx(expected, rel=0.12, abs=0.004)


@pytest.mark.parametrize(
    ("prior", "places"),
    [
        (HalfNormal(0.3), (0.05, 0.05, 0.05)),
        (SharedHalfNormal(per_ratio=1.0), (0.05, 0.058, 0.046)),
        (HalfNormal(0.3), (0.05, 0.08)),
    ],
    ids=["equal", "scattered", "apart"],
)
def test_runs_with_one_coefficient_have_the_evidence_and_posterior_of_quadrature(
    prior: Prior, places: tuple[float, ...]
) -> None:
    """Control: with a spread of zero the evidence is larger for equal runs, and smaller for runs that are apart."""
    runs = [run_at(p, 0.001, log=j) for j, p in enumerate(places)]
    grid, log_prior = line(prior, 0.02, 0.16)
    truth = by_quadrature(runs, grid, log_prior)
    share = 0.05 if places[0] == places[1] else 0.25
    assert_agreement(join_runs(runs, {"zeta": prior}, EXACTLY), truth, grid, share)
    same = by_quadrature(runs, grid, log_prior, 0.0).log_evidence
    assert abs(same - truth.log_evidence) > 1
    assert (same > truth.log_evidence) is (places[0] == places[1])


def test_the_exponent_is_the_same_in_all_runs() -> None:
    """Only the coefficients of the runs differ. Control: if the factors also multiplied the exponent, the evidence
    would be another one."""
    priors: Mapping[str, Prior] = {"c_power": HalfNormal(0.2), "exponent": Normal(1.0, 0.5)}
    covariance = np.diag([0.002**2, 0.05**2])
    names, places = ["c_power", "exponent"], ([0.050, 1.6], [0.065, 1.64], [0.045, 1.58])
    runs = [run_of(names, p, covariance, shared=["exponent"]) for p in places]
    a, b = np.geomspace(0.025, 0.11, 121), np.linspace(1.4, 1.8, 81)
    grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
    log_prior = priors["c_power"].log_density(grid[:, 0]) + norm.logpdf(grid[:, 1], 1.0, 0.5)
    log_prior = log_prior + np.repeat(np.log(np.gradient(a)), b.size) + np.log(b[1] - b[0])
    truth = by_quadrature(runs, grid, log_prior, factors=301, reach=1.2)
    assert_agreement(join_runs(runs, priors, EXACTLY), truth, grid, share=0.25)
    scaled = [run_of(names, p, covariance) for p in places]
    assert abs(join_runs(scaled, priors, EXACTLY).log_evidence - truth.log_evidence) > 5 * NATS


def test_runs_of_records_are_joined_to_the_evidence_of_quadrature() -> None:
    """Three viscous decays in closed form with different coefficients, and all other parameters known. The sum is over
    the coefficient, the factors and their spread. Control: the product of the single evidences is another one."""
    omega, noise, spreads = 4.5, 0.012, np.linspace(1e-3, 0.5, 200)
    t, x = np.linspace(0.0, 16.0, 160), np.geomspace(0.015, 0.15, 801)
    known = {"stiffness": omega**2, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0, "noise_sd": noise}

    runs, logs, rng = [], [], np.random.default_rng(22)
    for factor in (0.92, 1.01, 1.07):
        y = viscous(t, 0.05 * factor, omega, 0.3) + noise * rng.standard_normal(t.size)
        comparison = compare_signal(
            Signal(t, y), damping=["viscous"], restoring=["linear"], known=known, reference=Reference(0.3, omega),
            approximate=False,
        )  # fmt: skip
        runs.append(ratio_likelihood(comparison.results[0], np.array([0.2, 0.1])))
        logs.append(np.array([norm.logpdf(y, viscous(t, z, omega, 0.3), noise).sum() for z in x]))
    # Prior of the logarithm of a half-normal ratio whose scale is log-uniform.
    prior = erf(x / omega / 1e-8 / 2**0.5) - erf(x / omega / 0.3 / 2**0.5)
    log_prior = np.log(prior / np.log(0.3 / 1e-8) * np.log(x[1] / x[0]))
    alone = [logsumexp(log + log_prior) for log in logs]
    steps = np.log(x) - np.log(x)[:, None]
    together = []
    for spread in spreads:
        kernel = norm.logpdf(steps / spread) - logsumexp(norm.logpdf(steps / spread), axis=1, keepdims=True)
        together.append(logsumexp(sum(logsumexp(log + kernel, axis=1) for log in logs) + log_prior))
    weights = norm.pdf(spreads / SPREAD_SCALE) / norm.pdf(spreads / SPREAD_SCALE).sum()
    expected = logsumexp(together, b=weights)
    priors = damping_priors(["viscous"], Reference(0.3, omega))
    each = [join_runs([run], priors, EXACTLY).log_evidence for run in runs]
    assert each == pytest.approx(alone, abs=NATS)
    assert join_runs(runs, priors, EXACTLY).log_evidence == pytest.approx(expected, abs=NATS)
    assert abs(sum(each) - expected) > 1.0


def test_runs_with_different_parameters_cannot_be_joined() -> None:
    other = run_of(["mu_c"], [0.05], np.eye(1))
    for runs, name in (([], "zeta"), ([run_at(0.05, 0.001), other], "zeta"), ([other], "zeta")):
        with pytest.raises(ValueError, match="same names of parameters"):
            join_runs(runs, {name: HalfNormal(0.3)}, EXACTLY)
