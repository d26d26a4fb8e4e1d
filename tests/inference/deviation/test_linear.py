"""Evidence and posteriors of the linear model against dense normal distributions and quadrature."""

import mpmath
import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from bayesdamp.inference.deviation.linear import (
    Grid,
    condense,
    grid_of,
    linear_posterior,
    normals,
    score_normals,
)

N, KNOTS, SD = 30, 4, 0.3


def problem(seed: int, d: int, knots: int = KNOTS) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (n, d + 2 knots) and a record minus the constant part, (n,)."""
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((N, d + 2 * knots))
    return columns, columns[:, :d] @ rng.standard_normal(d) + SD * rng.standard_normal(N)


def dense(columns: np.ndarray, y: np.ndarray, d: int, grid: Grid) -> np.ndarray:
    """Return the log evidence of each combination: y is normal with the covariance of noise, scores and deviations."""
    each = []
    for log_prior, factor in zip(grid.log_prior, grid.factors):
        rest = columns[:, d:] @ factor
        covariance = SD**2 * np.eye(N) + columns[:, :d] @ columns[:, :d].T + rest @ rest.T
        each.append(log_prior + multivariate_normal.logpdf(y, np.zeros(N), covariance))
    return np.array(each)


def test_evidence_and_posterior_are_those_of_a_dense_normal() -> None:
    """Means and covariances follow from conditioning a normal in the space of the samples."""
    columns, y = problem(1, 3)
    grid = grid_of(KNOTS, coarse=True)
    model = condense(columns, y, np.zeros(3, bool))
    posterior = linear_posterior(model, grid, SD**2, N)
    truth = dense(columns, y, 3, grid)
    assert posterior.log_each == pytest.approx(truth, abs=1e-7)
    assert posterior.log_evidence == pytest.approx(float(logsumexp(truth)), abs=1e-7)
    other = linear_posterior(model, grid, (1.1 * SD) ** 2, N)
    assert abs(other.log_evidence - float(logsumexp(truth))) > 0.1  # control: another noise

    variance = np.zeros(3 + 2 * KNOTS)
    for i, weight in enumerate(np.exp(truth - logsumexp(truth))):
        prior = np.eye(3 + 2 * KNOTS)
        prior[3:, 3:] = grid.factors[i] @ grid.factors[i].T
        gain = prior @ columns.T @ np.linalg.inv(columns @ prior @ columns.T + SD**2 * np.eye(N))
        assert posterior.means[i] == pytest.approx(gain @ y, abs=1e-8)
        covariance = prior - gain @ columns @ prior
        assert posterior.factors[i] @ posterior.factors[i].T == pytest.approx(covariance, abs=1e-8)
        variance += weight * np.diag(covariance)
    assert posterior.sds(np.eye(variance.size)) == pytest.approx(np.sqrt(variance), rel=1e-6)


def test_scores_alone_have_the_marginal_posterior() -> None:
    """With the deviations integrated out, evidence, means and covariances of the scores are those of the whole."""
    columns, y = problem(2, 3)
    model, grid = condense(columns, y, np.zeros(3, bool)), grid_of(KNOTS, coarse=True)
    whole, scores = (function(model, grid, SD**2, N) for function in (normals, score_normals))
    covariance, own = (of.factors @ np.swapaxes(of.factors, 1, 2) for of in (whole, scores))
    assert scores.log == pytest.approx(whole.log, abs=1e-8)
    assert scores.means == pytest.approx(whole.means[:, :3], abs=1e-9)
    assert own == pytest.approx(covariance[:, :3, :3], abs=1e-9)
    conditional = np.linalg.inv(np.linalg.inv(covariance[-1])[:3, :3])
    assert not np.allclose(conditional, covariance[-1, :3, :3], rtol=0.01)  # control: deviations held


@pytest.mark.parametrize(("shift", "positive"), [(0.0, 1), (1.0, 2), (-0.4, 2)])
def test_evidence_under_half_normal_priors_is_that_of_quadrature(shift: float, positive: int) -> None:
    """For coefficients far above zero, at zero, and whose likelihood is below zero. Control: without the half-normal
    priors it is another one."""
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((N, 3)) * [0.4, 0.4, 1.0]
    columns[:, 1] = -0.9 * columns[:, 0] + 0.2 * columns[:, 1]
    y = columns @ [shift, shift, 0.7] + SD * rng.standard_normal(N)
    mask = np.array([i < positive for i in range(3)])
    posterior = linear_posterior(condense(columns, y, mask), grid_of(0, exact=True), SD**2, N)
    step = 0.01
    axis = np.arange(0.5 * step, 5.0, step)
    points = np.stack(np.meshgrid(*[axis] * positive, indexing="ij"), axis=-1).reshape(-1, positive)
    free = columns[:, ~mask]
    lower = np.linalg.cholesky(SD**2 * np.eye(N) + free @ free.T)
    white = np.linalg.solve(lower, y)[:, None] - np.linalg.solve(lower, columns[:, mask]) @ points.T
    logs = -0.5 * np.sum(white**2, axis=0) - 0.5 * np.sum(points**2, axis=1)
    constant = -np.sum(np.log(np.diag(lower))) - 0.5 * N * np.log(2 * np.pi)
    constant += positive * (np.log(2 * step) - 0.5 * np.log(2 * np.pi))
    truth = float(logsumexp(logs)) + constant
    assert posterior.log_evidence == pytest.approx(truth, abs=2e-3)
    whole = linear_posterior(condense(columns, y, np.zeros(3, bool)), grid_of(0, exact=True), SD**2, N)
    assert abs(whole.log_evidence - truth) > 0.03


@pytest.mark.parametrize(("deviating", "apart"), [(1.0, 1.0), (1e-5, 1e-6)])
def test_evidence_is_accurate_for_very_little_noise(deviating: float, apart: float) -> None:
    """Noise of 1e-8, against numbers of fifty digits; also if the deviations have little effect, and the record
    determines the scores far better than their priors, but nearly only a combination of them."""
    sd, (columns, y) = 1e-8, problem(6, 2)
    columns[:, 1] = columns[:, 0] + apart * columns[:, 1]
    columns[:, 2:] *= deviating
    y = columns[:, :2] @ [0.7, -0.4] + sd * np.random.default_rng(1).standard_normal(N)
    grid = grid_of(KNOTS, coarse=True)
    model = condense(columns, y, np.zeros(2, bool))
    posterior = linear_posterior(model, grid, sd**2, N)
    assert np.all(np.isfinite(posterior.log_each))
    with mpmath.workdps(50):
        for i in (0, len(grid.log_prior) - 1):
            rest = mpmath.matrix(columns[:, 2:].tolist()) * mpmath.matrix(grid.factors[i].tolist())
            scores = mpmath.matrix(columns[:, :2].tolist())
            covariance = mpmath.mpf(sd) ** 2 * mpmath.eye(N) + scores * scores.T + rest * rest.T
            record = mpmath.matrix(y.tolist())
            squares = (record.T * mpmath.lu_solve(covariance, record))[0]
            truth = -(squares + mpmath.log(mpmath.det(covariance)) + N * mpmath.log(2 * mpmath.pi)) / 2
            assert posterior.log_each[i] == pytest.approx(float(truth) + grid.log_prior[i], abs=0.02)
            both = normals(model, grid.only(np.array([i])), sd**2, N)
            assert both.log[0] == pytest.approx(posterior.log_each[i], abs=0.02)
            assert both.means[0, :2] == pytest.approx(posterior.means[i, :2], abs=1e-3)
            mean = [float(z) for z in scores.T * mpmath.lu_solve(covariance, record)]
            assert both.means[0, :2] == pytest.approx(mean, abs=1e-4)
