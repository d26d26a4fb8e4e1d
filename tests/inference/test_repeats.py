"""Several runs with one set of coefficients: evidence and posterior against quadrature over coefficient, factor and
spread."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from scipy.stats import norm

from bayesdamp.inference.curves.weighted import summarise
from bayesdamp.inference.deviation.repeats import Repeats, RunLikelihood, joined
from bayesdamp.priors import SHARED_SCALES, HalfNormal, Normal, Prior, SharedHalfNormal
from tests.inference.runs import Summed, by_quadrature, run_of

EXACTLY = np.zeros(1)
"""Log prior of the sizes of deviations where there is one combination alone."""
NATS = 0.05
"""What Laplace's method over the factors, and the cells of the spread, are worth."""
MONTE_CARLO = 4 / np.sqrt(4000)
"""Four standard errors of a mean of draws, in sds: a false alarm once in 16,000 seeds."""


def run_at(place: float, sd: float, log: float | np.ndarray = 0.0) -> RunLikelihood:
    return run_of(["zeta"], [place], np.array([[sd**2]]), log)


def line(prior: Prior, low: float, high: float, points: int = 801) -> tuple[np.ndarray, np.ndarray]:
    """A grid of one coefficient, even in its logarithm, and its log prior masses."""
    x = np.geomspace(low, high, points)
    return x[:, None], prior.log_density(x) + np.log(np.gradient(x))


def agrees(repeats: Repeats, truth: Summed, grid: np.ndarray, share: float = 0.05) -> None:
    """Evidence, means, sds and the spread's quantiles.

    share: of an sd, by which means may be off: under a wide spread the posterior is nearly log-normal, and the draws
    are normal.
    """
    assert repeats.log_evidence == pytest.approx(truth.log_evidence, abs=NATS)
    for i in range(grid.shape[1]):
        mean = float(truth.mass @ grid[:, i])
        sd = float(np.sqrt(truth.mass @ (grid[:, i] - mean) ** 2))
        assert repeats.draws[:, i].mean() == pytest.approx(mean, abs=(MONTE_CARLO + share) * sd)
        assert repeats.draws[:, i].std() == pytest.approx(sd, rel=0.1)
    spread = truth.each.sum(axis=0)
    right = summarise(truth.spreads, spread / spread.sum())
    for q in ("median", "q97.5"):
        assert np.quantile(repeats.spreads, {"median": 0.5, "q97.5": 0.975}[q]) == pytest.approx(
            right[q], rel=0.12, abs=0.004
        )


@pytest.mark.parametrize(
    ("prior", "places"),
    [
        (HalfNormal(0.3), (0.05, 0.05, 0.05)),
        (SharedHalfNormal(per_ratio=1.0), (0.05, 0.058, 0.046)),
        (HalfNormal(0.3), (0.05, 0.08)),
    ],
    ids=["alike", "scattered", "apart"],
)
def test_one_coefficient(prior: Prior, places: tuple[float, ...]) -> None:
    """Control: with a spread of zero the evidence of runs that are apart is another."""
    runs = [run_at(p, 0.001, log=j) for j, p in enumerate(places)]
    grid, log_prior = line(prior, 0.02, 0.16)
    truth = by_quadrature(runs, grid, log_prior)
    agrees(
        joined(runs, {"zeta": prior}, EXACTLY), truth, grid, share=0.05 if places[0] == places[1] else 0.25
    )
    same = joined(runs, {"zeta": prior}, EXACTLY, spread=0.0).log_evidence
    assert same == pytest.approx(by_quadrature(runs, grid, log_prior, 0.0).log_evidence, abs=NATS)
    assert abs(same - truth.log_evidence) > 1
    assert (same > truth.log_evidence) is (places[0] == places[1])


def test_without_a_spread_runs_are_one_set_of_data() -> None:
    """The product of their likelihoods under one prior. Negative control: the product of their evidences."""
    places, prior = (0.05, 0.0508, 0.0495, 0.0502), SharedHalfNormal(per_ratio=1.0)
    runs = [run_at(p, 0.001) for p in places]
    together = by_quadrature(runs, *line(prior, 0.04, 0.06), spread=0.0).log_evidence
    one_set = run_at(float(np.mean(places)), 0.0005, -0.5 * float(np.var(places)) * 4 / 0.001**2)
    for result in (
        joined(runs, {"zeta": prior}, EXACTLY, spread=0.0),
        joined(runs, {"zeta": prior}, EXACTLY, spread=1e-5),
        joined([one_set], {"zeta": prior}, EXACTLY),
    ):
        assert result.log_evidence == pytest.approx(together, abs=NATS)
    product = sum(joined([r], {"zeta": prior}, EXACTLY).log_evidence for r in runs)
    assert abs(product - together) > 5


