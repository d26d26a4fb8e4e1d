"""The mode of a posterior: the climb to it, how finely it is solved there, and Laplace's approximation around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.levenberg_marquardt import (
    MAX_LAMBDA,
    Expansion,
    Maximum,
    Retract,
    Step,
    levenberg_marquardt,
    straight_on,
)
from bayesdamp.numerics.orthant import log_probability
from bayesdamp.priors import shared_precision
from bayesdamp.types import Refusal, Seed

CLOSE = 1e-3
"""A climb ends at a step of fewer posterior sds than this, if the step also gains less than its cube, in nats."""
ROUGHLY = 0.1
"""The same for a mode that is only compared with another: of a part of a record, or of a growing window."""
WALL = 1e-9
"""Value at which a reflected score stops in place of zero, where it has no slope."""
LONGEST = 3.0
"""Largest change of a score in one step: three prior sds."""
HOPELESS = 1e-7
"""Expected gain of a failed step, in nats, below which no shorter step is tried."""
STEPS = 60
BUDGET = 0.01
"""Largest change of the log likelihood (nats) that a finer solution of the motion may make within NEAR sds of the mode;
farther from the mode it may grow with the depth."""
NEAR = 3.0
"""Posterior sds from the mode."""
FINER = 0.01
"""Share of the tolerance with which the error of a motion is measured."""
NEGLIGIBLE = 15.0
"""Scales this many nats less probable than the best one are left out; together they add less than 1e-5."""
TWO_SIDED = 1.959964
"""Half-width of a normal's 95 % interval, in standard deviations."""


def maximise_posterior(
    likelihood: Likelihood,
    z: np.ndarray,
    *,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> Maximum:
    """Climb to the mode of a posterior from scores z, (d,).

    Every score has the prior N(0, 1) here: a scale that coefficients share is fixed at 1. Averaged over all scales the
    prior is highest where all these coefficients are 0, and climbs would end there on records of little damping.

    Parameters
    ----------
    likelihood : Likelihood
        Whose posterior it is.
    z : ndarray, shape (d,)
        Start.
    retract : callable
        Maps a point and a step to the point where the step ends.
    close : float
        As `CLOSE`.
    """
    curvature = likelihood.with_scale(1.0).curvature
    return maximise(curvature, likelihood.target.reflected, z, retract=retract, close=close)


def maximise(
    curvature: Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]],
    reflected: np.ndarray,
    z: np.ndarray,
    *,
    limit: int = STEPS,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> Maximum:
    """Climb to the maximum of a log density of scores.

    Parameters
    ----------
    curvature : callable
        Maps z, (d,), to the log density, its gradient, (d,), and its information, (d, d).
    reflected : ndarray of bool, shape (d,)
        Which scores end at zero.
    z : ndarray, shape (d,)
        Start.
    limit : int
        Largest number of steps.
    retract, close
        As in `maximise_posterior`.
    """

    def expand(z: np.ndarray) -> Expansion:
        value, gradient, information = curvature(z)
        return Expansion(float(value), gradient, information)

    def ended(step: Step) -> bool:
        if step.gain < 0:
            return step.expected < HOPELESS or step.damping > MAX_LAMBDA
        size = np.sqrt(max(float(step.move @ step.at.information @ step.move), 0.0))
        value = step.at.value + step.gain
        return bool(step.gain < close**3 * max(1.0, abs(value) * 1e-3) and size < close)

    start = np.where(reflected, np.abs(z), z)
    floor = np.where(reflected, WALL, -np.inf)
    top = levenberg_marquardt(expand, start, floor, ended, limit=limit, longest=LONGEST, retract=retract)
    return top if np.isfinite(top.value) else replace(top, converged=False)


