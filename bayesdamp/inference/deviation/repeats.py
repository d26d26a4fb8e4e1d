"""Infer one damping from several records of one specimen.

A record's coefficients are those of the specimen times a factor exp η, η ~ N(0, s²). The spread s between records is
inferred. Own parameters of a damping term, such as an exponent, are the same in all records. Initial state, spring,
offset, noise and deviations from the laws differ between records. They are already integrated out: each record only
contributes the likelihood of its damping parameters. The hyperparameters of the deviations (their sizes and correlation
lengths) are common to all records, because they belong to the damper. A grid point is one combination of them.

At a given s and grid point, the coefficients and the factors exp η are integrated out by Laplace's approximation about
the mode, which is exact for s = 0. Afterwards the evidence allows for coefficients ≥ 0 and for the unknown common scale
of their priors, as for one record (`linear.with_priors`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.linear import DampingLikelihood, Normals, with_priors
from bayesdamp.priors import Prior, SharedHalfNormal

SPREAD_SCALE = 0.1
"""Scale of the half-normal prior of the spread s, the sd of the log coefficients between records (conventional)."""
SPREADS = np.geomspace(5e-4, 0.45, 27)
"""Grid of values of the spread s, the sd of the log coefficients between records. The prior probability of s beyond the
last value is below 1e-5. With half as many values the upper end of a wide interval of s was a tenth to a fifth too
large (measured)."""
SPREAD_EDGES = np.concatenate([[0.0], np.sqrt(SPREADS[1:] * SPREADS[:-1]), [np.inf]])
"""Boundaries of the cells around the grid values `SPREADS` of the spread between records (sd of log coefficients): 0,
the geometric means of neighbouring values, and ∞."""
JOINT_DRAWS = 4000
"""Number of draws from the joint posterior of a specimen's damping, given all its records (conventional)."""
NO_SPREAD = 1e-9
"""Spread s (sd of the log coefficients between records) that is used for a single record, which does not determine s.
It is practically 0; it is not 0 because the computation divides by s."""
MOST_STEPS, SETTLED_GAIN = 60, 1e-7
"""Limits of the Gauss–Newton search for the joint mode of the specimen's parameters and the records' factors.
`MOST_STEPS`: largest number of steps, rejected ones included. `SETTLED_GAIN`: the search ends if the next step is
predicted to increase the log posterior by less than this, in nats, at every pair of grid point and spread."""
NATS_BEHIND = 18.0
"""A grid point (a combination of sizes and correlation lengths of the deviations from the laws) is left out if its log
evidence is at least this many nats below the best. This must be so at the smallest and at the largest spread between
records."""


@dataclass(frozen=True)
class RecordLikelihood:
    """The likelihood of one record as a function of the k parameters of its damping, for `join_runs`.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    coefficients : ndarray of bool, shape (k,)
        Which of them are coefficients of damping terms; the others are own parameters of a term, such as an exponent.
    mode : ndarray, shape (k,)
        Values of the parameters at the posterior mode of this record alone, in their units.
    likelihood : DampingLikelihood
        The likelihood of the parameters, in their units, at each grid point (combination of sizes and correlation
        lengths of the deviations from the laws).
    """

    names: tuple[str, ...]
    coefficients: np.ndarray
    mode: np.ndarray
    likelihood: DampingLikelihood

    @staticmethod
    def of_scores(
        priors: Mapping[str, Prior], coefficients: Sequence[str], z: np.ndarray, likelihood: DampingLikelihood
    ) -> RecordLikelihood:
        """Convert the likelihood of standard normal scores to the likelihood of the parameters in their units.

        A score stands for a parameter and has the prior N(0, 1).

        Parameters
        ----------
        priors : mapping of str to Prior
            Priors of the k damping parameters, in the order of the scores; they define the maps from scores to
            parameters.
        coefficients : sequence of str
            Names of the parameters that are coefficients.
        z : ndarray, shape (k,)
            Scores at the posterior mode, about which the maps are linearised (for half-normal priors they are linear).
        likelihood : DampingLikelihood
            The likelihood of the scores.
        """
        values, slopes = _linear_maps(priors, z)
        changed = likelihood.transform(z - values / slopes, np.diag(1.0 / slopes))
        which = np.array([n in coefficients for n in priors], bool)
        return RecordLikelihood(tuple(priors), which, values, changed)

    def plus_nats(self, nats: float) -> Self:
        """Return a copy with a constant, in nats, added to the log likelihood at all grid points."""
        return replace(self, likelihood=replace(self.likelihood, log=self.likelihood.log + nats))


