"""The mode of a posterior: its search, the accuracy of the motion there, and Laplace's approximation.

The search is in standard normal scores: each inferred parameter is transformed so that its prior is N(0, 1).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.numerics.levenberg_marquardt import (
    Expansion,
    Maximum,
    Retract,
    Step,
    levenberg_marquardt,
    straight_on,
)
from bayesdamp.numerics.orthant import log_probability
from bayesdamp.priors import shared_precision
from bayesdamp.types import NORMAL_95, Refusal, Status

LAST_STEP = 1e-3
"""A search for a mode converges with a step that is shorter than this, in posterior sds. The step must also increase
the log density by less than the cube of this, in nats; if the absolute log density is above 1000, this second limit is
multiplied by |log density| / 1000 (conventional)."""
ROUGH_LAST_STEP = 0.1
"""Replaces `LAST_STEP`, the length of the last step in posterior sds, in a search whose mode is only the start of
another search or serves for a comparison."""
SMALLEST_SCORE = 1e-9
"""Lower bound, in the search for a mode, of the standard normal score of a parameter with a half-normal prior (a
reflected score). It replaces 0, where the derivative vanishes."""
LONGEST_STEP = 3.0
"""Largest change of a parameter's standard normal score in one step of a search for a mode; a longer step is scaled
down."""
HOPELESS_GAIN = 1e-7
"""If a step of a search for a mode is rejected although its expected gain of the log density was smaller than this, in
nats, the search ends and counts as converged; a shorter step would not help."""
MOST_STEPS = 60
"""Largest number of trial steps in a search for a mode, including rejected ones. A search that this number ends has not
converged."""


def maximise_posterior(
    likelihood: Likelihood, z: np.ndarray, *, retract: Retract = straight_on, close: float = LAST_STEP
) -> Maximum:
    """Search for the mode of a posterior, starting from scores z, (d,).

    Scores are the inferred parameters, transformed so that their priors are standard normal. The common prior scale of
    damping coefficients is fixed at 1, so that every score has the prior N(0, 1). (The prior that is averaged over all
    scales has its maximum where all these coefficients are 0; on records with little damping the search would end
    there.)

    Parameters
    ----------
    likelihood : Likelihood
        Likelihood and target of the posterior.
    z : ndarray, shape (d,)
        Start of the search: the inferred parameters as standard normal scores.
    retract : callable
        Function of a point, (d,), and a step, (d,), that returns the end of the step, (d,), which may follow a curve;
        by default it returns their sum.
    close : float
        The search ends with a step that is shorter than this, in posterior sds, and whose gain is small too (see
        `LAST_STEP`), or whose gain cannot be more than `HOPELESS_GAIN`.

    Returns
    -------
    Maximum
        The end of the search: scores, and log posterior (nats, with the scale 1) and its information there. The value
        is −∞ if it is not finite at the start; `converged` must be checked.
    """
    curvature = likelihood.with_scale(1.0).curvature
    return maximise(curvature, likelihood.target.reflected, z, retract=retract, close=close)


def maximise(
    curvature: Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]],
    reflected: np.ndarray,
    z: np.ndarray,
    *,
    retract: Retract = straight_on,
    close: float = LAST_STEP,
) -> Maximum:
    """Search for the maximum of a log density of standard normal scores by the Levenberg–Marquardt method.

    Parameters
    ----------
    curvature : callable
        Function that returns, at scores z, (d,), the log density, its gradient, (d,), and its information (negative
        Hessian or an approximation of it), (d, d).
    reflected : ndarray of bool, shape (d,)
        Which scores must not be negative; their lower bound is `SMALLEST_SCORE`.
    z : ndarray, shape (d,)
        Start of the search; |z| is used for the scores in `reflected`.
    retract : callable
        Function of a point, (d,), and a step, (d,), that returns the end of the step, (d,); by default their sum.
    close : float
        The search ends with a step that is shorter than this, in posterior sds, and whose gain is small too (see
        `LAST_STEP`), or whose gain cannot be more than `HOPELESS_GAIN`.

    Returns
    -------
    Maximum
        The end of the search, which may not have converged; its value is −∞ if the log density is not finite at the
        start.
    """

    def expand(z: np.ndarray) -> Expansion:
        value, gradient, information = curvature(z)
        return Expansion(float(value), gradient, information)

    def has_converged(step: Step) -> bool:
        if step.gain < 0:
            return step.expected < HOPELESS_GAIN
        size = np.sqrt(max(float(step.move @ step.at.information @ step.move), 0.0))
        value = step.at.value + step.gain
        return bool(step.gain < close**3 * max(1.0, abs(value) * 1e-3) and size < close)

    start = np.where(reflected, np.abs(z), z)
    floor = np.where(reflected, SMALLEST_SCORE, -np.inf)
    top = levenberg_marquardt(
        expand, start, floor, has_converged, limit=MOST_STEPS, longest=LONGEST_STEP, retract=retract
    )
    return top if np.isfinite(top.value) else replace(top, converged=False)


@dataclass(frozen=True)
class LocalSearch:
    """The result of one search for a mode, from one start.

    Attributes
    ----------
    origin, z : ndarray, shape (d,)
        Start and end of the search, as scores (parameters transformed so that their priors are standard normal). At the
        start, parameters of the noise are already estimated from the residuals.
    end : float
        Log posterior density at the end, in nats, not normalised, with the common prior scale of coefficients fixed at
        1; −∞ if it is not finite at the start.
    volume : float
        Log volume of the posterior at the end: −½ log det of the information; −∞ if the determinant is not positive.
        The probability of a mode is proportional to exp(end + volume).
    converged : bool
        Whether the search ended at an acceptable maximum. It is False, for example, if the search reached the limit of
        steps, or if the residual at the end is above `MOST_RESIDUAL`.
    """

    origin: np.ndarray
    z: np.ndarray
    end: float
    volume: float
    converged: bool


@dataclass(frozen=True)
class StoredMode:
    """The values from which `restore_mode` rebuilds a mode.

    z: standard normal scores at the mode, (d,). log_posterior, information: log posterior density there, in nats, and
    its negative Gauss–Newton Hessian, (d, d), as in `Mode`. tolerance: largest allowed error of a motion, in the
    record's unit. searches: all local searches for the mode.
    """

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    tolerance: float
    searches: tuple[LocalSearch, ...]


@dataclass(frozen=True)
class LinearDraws:
    """The posterior of a linear model, in which the record is linear in the scores and in the deviations from the laws.

    Scores are the inferred parameters, transformed so that their priors are standard normal. Deviations are slow
    changes of damping and frequency that the damping and restoring laws do not describe.

    Attributes
    ----------
    draws : ndarray, shape (m, d)
        Draws of the scores. Chains start at them, and their mean and covariance define the coordinates of samplers.
    log_evidence : float
        Log evidence of the linear model in nats.
    """

    draws: np.ndarray
    log_evidence: float


@dataclass(frozen=True)
class Mode:
    """The mode of a posterior, as scores of the inferred parameters.

    Scores are parameters, transformed so that their priors are standard normal.

    If damping and restoring laws are exact, it is the maximum of the posterior with the common prior scale of damping
    coefficients fixed at 1. If the model allows for deviations from its laws, it is the joint mode of scores and
    deviations; the model is linearised there, and `linear` is set.

    Attributes
    ----------
    z : ndarray, shape (d,)
        Scores at the mode.
    log_posterior : float
        Log posterior density of the scores at z, in nats, not normalised, with the common prior scale fixed at 1. If
        `linear` is set, the deviations and this scale are integrated out instead.
    information : ndarray, shape (d, d)
        Negative Gauss–Newton Hessian of this density at z. If `linear` is set, it is the inverse covariance of the
        draws in it.
    likelihood : Likelihood
        Likelihood and target of the posterior.
    searches : tuple of LocalSearch
        The searches that led to this and to other modes; empty if `linear` is set.
    linear : LinearDraws or None
        Posterior of the linear model that includes deviations from the laws; None if the laws are exact.
    """

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    likelihood: Likelihood
    searches: tuple[LocalSearch, ...] = ()
    linear: LinearDraws | None = None

    @property
    def near(self) -> Likelihood:
        """The likelihood with the common prior scale of damping coefficients fixed at a typical value near the mode.

        All coefficients with a shared half-normal prior have the same, unknown scale. Without such coefficients it is
        `likelihood` itself. Raises Refusal, as `factor` does, if the information is not positive definite.
        """
        return self._normal[0]

    @property
    def factor(self) -> np.ndarray:
        """Lower Cholesky factor, (d, d), of the posterior covariance of the standard normal scores.

        If the laws are exact, the covariance is the inverse of `information`, with the prior scale that damping
        coefficients share fixed as in `near`; raises Refusal if the information is not positive definite. If `linear`
        is set, it is the covariance of the draws in `linear`.
        """
        return self._normal[1]

    @cached_property
    def _normal(self) -> tuple[Likelihood, np.ndarray]:
        """The values of `near` and `factor`, as a tuple.

        σ, the common prior scale of damping coefficients, follows from the mean of 1/σ² over its possible values, given
        the expected sum of squares of the coefficients' scores (one step of variational Bayes). The expected value
        includes the variance of these scores, so that σ is not too small on a record without damping.
        """
        shared = self.likelihood.target.shared
        if self.linear is None:
            factor = covariance_factor(self.information)
            squares = np.sum(self.z[shared] ** 2) + np.sum(factor[shared] ** 2)
        else:
            factor = np.linalg.cholesky(np.atleast_2d(np.cov(self.linear.draws.T)))
            squares = np.mean(np.sum(self.linear.draws[:, shared] ** 2, axis=1))
        if not shared.any():
            return self.likelihood, factor
        scales = np.asarray(self.likelihood.scales)
        precision = float(shared_precision(float(squares), int(shared.sum()), scales))
        if self.linear is None:
            factor = covariance_factor(self.information + np.diag((precision - 1.0) * shared))
        return self.likelihood.with_scale(precision**-0.5), factor

    @property
    def stored(self) -> StoredMode:
        """The values of the mode that are stored in a file; `restore_mode` rebuilds the mode from them."""
        return StoredMode(
            self.z, self.log_posterior, self.information, self.likelihood.tolerance, self.searches
        )

    def sd(self) -> np.ndarray:
        """Return the posterior sds of the standard normal scores, (d,), from the covariance of `factor`.

        Raises Refusal if `information` is not positive definite.
        """
        return np.sqrt(np.sum(self.factor**2, axis=1))


def covariance_factor(information: np.ndarray) -> np.ndarray:
    """Return the lower Cholesky factor, (d, d), of a covariance matrix from its inverse, the information, (d, d).

    The information is factored before it is inverted, because rounding can make the inverse of an ill-conditioned
    matrix indefinite. Raises Refusal if the information is not finite or not positive definite.
    """
    try:
        if not np.all(np.isfinite(information)):
            raise np.linalg.LinAlgError
        reversed_factor = np.linalg.cholesky(0.5 * (information + information.T)[::-1, ::-1])
    except np.linalg.LinAlgError:
        raise Refusal("the posterior's information matrix is not positive definite at its mode") from None
    return scipy.linalg.solve_triangular(reversed_factor[::-1, ::-1], np.eye(len(information)), trans=1)


def restore_mode(target: Target, stored: StoredMode) -> Mode:
    """Rebuild the mode of a model with exact laws from its stored values; nothing is searched or computed again.

    target: the same model, record and priors as when the mode was stored.
    """
    likelihood = Likelihood.near(target, stored.z, stored.tolerance)
    return Mode(stored.z, stored.log_posterior, stored.information, likelihood, stored.searches)


def log_evidence_about(mode: Mode) -> float:
    """Return the log evidence of a model in nats, computed from the mode of its posterior.

    If the mode contains a linear model (`mode.linear`), it is the log evidence of that model. Otherwise it is Laplace's
    approximation: the log likelihood is expanded to second order at the mode, and integrated over scores that are ≥ 0
    where priors are half-normal. The evidence is averaged over the possible values of the common prior scale of damping
    coefficients.
    """
    if mode.linear is not None:
        return mode.linear.log_evidence
    target, scales = mode.likelihood.target, np.asarray(mode.likelihood.scales)
    at = np.where(target.reflected, np.abs(mode.z), mode.z)
    value, gradient, information = mode.likelihood.with_scale(1.0).curvature(at)
    extra = np.outer(scales**-2.0 - 1.0, target.shared)  # change of the prior's precision, (scales, d)
    log_density = value - 0.5 * extra @ at**2 - np.sum(target.shared) * np.log(scales)
    precision = information + extra[:, :, None] * np.eye(at.size)
    logs = log_integral(log_density, gradient - extra * at, precision, at, np.flatnonzero(target.reflected))
    return float(scipy.special.logsumexp(logs) - np.log(scales.size))


def log_integral(
    value: np.ndarray, gradient: np.ndarray, information: np.ndarray, at: np.ndarray, reflected: np.ndarray
) -> np.ndarray:
    """Return the log integrals, (c,), of c densities with quadratic logarithms over values ≥ 0 of the reflected scores.

    The integral is 2ʳ ∫ exp(value + g·(z − at) − (z − at)ᵀ H (z − at)/2) dz. Reflected scores are those of the r
    parameters with half-normal priors; the other scores have no bounds. The factor 2ʳ is there because a half-normal
    density is twice the normal one.

    Parameters
    ----------
    value : ndarray, shape (c,)
        Log densities at the point `at`.
    gradient, information : ndarray, shapes (c, d) and (c, d, d)
        The gradient g and the information H (minus the Hessian) of the log density at the point `at`.
    at : ndarray, shape (d,)
        Point of expansion.
    reflected : ndarray of int, shape (r,)
        Indices of the reflected scores.

    Returns
    -------
    ndarray, shape (c,)
        The logs in nats.
    """
    covariance = np.linalg.inv(information)
    step = np.einsum("cij,cj->ci", covariance, gradient)
    whole = value + 0.5 * np.sum(gradient * step, axis=1) - 0.5 * np.linalg.slogdet(information)[1]
    inside = log_probability((at + step)[:, reflected], covariance[:, reflected[:, None], reflected])
    return whole + 0.5 * at.size * np.log(2 * np.pi) + inside + reflected.size * np.log(2.0)


def value_sds(target: Target, z: np.ndarray, covariance: np.ndarray) -> dict[str, float]:
    """Return the standard deviations of the inferred parameters in their units, by name.

    They follow from the covariance, (d, d), of the standard normal scores of the parameters by error propagation to
    first order at z, the mean of the scores, (d,).
    """
    sds = np.abs(target.rates(z)) * np.sqrt(np.diag(covariance))
    return dict(zip(target.names, sds.tolist(), strict=True))


def value_intervals(target: Target, z: np.ndarray, sd: np.ndarray) -> dict[str, tuple[float, float]]:
    """Return the ends of the 95 % interval of each parameter in its unit, by name.

    The scores (parameters transformed so that their priors are standard normal) are assumed normal with mean z, (d,),
    and standard deviations sd, (d,); the ends are the parameters at z ± 1.96 sd. Intervals of parameters with
    half-normal priors do not go below zero.
    """
    low, high = z - NORMAL_95 * sd, z + NORMAL_95 * sd
    low = np.where(target.reflected, np.maximum(low, 0.0), low)
    ends = target.values(low), target.values(high)
    return {n: (float(ends[0][n]), float(ends[1][n])) for n in target.names}


SAME_MODE = 1.0
"""Two searches have reached the same maximum if the distance between their ends is less than this, in posterior
standard deviations (conventional)."""
SEARCH_ERROR, MODE_ERROR = 1.0, 0.03
"""Largest error of the computed motion: `SEARCH_ERROR` in the searches for a mode, `MODE_ERROR` at the mode and in all
later computations. The unit is the noise's standard deviation divided by √n for a record of n samples. Within three
posterior standard deviations of the mode, the second value changes the log likelihood by less than 0.01 nats (measured
on 20 simulated records)."""
MOST_RESIDUAL = 1.5
"""A local maximum of the posterior is rejected if its root mean square residual is more than this many standard
deviations of the record. There the noise model, and not the motion, explains the oscillation. For comparison: a motion
with the right amplitude but an unrelated phase gives √2."""


def group_searches(mode: Mode) -> list[tuple[np.ndarray, float]]:
    """Return the different maxima of the posterior that the searches of a mode reached, and their probabilities.

    Returns
    -------
    list of (ndarray, float)
        For each maximum: its standard normal scores, (d,), and its fraction of the total posterior probability of the
        maxima, by Laplace's approximation. The mode itself is first, the others follow, the highest first. Searches
        that have not converged are left out.
    """
    maxima = [mode.z]
    log_masses = [mode.log_posterior + _log_volume(mode.information)]
    for search in sorted(mode.searches, key=lambda search: -search.end):
        away = [search.z - z for z in maxima]
        if search.converged and all(x @ mode.information @ x >= SAME_MODE**2 for x in away):
            maxima.append(search.z)
            log_masses.append(search.end + search.volume)
    masses = np.exp(np.array(log_masses) - max(log_masses))
    return list(zip(maxima, (masses / masses.sum()).tolist(), strict=True))


def find_mode(target: Target, starts: Iterable[Mapping[str, float]], *, noise_level: float) -> Mode:
    """Search for modes of the posterior from each start, and return the highest.

    Maxima whose residual is above `MOST_RESIDUAL` are rejected. Ends of searches that have not converged count too.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    starts : iterable of mapping of str to float
        For each search, the values of the parameters at its start, by name; a missing one starts near the middle of its
        prior. Parameters of the noise are estimated from the residuals at the start instead.
    noise_level : float
        Standard deviation of the record's noise, in its unit. It only determines how accurately motions are computed,
        in the search and at the mode.

    Returns
    -------
    Mode
        The highest mode, searched again with accurate motions (`MODE_ERROR`), with the results of all searches.

    Raises
    ------
    Refusal
        If no start leads to a finite posterior; if at all maxima the noise model, and not the motion, explains the
        oscillation; or if at the highest maximum the information is not positive definite.
    """
    noise, unit = target.noise_model, noise_level / np.sqrt(target.signal.t.size)
    largest = MOST_RESIDUAL * float(np.std(target.signal.y))
    searches: list[LocalSearch] = []
    ends: list[LocalSearch] = []
    for start in starts:
        z = target.scores(start)
        likelihood = Likelihood.near(target, z, SEARCH_ERROR * unit)
        residual = likelihood.residual(z)
        if np.all(np.isfinite(residual)):
            estimate = target.scores(noise.start(residual, np.diff(target.signal.t)))
            z = np.where([name in noise.parameters for name in target.names], estimate, z)
        top = maximise_posterior(likelihood, z, retract=target.follow_step)
        is_motion = np.sqrt(np.mean(likelihood.residual(top.x) ** 2)) <= largest
        volume = _log_volume(top.information)
        searches.append(LocalSearch(z, top.x, top.value, volume, top.converged and bool(is_motion)))
        if is_motion and np.isfinite(top.value):
            ends.append(searches[-1])
    if not ends and any(np.isfinite(search.end) for search in searches):
        raise Refusal(
            Status.PRUNED.because(
                "the noise model, not the motion, explains the oscillation: the most probable motion is farther "
                "from the record than the record's mean"
            )
        )
    if not ends:
        raise Refusal("no start of the search leads to a motion with a finite likelihood")
    highest = max(ends, key=lambda search: search.end)
    likelihood = Likelihood.near(target, highest.z, MODE_ERROR * unit)
    top = maximise_posterior(likelihood, highest.z)
    if not np.isfinite(top.value):
        raise Refusal("the posterior is not finite at its mode")
    mode = Mode(top.x, top.value, top.information, likelihood, tuple(searches))
    mode.sd()  # raises Refusal if the information is not positive definite
    return mode


def _log_volume(information: np.ndarray) -> float:
    """Return −½ log det of an information matrix, (d, d); −∞ if its determinant is not positive."""
    sign, log_determinant = np.linalg.slogdet(information)
    return -0.5 * float(log_determinant) if sign > 0 else -np.inf