def test_two_coefficients_of_which_one_is_nearly_zero() -> None:
    """Their prior scale is one and unknown; by brute force over both, the factors and the spread."""
    priors: Mapping[str, Prior] = {"zeta": SharedHalfNormal(1.0), "mu_c": SharedHalfNormal(1.6)}
    covariance = np.array([[0.002**2, -0.8 * 0.002 * 0.003], [-0.8 * 0.002 * 0.003, 0.003**2]])
    runs = [
        run_of(["zeta", "mu_c"], place, covariance, 1.0)
        for place in ([0.050, 0.001], [0.053, -0.001], [0.049, 0.002])
    ]
    a, b = np.linspace(0.03, 0.075, 120), np.linspace(0.0, 0.02, 81)
    grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
    ratios = grid / [1.0, 1.6]
    each = (
        -0.5 * np.sum(ratios**2, axis=1)[:, None] / SHARED_SCALES**2
        + 2 * np.log(np.sqrt(2 / np.pi) / SHARED_SCALES)
        - np.log(SHARED_SCALES.size)
    )
    widths = np.full(b.size, b[1] - b[0])
    widths[[0, -1]] *= 0.5
    cells = np.tile(np.log(widths), a.size) + np.log(a[1] - a[0])
    log_prior = np.log(np.exp(each).sum(axis=1)) - np.log(1.6) + cells
    truth = by_quadrature(runs, grid, log_prior, factors=301, reach=1.0)
    result = joined(runs, priors, EXACTLY)
    agrees(result, truth, grid)
    assert np.all(result.draws >= 0)


def test_a_term_s_own_parameter_is_the_same_in_all_runs() -> None:
    """Runs of one exponent whose coefficients differ. Control: if the factors multiplied the exponent too, evidence
    would be another."""
    priors: Mapping[str, Prior] = {"c_power": HalfNormal(0.2), "exponent": Normal(1.0, 0.5)}
    covariance = np.diag([0.002**2, 0.05**2])
    names, places = ["c_power", "exponent"], ([0.050, 1.6], [0.065, 1.64], [0.045, 1.58])
    runs = [run_of(names, p, covariance, shared=["exponent"]) for p in places]
    a, b = np.geomspace(0.025, 0.11, 121), np.linspace(1.4, 1.8, 81)
    grid = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
    log_prior = priors["c_power"].log_density(grid[:, 0]) + norm.logpdf(grid[:, 1], 1.0, 0.5)
    log_prior = log_prior + np.repeat(np.log(np.gradient(a)), b.size) + np.log(b[1] - b[0])
    truth = by_quadrature(runs, grid, log_prior, factors=301, reach=1.2)
    agrees(joined(runs, priors, EXACTLY), truth, grid, share=0.25)
    scaled = [run_of(names, p, covariance) for p in places]
    assert abs(joined(scaled, priors, EXACTLY).log_evidence - truth.log_evidence) > 5 * NATS


def test_deviations_have_one_size_in_all_runs() -> None:
    """Two combinations, of which each run prefers another: their likelihoods are multiplied before they are summed.
    Control: summed run by run they are larger by what one change of size costs."""
    prior = HalfNormal(0.3)
    runs = [run_at(0.05, 0.001, np.array([0.0, -9.0])), run_at(0.05, 0.001, np.array([-9.0, 0.0]))]
    log_sizes = np.log([0.3, 0.7])
    result = joined(runs, {"zeta": prior}, log_sizes, spread=0.0)
    plain = joined([run_at(0.05, 0.001)] * 2, {"zeta": prior}, EXACTLY, spread=0.0)
    assert result.log_evidence - plain.log_evidence == pytest.approx(-9.0, abs=1e-6)
    assert np.mean(result.combos == 1) == pytest.approx(0.7, abs=0.03)
    apart = np.log(0.3 + 0.7 * np.exp(-9)) + np.log(0.7 + 0.3 * np.exp(-9))
    assert apart > -9.0 + 5


def test_what_cannot_be_joined_is_a_fault() -> None:
    other = run_of(["mu_c"], [0.05], np.eye(1))
    for runs, name in (([], "zeta"), ([run_at(0.05, 0.001), other], "zeta"), ([other], "zeta")):
        with pytest.raises(ValueError, match="joined runs need the same parameters"):
            joined(runs, {name: HalfNormal(0.3)}, EXACTLY)