@dataclass(frozen=True)
class LocalSearch:
    """One seed's climb to a mode.

    Attributes
    ----------
    seed : Seed
        Where it started.
    same : tuple of Seed
        Seeds that start at the same place; no further climb was made from them.
    start, end : float
        Log posterior at both ends.
    evaluations : int
        Number of likelihoods.
    origin, z : ndarray, shape (d,)
        Scores at the start and the end.
    volume : float
        Log of the square root of the determinant of the inverse information at the end, which weights modes.
    converged : bool
        Whether it ended at a maximum.
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
    """The part of a mode that is stored; the rest follows from it."""

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    tolerance: float
    searches: tuple[LocalSearch, ...]


@dataclass(frozen=True)
class LinearDraws:
    """The posterior of a model that is linear in parameters and deviations, where laws may hold approximately.

    Attributes
    ----------
    draws : ndarray, shape (m, d)
        Scores. Chains start at them, and their moments whiten.
    log_evidence : float
        In nats.
    """

    draws: np.ndarray
    log_evidence: float


@dataclass(frozen=True)
class Mode:
    """A posterior mode in scores.

    It is the mode of the density in which every score has the prior N(0, 1): a scale that damping coefficients share is
    fixed at 1.

    Attributes
    ----------
    z : ndarray, shape (d,)
        The mode.
    log_posterior : float
        Log of that density at z.
    information : ndarray, shape (d, d)
        Its negative Gauss–Newton Hessian at z.
    likelihood : Likelihood
        Whose mode it is.
    searches : tuple of LocalSearch
        The climbs that led to it and to other modes.
    step_error, likelihood_error : float
        Change by a finer solution of the motion within three sds of the mode, in the unit of the record and in nats.
    linear : LinearDraws or None
        The linear model's posterior, where laws may hold approximately.
    """

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    likelihood: Likelihood
    searches: tuple[LocalSearch, ...] = ()
    step_error: float = np.nan
    likelihood_error: float = np.nan
    linear: LinearDraws | None = None

    @property
    def tolerance(self) -> float:
        """Error of a motion, in the unit of the record."""
        return self.likelihood.tolerance

    @property
    def near(self) -> Likelihood:
        """The likelihood with one shared scale that represents all scales near z."""
        return self._normal[0]

    @property
    def factor(self) -> np.ndarray:
        """Cholesky factor of the posterior's covariance with that scale, (d, d), which whitens.

        Raises Refusal where the information is not positive.
        """
        return self._normal[1]

    @cached_property
    def _normal(self) -> tuple[Likelihood, np.ndarray]:
        """The likelihood and the factor of a normal distribution near the mode.

        The 1/σ² of its scale is the mean over the scales given the expected sum of squares of the coefficients: a step
        of variational Bayes. Where the record shows no damping, the scale is that of the damping that it would show.
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
        return self.likelihood.with_scale(precision**-0.5), factor

    @property
    def stored(self) -> StoredMode:
        """The part of it that is stored."""
        return StoredMode(self.z, self.log_posterior, self.information, self.tolerance, self.searches)

    def sd(self) -> np.ndarray:
        """Return the Laplace standard deviations of the scores, (d,)."""
        return np.sqrt(np.sum(self.factor**2, axis=1))


def settle(target: Target, z: np.ndarray, tolerance: float, searches: tuple[LocalSearch, ...]) -> Mode:
    """Solve the motion near a mode so finely that a finer solution changes the likelihood by less than `BUDGET`.

    Parameters
    ----------
    target : Target
        Whose mode it is.
    z : ndarray, shape (d,)
        Scores at or near the mode.
    tolerance : float
        First tolerance of the motion, in the unit of the record.
    searches : tuple of LocalSearch
        The climbs that led to it.

    Raises
    ------
    Refusal
        Where the posterior has no finite mode near z, or no curvature there.
    """
    attempts = 0
    while True:
        attempts += 1
        likelihood = Likelihood.near(target, z, tolerance)
        top = _highest(likelihood, z)
        z = top.x
        mode = Mode(z, top.value, top.information, likelihood, searches)
        moved, change = _solution_errors(likelihood, z, mode.factor)
        if change < BUDGET or attempts == 6:
            return replace(mode, step_error=moved, likelihood_error=change)
        tolerance *= np.clip(BUDGET / change, 1e-3, 0.5) * 0.5


def mode_near(likelihood: Likelihood, mode: Mode, z: np.ndarray) -> Mode:
    """Return the mode of a similar posterior, such as one of a part of the record, from scores z, (d,).

    Raises Refusal where it is not finite.
    """
    top = _highest(likelihood, z)
    return replace(mode, z=top.x, log_posterior=top.value, information=top.information, likelihood=likelihood)


def _highest(likelihood: Likelihood, z: np.ndarray) -> Maximum:
    top = maximise_posterior(likelihood, z)
    if not np.isfinite(top.value):
        raise Refusal("the posterior is not finite at its mode")
    return top


def _solution_errors(likelihood: Likelihood, z: np.ndarray, factor: np.ndarray) -> tuple[float, float]:
    """Return the changes (unit of the record, nats) by a finer solution, at most, at z and around it.

    Around it: three sds away in each whitened direction.
    """
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


