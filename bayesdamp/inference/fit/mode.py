"""A mode of the posterior, how finely it is solved there, and the posterior's shape around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from bayesdamp.inference.fit.maximise import maximise_posterior
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.priors import shared_precision
from bayesdamp.types import Refusal, Seed

BUDGET = 0.01
"""Largest change of the log likelihood (nats) that a finer solution of the motion may make within NEAR sds of the mode;
farther down than there it may grow with the depth."""
NEAR = 3.0
"""Posterior sds from the mode."""
FINER = 0.01
"""Share of the tolerance with which the error of a motion is measured."""


@dataclass(frozen=True)
class LocalSearch:
    """One seed's way to a mode: where it started and ended (scores, log posterior), and what it cost.

    same: the seeds that start at the same place and were not climbed again.
    origin, z: scores at the start and the end, (d,). volume: log of the square root of the determinant of the inverse
    information at the end, by which modes are weighed.
    """

    seed: Seed
    same: tuple[Seed, ...]
    start: float
    end: float
    evaluations: int
    origin: np.ndarray
    z: np.ndarray
    volume: float
    converged: bool


@dataclass(frozen=True)
class StoredMode:
    """What is stored of a mode: all that the rest of it follows from."""

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    tolerance: float
    searches: tuple[LocalSearch, ...]


@dataclass(frozen=True)
class LinearPosterior:
    """The posterior of a model that is linear in parameters and deviations, where laws may hold approximately.

    draws: scores, (m, d), where chains start and whose moments whiten; log_evidence: in nats.
    """

    draws: np.ndarray
    log_evidence: float


@dataclass(frozen=True)
class Mode:
    """A posterior mode in scores.

    It is the mode of the density in which every score has the prior N(0, 1): a scale that damping coefficients share is
    held at 1. log_posterior: log of that density at z, shape (d,); information: its negative Gauss–Newton Hessian
    there, (d, d); likelihood: whose mode it is.
    step_error, likelihood_error: what a finer solution changes within three sds of the mode, in the unit of the
    record and in nats.
    linear: the linear model's posterior, where laws may hold approximately.
    """

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    likelihood: Likelihood
    searches: tuple[LocalSearch, ...] = ()
    step_error: float = np.nan
    likelihood_error: float = np.nan
    linear: LinearPosterior | None = None

    @property
    def tolerance(self) -> float:
        """Error of a motion, in the unit of the record."""
        return self.likelihood.tolerance

    @property
    def near(self) -> Likelihood:
        """The likelihood with the one shared scale that stands for all of them about z."""
        return self._normal[0]

    @property
    def factor(self) -> np.ndarray:
        """Cholesky factor of the posterior's covariance with that scale, (d, d), which whitens.

        Raises Refusal where the information is not positive.
        """
        return self._normal[1]

    @cached_property
    def _normal(self) -> tuple[Likelihood, np.ndarray]:
        """What a normal distribution near the mode is made with.

        The scale has as its 1/σ² the mean over the scales given the expected sum of squares of the coefficients: a step
        of variational Bayes. Where the record shows no damping the scale is then that of what it would show.
        """
        shared = self.likelihood.target.shared
        if self.linear is None:
            factor = whitening(self.information)
            squares = np.sum(self.z[shared] ** 2) + np.sum(factor[shared] ** 2)
        else:
            factor = np.linalg.cholesky(np.atleast_2d(np.cov(self.linear.draws.T)))
            squares = np.mean(np.sum(self.linear.draws[:, shared] ** 2, axis=1))
        if not shared.any():
            return self.likelihood, factor
        scales = np.asarray(self.likelihood.scales)
        precision = float(shared_precision(float(squares), int(shared.sum()), scales))
        if self.linear is None:
            factor = whitening(self.information + np.diag((precision - 1.0) * shared))
        return self.likelihood.held(precision**-0.5), factor

    @property
    def stored(self) -> StoredMode:
        """What is stored of it."""
        return StoredMode(self.z, self.log_posterior, self.information, self.tolerance, self.searches)

    def sd(self) -> np.ndarray:
        """Laplace standard deviations of the scores, shape (d,)."""
        return np.sqrt(np.sum(self.factor**2, axis=1))


def settle(target: Target, z: np.ndarray, tolerance: float, searches: tuple[LocalSearch, ...]) -> Mode:
    """Solve motions at the mode so well that a finer solution changes the likelihood by less than the budget."""
    attempts = 0
    while True:
        attempts += 1
        likelihood = Likelihood.near(target, z, tolerance)
        top = maximise_posterior(likelihood, z)
        if not np.isfinite(top.value):
            raise Refusal("the posterior is not finite at its mode")
        z = top.x
        mode = Mode(z, top.value, top.information, likelihood, searches)
        moved, change = _solution_errors(likelihood, z, mode.factor)
        if change < BUDGET or attempts == 6:
            return replace(mode, step_error=moved, likelihood_error=change)
        tolerance *= np.clip(BUDGET / change, 1e-3, 0.5) * 0.5


def _solution_errors(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> tuple[float, float]:
    """Return what a finer solution changes (unit of the record, nats) at z and three sds from it in each whitened
    direction."""
    finer = likelihood.within(FINER * likelihood.tolerance)
    top: float | None = None
    moved = change = 0.0
    around = z + np.concatenate([np.zeros((1, z.size)), NEAR * factor.T, -NEAR * factor.T])
    for at in around:
        coarse, fine = likelihood.residual(at), finer.residual(at)
        lower, upper = likelihood.log_noise(coarse, at), finer.log_noise(fine, at)
        top = upper - 0.5 * float(at @ at) if top is None else top
        if not (np.isfinite(lower) and np.isfinite(upper)):
            continue
        depth = top - (upper - 0.5 * float(at @ at))
        change = max(change, abs(lower - upper) * min(1.0, 0.5 * NEAR**2 / max(depth, 1e-300)))
        moved = max(moved, float(np.max(np.abs(coarse - fine))))
    return moved, change


def mode_near(likelihood: Likelihood, mode: Mode, z: np.ndarray) -> Mode:
    """Return the mode of another posterior close by, such as one of a part of the record, from scores z, (d,). Raises
    Refusal where it is not finite."""
    top = maximise_posterior(likelihood, z)
    if not np.isfinite(top.value):
        raise Refusal("the posterior is not finite at its mode")
    return replace(mode, z=top.x, log_posterior=top.value, information=top.information, likelihood=likelihood)


def whitening(information: np.ndarray) -> np.ndarray:
    """Cholesky factor of the inverse of the information, (d, d). Raises Refusal where that is not positive.

    Factored before it is inverted: an inverse of stiff and loose directions may have lost its positivity to rounding.
    """
    try:
        if not np.all(np.isfinite(information)):
            raise np.linalg.LinAlgError
        turned = np.linalg.cholesky(0.5 * (information + information.T)[::-1, ::-1])
    except np.linalg.LinAlgError:
        raise Refusal("the posterior has no curvature at its mode") from None
    return solve_triangular(turned[::-1, ::-1], np.eye(len(information)), trans=1, lower=False)


def restore_mode(target: Target, stored: StoredMode) -> Mode:
    """Return a mode from what was stored of it."""
    likelihood = Likelihood.near(target, stored.z, stored.tolerance)
    return Mode(stored.z, stored.log_posterior, stored.information, likelihood, stored.searches)