@dataclass(frozen=True)
class Repeats:
    """The joint posterior of one damping from several records of one specimen.

    Attributes
    ----------
    log_evidence : float
        Log evidence of all records together, in nats; constants in their log likelihoods are included.
    names : tuple of str
        Names of the k parameters of the damping.
    draws : ndarray, shape (n, k)
        Draws of the specimen's parameters, in their units and in the order of `names`.
    spreads : ndarray, shape (n,)
        For each draw, the spread between records: the sd of the log coefficients.
    """

    log_evidence: float
    names: tuple[str, ...]
    draws: np.ndarray
    spreads: np.ndarray


def join_runs(
    runs: Sequence[RecordLikelihood], priors: Mapping[str, Prior], log_sizes: np.ndarray, *, seed: int = 0
) -> Repeats:
    """Compute the evidence and the joint posterior of one sum of damping terms from several records of one specimen.

    In each record all coefficients of the specimen are multiplied by one factor; other parameters, such as an exponent,
    are the same in all records. The spread of the log factors between records is inferred; with a single record, which
    does not determine it, the spread is `NO_SPREAD`.

    Parameters
    ----------
    runs : sequence of RecordLikelihood
        Likelihoods of one or more records with the same parameters.
    priors : mapping of str to Prior
        Priors of the specimen's parameters, in the order of the likelihoods' names.
    log_sizes : ndarray, shape (c,)
        Log prior probabilities of the first c grid points (sizes and correlation lengths of the deviations from the
        laws); the other grid points of the likelihoods are not used. The first grid point has no deviations, so that
        `zeros(1)` assumes exact laws.
    seed : int
        Seed of the random stream.

    Returns
    -------
    Repeats
        The log evidence, and `JOINT_DRAWS` draws of the parameters and of the spread.

    Raises
    ------
    ValueError
        If there is no record, or if records and priors have different parameters.
    """
    if not runs or any(r.names != runs[0].names for r in runs) or tuple(priors) != runs[0].names:
        raise ValueError(
            "join_runs: no run is given, or parameters differ; give at least one run, and runs and priors with the "
            "same names of parameters in the same order"
        )
    about = _scores(priors, np.mean([r.mode for r in runs], axis=0))
    values, slopes = _linear_maps(priors, about)
    spreads, masses = np.array([NO_SPREAD]), np.ones(1)
    if len(runs) > 1:
        spreads, masses = SPREADS, np.diff(scipy.special.erf(SPREAD_EDGES / (SPREAD_SCALE * np.sqrt(2.0))))
    log, slope, information = (
        np.stack([getattr(r.likelihood, part)[: log_sizes.size] for r in runs])
        for part in ("log", "slope", "information")
    )
    problem = _Problem(log, slope, information, values - slopes * about, slopes, runs[0].coefficients)
    probable = every = np.arange(log_sizes.size)
    if every.size > 1:  # keep grid points that are probable at the smallest or the largest spread
        ends = (problem.integrate_factors(every, np.full(every.size, s)) for s in {spreads[0], spreads[-1]})
        logs = np.stack([end.log + log_sizes for end in ends])
        probable = np.flatnonzero((logs.max(axis=1, keepdims=True) - logs).min(axis=0) < NATS_BEHIND)
    combo, at = (a.ravel() for a in np.meshgrid(probable, np.arange(spreads.size), indexing="ij"))
    normals = problem.integrate_factors(combo, spreads[at])
    normals = replace(normals, log=normals.log + log_sizes[combo] + np.log(masses[at]))
    positive = np.array([p.reflected for p in priors.values()], bool)
    shared = np.array([isinstance(p, SharedHalfNormal) for p in priors.values()], bool)
    posterior = with_priors(normals, positive, shared)
    z, places = posterior.draws(JOINT_DRAWS, np.random.default_rng(seed))
    rows = posterior.combos[places]
    natural = np.column_stack([p.value(z[:, i]) for i, p in enumerate(priors.values())])
    drawn = spreads[at[rows]]
    if spreads.size > 1:  # draw uniformly in the cell of each spread
        low, high = SPREAD_EDGES[at[rows]], SPREAD_EDGES[at[rows] + 1]
        high = np.minimum(high, SPREADS[-1] ** 1.5 / SPREADS[-2] ** 0.5)
        drawn = low + (high - low) * np.random.default_rng([seed, 1]).random(rows.size)
    return Repeats(posterior.log_evidence, runs[0].names, natural, drawn)