def whitening(information: np.ndarray) -> np.ndarray:
    """Return the Cholesky factor of the inverse of the information, (d, d). Raises Refusal where that is not positive.

    The information is factored before it is inverted: the inverse of a matrix with stiff and loose directions may lose
    its positivity to rounding.
    """
    try:
        if not np.all(np.isfinite(information)):
            raise np.linalg.LinAlgError
        turned = np.linalg.cholesky(0.5 * (information + information.T)[::-1, ::-1])
    except np.linalg.LinAlgError:
        raise Refusal("the posterior has no curvature at its mode") from None
    return scipy.linalg.solve_triangular(turned[::-1, ::-1], np.eye(len(information)), trans=1, lower=False)


def restore_mode(target: Target, stored: StoredMode) -> Mode:
    """Return a mode from the part of it that was stored."""
    likelihood = Likelihood.near(target, stored.z, stored.tolerance)
    return Mode(stored.z, stored.log_posterior, stored.information, likelihood, stored.searches)


def log_evidence_near(likelihood: Likelihood, z: np.ndarray) -> float:
    """Return Laplace's log evidence from the expansion at scores z, (d,), at or near a mode.

    The likelihood is expanded, and each value of a scale that coefficients share has its own integral.
    """
    target, scales = likelihood.target, np.asarray(likelihood.scales)
    at = np.where(target.reflected, np.abs(z), z)
    value, gradient, information = likelihood.with_scale(1.0).curvature(at)
    reflected, shared = np.flatnonzero(target.reflected), target.shared
    if not shared.any():
        return log_integral(value, gradient, information, at, reflected)
    count, squares = int(shared.sum()), float(np.sum(at[shared] ** 2))

    def log_at_scale(scale: float, walls: np.ndarray) -> float:
        extra = (scale**-2 - 1.0) * shared
        height = value - 0.5 * (scale**-2 - 1.0) * squares - count * np.log(scale)
        return log_integral(height, gradient - extra * at, information + np.diag(extra), at, walls)

    logs: list[float] = []
    folded = float(reflected.size * np.log(2.0))
    for whole, scale in sorted(((log_at_scale(s, reflected[:0]), s) for s in scales), reverse=True):
        if logs and whole + folded < max(logs) - NEGLIGIBLE:
            break  # walls can only make an integral smaller
        logs.append(log_at_scale(scale, reflected))
    return float(scipy.special.logsumexp(logs) - np.log(scales.size))


def log_evidence_about(mode: Mode) -> float:
    """Return Laplace's log evidence about a mode; where laws may hold approximately, that of the linear model."""
    return log_evidence_near(mode.likelihood, mode.z) if mode.linear is None else mode.linear.log_evidence


def log_integral(
    value: float, gradient: np.ndarray, information: np.ndarray, at: np.ndarray, reflected: np.ndarray
) -> float:
    """Integrate exp(value + g·(z − at) − (z − at)ᵀ H (z − at)/2) over z ≥ 0 in the reflected scores.

    Parameters
    ----------
    value : float
        Log density at `at`.
    gradient, information : ndarray, shapes (d,) and (d, d)
        g and H.
    at : ndarray, shape (d,)
        Point of expansion.
    reflected : ndarray of int
        Indices of the reflected scores.

    Returns
    -------
    float
        Log of the integral, times two for each reflected score.
    """
    covariance = np.linalg.inv(information)
    mean = at + covariance @ gradient
    log_det = np.linalg.slogdet(information)[1]
    whole = value + 0.5 * gradient @ covariance @ gradient
    whole += 0.5 * at.size * np.log(2 * np.pi) - 0.5 * log_det
    if not reflected.size:
        return float(whole)
    inside = log_probability(mean[None, reflected], covariance[None, reflected[:, None], reflected])[0]
    return float(whole + inside + reflected.size * np.log(2.0))


def value_sds(target: Target, z: np.ndarray, covariance: np.ndarray) -> dict[str, float]:
    """Return Laplace sds of the parameters in natural units from the covariance of the scores, (d, d)."""
    sds = np.abs(target.rates(z)) * np.sqrt(np.diag(covariance))
    return dict(zip(target.names, sds.tolist(), strict=True))


def value_intervals(target: Target, z: np.ndarray, sd: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return the 95 % interval of each parameter by name, from the normal distribution of its score about the mode.

    An interval ends at the edge of a half-normal prior.
    """
    low, high = z - TWO_SIDED * sd, z + TWO_SIDED * sd
    low = np.where(target.reflected, np.maximum(low, 0.0), low)
    ends = target.values(low), target.values(high)
    return {n: (float(ends[0][n]), float(ends[1][n])) for n in target.names}
