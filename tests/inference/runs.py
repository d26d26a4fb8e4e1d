"""Likelihoods of several runs of a specimen, and their evidence and posterior by quadrature."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr
from scipy.stats import halfnorm

from bayesdamp.inference.deviation.linear import DampingLikelihood
from bayesdamp.inference.deviation.repeats import SPREAD_SCALE, RecordLikelihood

NODES, MASSES = np.polynomial.legendre.leggauss(60)
LARGEST = 0.6
"""Largest spread in the quadrature. The prior beyond it is below 1e-8."""


def run_of(
    names: Sequence[str],
    place: Sequence[float],
    covariance: np.ndarray,
    log: float | np.ndarray = 0.0,
    shared: Sequence[str] = (),
) -> RecordLikelihood:
    """Return a run whose likelihood is normal about a place, (k,), with a maximum of exp(log) for each of the c
    combinations of sizes, (c,). shared: the parameters that are not coefficients."""
    at, information = np.asarray(place, float), np.linalg.inv(np.atleast_2d(covariance))
    logs = np.atleast_1d(np.asarray(log, float))
    count = logs.size
    log, slopes = logs - 0.5 * at @ information @ at, np.tile(information @ at, (count, 1))
    likelihood = DampingLikelihood(log, slopes, np.tile(information, (count, 1, 1)))
    return RecordLikelihood(tuple(names), np.array([n not in shared for n in names]), at, likelihood)


def log_likelihood(run: RecordLikelihood, x: np.ndarray, combo: int = 0) -> np.ndarray:
    """Return the log likelihood of parameters x, (..., k), shape (...)."""
    result = run.likelihood
    square = np.einsum("...i,ij,...j->...", x, result.information[combo], x)
    return result.log[combo] + x @ result.slope[combo] - 0.5 * square


class Summed(NamedTuple):
    """Log evidence, posterior masses of m points of the grid and of each point with each of s spreads, and spreads."""

    log_evidence: float
    mass: np.ndarray
    each: np.ndarray
    spreads: np.ndarray


def by_quadrature(
    runs: Sequence[RecordLikelihood],
    grid: np.ndarray,
    log_prior: np.ndarray,
    spread: float | None = None,
    factors: int = 1601,
    reach: float = 1.6,
) -> Summed:
    """Return evidence and posterior of the parameters of the specimen.

    Parameters
    ----------
    grid
        Points, (m, k).
    log_prior
        Log prior mass of each, (m,).
    spread
        Spread of the factors of the runs. If it is None, the sum is over its half-normal prior.
    factors, reach
        Number and largest value of the logarithms of a run's factor in the sum.
    """
    if spread is None:
        spreads = 0.5 * LARGEST * (NODES + 1)
        prior = np.log(0.5 * LARGEST * MASSES) + halfnorm.logpdf(spreads, scale=SPREAD_SCALE)
    else:
        spreads, prior = np.array([spread]), np.zeros(1)
    # Probabilities of the cells of a log factor t, (t, s), which are also right for spreads smaller than a cell.
    t = np.linspace(-reach, reach, factors)
    edges = np.concatenate([[-np.inf], 0.5 * (t[1:] + t[:-1]), [np.inf]])
    masses = np.diff(ndtr(edges[:, None] / np.maximum(spreads, 1e-12)), axis=0)
    log = log_prior[:, None] + prior
    for run in runs:
        multiple = np.where(run.coefficients, np.exp(t)[:, None], 1.0)
        each = log_likelihood(run, grid[:, None, :] * multiple)
        top = each.max()
        log = log + np.log(np.exp(each - top) @ masses + 1e-300) + top
    top = log.max()
    each = np.exp(log - top)
    total = each.sum()
    return Summed(float(top + np.log(total)), each.sum(axis=1) / total, each / total, spreads)