@dataclass(frozen=True)
class _Problem:
    """The likelihoods of n records at c grid points, as functions of the k damping parameters x = offset + scale z.

    A grid point is a combination of sizes and correlation lengths of the deviations from the laws. z, (k,), are the
    standard normal scores of the parameters; `offset` and `scale`, (k,) each, are the linear map from scores to
    parameters that the priors define. log (n, c), slope (n, c, k) and information (n, c, k, k) are those of each
    record's `DampingLikelihood` as a function of x. which: booleans, (k,), that mark the coefficients, which are
    multiplied by a factor exp η in each record.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    which: np.ndarray

    def integrate_factors(self, combos: np.ndarray, spreads: np.ndarray) -> Normals:
        """Integrate out the records' factors exp η by Laplace's approximation, at b grid points and spreads.

        A record's coefficients are those of the specimen times exp η. A grid point is a combination of sizes and
        correlation lengths of the deviations from the laws; a spread is the standard deviation s of η. combos, spreads:
        b pairs of the index of a grid point and a value of s, (b,) each. The result contains for each pair the log
        evidence, (b,), and the means, (b, k), and Cholesky factors of the covariance, (b, k, k), of the scores z. The
        scores have priors N(0, 1) here, and may be negative. Prior probabilities of grid points and spreads are not
        included.
        """
        k, n = self.scale.size, self.log.shape[0]
        b, big = np.moveaxis(self.slope[:, combos], 0, 1), np.moveaxis(self.information[:, combos], 0, 1)
        precision = np.repeat([np.ones(combos.size), spreads**-2.0], [k, n], axis=0).T
        u, share = np.zeros((combos.size, k + n)), np.ones(combos.size)
        u[:, :k] = solve(
            np.eye(k) + np.sum(self.scale[:, None] * big * self.scale, axis=1),
            np.sum(self.scale * (b - big @ self.offset), axis=1),
        )
        value = self._value(u, b, big, precision)
        for _ in range(MOST_STEPS):
            slope, square = self._derivatives(u, b, big, precision)
            step = solve(square, slope)
            if np.sum(step * slope, axis=1).max() < SETTLED_GAIN:
                break
            new = u + share[:, None] * step
            changed = self._value(new, b, big, precision)
            better = changed >= value - 1e-9
            u[better], value[better] = new[better], changed[better]
            share = np.where(better, 1.0, 0.4 * share)
        log_det, covariance = _invert(self._derivatives(u, b, big, precision, whole=True)[1])
        bad = ~np.isfinite(log_det)
        if bad.any():  # the Hessian is not positive definite: use its Gauss–Newton approximation
            part = [a[bad] for a in (u, b, big, precision)]
            log_det[bad], covariance[bad] = _invert(self._derivatives(*part, whole=False)[1])
        log = value + self.log[:, combos].sum(axis=0) - 0.5 * log_det - n * np.log(spreads)
        return Normals(log, u[:, :k], np.linalg.cholesky(covariance[:, :k, :k]))

    def _value(self, u: np.ndarray, b: np.ndarray, big: np.ndarray, precision: np.ndarray) -> np.ndarray:
        """Return the log posterior density, (b,), up to a constant, at b points u, (b, k + n).

        u contains the k standard normal scores of the specimen's parameters, then the log factors η of the n records,
        whose coefficients are those of the specimen times exp η. b, big: slopes (b, n, k) and information (b, n, k, k)
        of the records' log likelihoods at each point's combination of hyperparameters. precision: inverse prior
        variances of u, (b, k + n): 1 for scores, 1/s² for log factors with the spread s.
        """
        y = self._record_parameters(u)[0]
        fit = np.sum((b - 0.5 * (big @ y[..., None])[..., 0]) * y, axis=(1, 2))
        return fit - 0.5 * np.sum(precision * u**2, axis=1)

    def _record_parameters(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the damping parameters in each record, and the factors exp η that they contain, (b, n, k) each.

        u: at b points, the standard normal scores of the specimen's k parameters, then the log factors η of the n
        records, (b, k + n); η is limited to ±5. Only coefficients are multiplied by exp η; for other parameters the
        factor is 1.
        """
        k = self.scale.size
        grown = np.exp(np.clip(u[:, k:], -5.0, 5.0))
        factors = np.where(self.which, grown[:, :, None], 1.0)
        return (self.offset + self.scale * u[:, :k])[:, None, :] * factors, factors

    def _derivatives(
        self, u: np.ndarray, b: np.ndarray, big: np.ndarray, precision: np.ndarray, whole: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the gradient by u of the log posterior `_value`, and its negative Hessian.

        Their shapes are (b, k + n) and (b, k + n, k + n). u, b, big, precision: as in `_value`. whole: True for the
        full Hessian, False for its Gauss–Newton approximation.
        """
        k, own = self.scale.size, np.arange(self.scale.size, u.shape[1])
        y, factors = self._record_parameters(u)
        pull = b - (big @ y[..., None])[..., 0]
        by_z, by_factor = factors * self.scale, np.where(self.which, y, 0.0)
        along_factors = np.sum(by_factor * pull, axis=2)
        slope = np.concatenate([np.sum(by_z * pull, axis=1), along_factors], axis=1) - precision * u
        pushed = (big @ by_factor[..., None])[..., 0]
        square = precision[:, :, None] * np.eye(u.shape[1])
        square[:, :k, :k] += np.sum(by_z[..., None] * big * by_z[:, :, None], axis=1)
        square[:, k:, :k] = by_z * pushed
        square[:, own, own] += np.sum(by_factor * pushed, axis=2)
        if whole:
            square[:, k:, :k] -= np.where(self.which, by_z * pull, 0.0)
            square[:, own, own] -= along_factors
        square[:, :k, k:] = np.swapaxes(square[:, k:, :k], 1, 2)
        return slope, square


def _to_unit_diagonal(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return b symmetric matrices scaled to a diagonal of 1, (b, m, m), and the roots of their diagonals, (b, m).

    Diagonal elements below 1e-300 count as 1e-300, and are then not scaled to 1.
    """
    root = np.sqrt(np.maximum(np.diagonal(square, axis1=1, axis2=2), 1e-300))
    return square / (root[:, :, None] * root[:, None, :]), root


def solve(square: np.ndarray, aim: np.ndarray) -> np.ndarray:
    """Solve b linear systems square x = aim for x, (b, m), with matrices scaled to a unit diagonal.

    To the scaled diagonal 1e-13 is added, so that a singular matrix also has a solution. square: symmetric matrices,
    (b, m, m). aim: right-hand sides, (b, m).
    """
    part, root = _to_unit_diagonal(square)
    part = part + 1e-13 * np.eye(part.shape[1])
    return np.linalg.solve(part, (aim / root)[:, :, None])[:, :, 0] / root


def _invert(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the log determinants, (b,), and the inverses, (b, m, m), of symmetric matrices, (b, m, m).

    The log determinant is NaN for a matrix that is not positive definite; its inverse is then not valid.
    """
    part, root = _to_unit_diagonal(square)
    values, vectors = np.linalg.eigh(part)
    good = values[:, 0] > 0
    safe = np.where(good[:, None], values, 1.0)
    log_det = np.where(good, np.sum(np.log(safe), axis=1) + 2 * np.sum(np.log(root), axis=1), np.nan)
    inverse = (vectors / safe[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return log_det, inverse / (root[:, :, None] * root[:, None, :])


def _scores(priors: Mapping[str, Prior], values: np.ndarray) -> np.ndarray:
    """Return parameter values, (k,), as standard normal scores, (k,); the values are in the order of `priors`.

    A score stands for a parameter and has the prior N(0, 1). An infinite score, such as that of 0 under a log-normal
    prior, becomes ±6, and nan becomes 0.
    """
    scores = np.array([float(p.score(v)) for p, v in zip(priors.values(), values, strict=True)])
    return np.clip(np.nan_to_num(scores, posinf=6.0, neginf=-6.0), -1e9, 1e9)


def _linear_maps(priors: Mapping[str, Prior], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the k parameters at scores z, (k,), and their derivatives by the scores, (k,).

    A score stands for a parameter and has the prior N(0, 1). A parameter with a half-normal prior is proportional to
    its score, also for negative scores.
    """
    each = list(zip(priors.values(), z.tolist(), strict=True))
    slopes = np.array([float(prior.rate(1.0 if prior.reflected else score)) for prior, score in each])
    values = [float(prior.value(np.asarray(score))) for prior, score in each]
    return np.where([prior.reflected for prior, _ in each], slopes * z, values), slopes
