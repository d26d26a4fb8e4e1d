"""Several records of one specimen: one set of damping coefficients, times a factor for each run.

A run's coefficients are those of the specimen times exp η, η ~ N(0, s²) with a spread s that is inferred; the other
parameters of a term (an exponent) are the same in all runs. Everything else (start, spring, offset, noise, deviations
along the record) belongs to the run and is already integrated out: only the likelihood of the damping is needed of each
run. The sizes and lengths of the deviations from the laws are those of the damper, and so common to all runs.

Given a spread and a combination of these sizes, log prior plus log likelihoods have one maximum over the coefficients
and the factors; they are integrated over by Laplace's method about it, which is exact where the spread goes to zero.
Coefficients are then cut off at zero, and their unknown prior scale is summed over, as for one record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.special import erf

from bayesdamp.inference.deviation.linear import DampingLikelihood, Normals, with_priors
from bayesdamp.priors import Prior, SharedHalfNormal

SPREAD = 0.1
"""Scale of the half-normal prior of the spread between runs, the sd of the logarithm of a run's factor."""
SPREADS = np.geomspace(5e-4, 0.45, 27)
"""Spreads that are summed over; the prior beyond the last is below 1e-5. With half as many the upper end of a wide
spread was a tenth to a fifth too large."""
EDGES = np.concatenate([[0.0], np.sqrt(SPREADS[1:] * SPREADS[:-1]), [np.inf]])
"""Of the cells that the spreads stand for: middles, in the logarithm, of neighbours."""
DRAWS = 4000
STEPS, SETTLED = 60, 1e-7
"""Gauss–Newton steps at most, and the gain in nats that the last one may promise."""
BEHIND = 18.0
"""Nats behind the best, at the ends of the spreads, beyond which a combination of deviations' sizes is left out."""
DERIVATIVE = 1e-5
"""Scores over which the slope of a prior's map is taken."""


@dataclass(frozen=True)
class RunLikelihood:
    """The likelihood of one run as a function of the damping alone, in natural units.

    Attributes
    ----------
    names : tuple of str
        The damping's parameters.
    coefficients : ndarray of bool, shape (k,)
        Which of them are coefficients.
    mode : ndarray, shape (k,)
        Their values at the run's own best motion.
    likelihood : DampingLikelihood
        Of the parameters, under each combination of the deviations' sizes.
    """

    names: tuple[str, ...]
    coefficients: np.ndarray
    mode: np.ndarray
    likelihood: DampingLikelihood

    @staticmethod
    def of_scores(
        priors: Mapping[str, Prior], coefficients: Sequence[str], z: np.ndarray, likelihood: DampingLikelihood
    ) -> RunLikelihood:
        """Turn the likelihood of scores into one of parameters.

        Parameters
        ----------
        priors : mapping of str to Prior
            Of the damping's parameters, in the order of the scores.
        coefficients : sequence of str
            Names of those that are coefficients.
        z : ndarray, shape (k,)
            Scores at the best motion, where the maps from scores to parameters are linearised; those of half-normal
            priors are linear.
        likelihood : DampingLikelihood
            As a function of the scores.
        """
        values, slopes = _maps(priors, z)
        changed = likelihood.mapped(z - values / slopes, np.diag(1.0 / slopes))
        which = np.array([n in coefficients for n in priors], bool)
        return RunLikelihood(tuple(priors), which, values, changed)

    def shifted(self, nats: float) -> Self:
        """Return it with a number of nats added, whatever the damping."""
        return replace(self, likelihood=replace(self.likelihood, log=self.likelihood.log + nats))


@dataclass(frozen=True)
class Repeats:
    """The posterior of one damping from several runs.

    Attributes
    ----------
    log_evidence : float
        In nats.
    names : tuple of str
        The damping's parameters.
    draws : ndarray, shape (n, k)
        Of the specimen's parameters, in natural units.
    spreads : ndarray, shape (n,)
        Of the logarithm of a run's factor, with each draw.
    combos : ndarray of int, shape (n,)
        Combination of the deviations' sizes, with each draw.
    """

    log_evidence: float
    names: tuple[str, ...]
    draws: np.ndarray
    spreads: np.ndarray
    combos: np.ndarray


def joined(
    runs: Sequence[RunLikelihood],
    priors: Mapping[str, Prior],
    log_sizes: np.ndarray,
    *,
    spread: float | None = None,
    seed: int = 0,
    draws: int = DRAWS,
) -> Repeats:
    """Compute the evidence and the posterior of one damping for all runs.

    Parameters
    ----------
    runs : sequence of RunLikelihood
        One or more, of the same parameters.
    priors : mapping of str to Prior
        Of the damping's parameters for the specimen, in the order of the runs' names.
    log_sizes : ndarray, shape (c,)
        Log prior probability of each combination of the deviations' sizes.
    spread : float, optional
        Of the runs' factors where it is known; 0: all runs have the same coefficients.
    seed, draws : int
        Seed of the random stream, and number of draws.

    Raises
    ------
    ValueError
        Where there is no run, or runs have other parameters.
    """
    if not runs or any(r.names != runs[0].names for r in runs) or tuple(priors) != runs[0].names:
        raise ValueError("joined runs need the same parameters, and a prior of each")
    values, slopes = _maps(priors, _scores(priors, np.mean([r.mode for r in runs], axis=0)))
    offset = values - slopes * _scores(priors, values)
    if spread is not None or len(runs) == 1:
        # One run determines only the product of the factor and the coefficients: its spread is the prior's.
        spreads, masses = np.array([spread or 0.0]), np.ones(1)
    else:
        spreads, masses = SPREADS, np.diff(erf(EDGES / (SPREAD * np.sqrt(2.0))))
    log, slope, information = (
        np.stack([getattr(r.likelihood, part) for r in runs]) for part in ("log", "slope", "information")
    )
    problem = _Problem(log, slope, information, offset, slopes, runs[0].coefficients)
    probable = every = np.arange(log_sizes.size)
    if every.size > 1:  # the combinations of sizes that count at the least or the largest spread
        ends = {spreads[0], spreads[-1]}
        logs = np.stack([problem.integrated(every, np.full(every.size, s)).log + log_sizes for s in ends])
        probable = np.flatnonzero((logs.max(axis=1, keepdims=True) - logs).min(axis=0) < BEHIND)
    combo, at = (a.ravel() for a in np.meshgrid(probable, np.arange(spreads.size), indexing="ij"))
    normals = problem.integrated(combo, spreads[at])
    normals = replace(normals, log=normals.log + log_sizes[combo] + np.log(masses[at]))
    positive = np.array([p.reflected for p in priors.values()], bool)
    shared = np.array([isinstance(p, SharedHalfNormal) for p in priors.values()], bool)
    posterior = with_priors(normals, positive, shared)
    z, places = posterior.draws(positive, draws, np.random.default_rng(seed))
    rows = posterior.combos[places]
    natural = np.column_stack([p.value(z[:, i]) for i, p in enumerate(priors.values())])
    drawn = spreads[at[rows]]
    if spreads.size > 1:  # anywhere in the cells that these stand for
        low, high = EDGES[at[rows]], EDGES[at[rows] + 1]
        high = np.minimum(high, SPREADS[-1] ** 1.5 / SPREADS[-2] ** 0.5)
        drawn = low + (high - low) * np.random.default_rng([seed, 1]).random(rows.size)
    return Repeats(posterior.log_evidence, runs[0].names, natural, drawn, combo[rows])


@dataclass(frozen=True)
class _Problem:
    """Likelihoods of n runs under c combinations.

    log (n, c), slope (n, c, k), information (n, c, k, k), in natural units x = offset + scale z, both (k,); which:
    coefficients, which a run's factor multiplies, (k,).
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    which: np.ndarray

    def integrated(self, combos: np.ndarray, spreads: np.ndarray) -> Normals:
        """Integrate over the runs' factors at combinations (b,) with spreads (b,).

        Log evidence (b,), means (b, k) and factors of the covariances (b, k, k) of the scores z, whose priors are
        N(0, 1) of either sign.
        """
        k, n = self.scale.size, self.log.shape[0]
        b, big = np.moveaxis(self.slope[:, combos], 0, 1), np.moveaxis(self.information[:, combos], 0, 1)
        whole = np.eye(k) + np.sum(self.scale[:, None] * big * self.scale, axis=1)
        pull = np.sum(self.scale * (b - big @ self.offset), axis=1)
        u = np.zeros((combos.size, k + n))
        u[:, :k] = _solve(whole, pull)
        precision = 1.0 / np.maximum(spreads, 1e-12) ** 2
        moving = spreads > 0
        value = self._value(u, b, big, precision)
        for _ in range(STEPS if moving.any() else 0):
            slope, square = self._derivatives(u, b, big, precision, moving, whole=False)
            step = _solve(square, slope)
            promised = np.sum(step * slope, axis=1)
            if promised.max() < SETTLED:
                break
            share, new = np.ones(combos.size), value
            for _ in range(12):
                new = self._value(u + share[:, None] * step, b, big, precision)
                worse = ~(new >= value - 1e-9)
                if not worse.any():
                    break
                share[worse] *= 0.4
            better = new >= value - 1e-9
            u[better] += (share[:, None] * step)[better]
            value = np.where(better, new, value)
        square = self._derivatives(u, b, big, precision, moving, whole=True)[1]
        log_det, covariance = _invert(square)
        bad = ~np.isfinite(log_det)
        if bad.any():  # far from a maximum that is round: the information without its second part is positive
            part = [a[bad] for a in (u, b, big, precision, moving)]
            log_det[bad], covariance[bad] = _invert(self._derivatives(*part, whole=False)[1])
        log = value + self.log[:, combos].sum(axis=0) - 0.5 * log_det
        log = log - np.where(moving, n * np.log(np.maximum(spreads, 1e-12)), 0.0)
        return Normals(log, u[:, :k], np.linalg.cholesky(covariance[:, :k, :k]))

    def _value(self, u: np.ndarray, b: np.ndarray, big: np.ndarray, precision: np.ndarray) -> np.ndarray:
        """Return log prior plus log likelihoods, without their constants, (b,)."""
        k, y = self.scale.size, self._run_parameters(u)[0]
        fit = np.sum(b * y, axis=(1, 2)) - 0.5 * np.einsum("bni,bnij,bnj->b", y, big, y)
        return fit - 0.5 * np.sum(u[:, :k] ** 2, axis=1) - 0.5 * precision * np.sum(u[:, k:] ** 2, axis=1)

    def _run_parameters(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return each run's parameters, and their factors, (b, n, k) each."""
        k = self.scale.size
        grown = np.exp(np.clip(u[:, k:], -5.0, 5.0))
        factors = np.where(self.which, grown[:, :, None], 1.0)
        return (self.offset + self.scale * u[:, :k])[:, None, :] * factors, factors

    def _derivatives(
        self,
        u: np.ndarray,
        b: np.ndarray,
        big: np.ndarray,
        precision: np.ndarray,
        moving: np.ndarray,
        whole: bool,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the slope of `_value`, (b, k + n), and minus its second derivatives, (b, k + n, k + n).

        Without the curvature of the parameters themselves where not `whole`. Factors do not move where their spread
        is 0.
        """
        k, n = self.scale.size, self.log.shape[0]
        y, factors = self._run_parameters(u)
        pull = b - np.einsum("bnij,bnj->bni", big, y)
        by_z = factors * self.scale  # (b, n, k)
        along = np.where(self.which, y, 0.0)  # of y by a run's log factor
        slope, square = np.zeros_like(u), np.zeros((len(u), k + n, k + n))
        slope[:, :k] = np.sum(by_z * pull, axis=1) - u[:, :k]
        by_factor = np.sum(along * pull, axis=2) - precision[:, None] * u[:, k:]
        slope[:, k:] = np.where(moving[:, None], by_factor, 0.0)
        square[:, :k, :k] = np.eye(k) + np.einsum("bni,bnij,bnj->bij", by_z, big, by_z)
        pushed = np.einsum("bnij,bnj->bni", big, along)
        cross = by_z * pushed
        own = np.sum(along * pushed, axis=2)
        if whole:
            cross = cross - np.where(self.which, by_z * pull, 0.0)
            own = own - np.sum(along * pull, axis=2)
        on = moving[:, None]
        cross = np.where(on[:, :, None], cross, 0.0)
        square[:, :k, k:], square[:, k:, :k] = np.swapaxes(cross, 1, 2), cross
        places = np.arange(k, k + n)
        square[:, places, places] = np.where(on, own + precision[:, None], 1.0)
        return slope, square


def _scaled(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scale matrices (b, m, m) to ones on their diagonals; return also the roots of the diagonals, (b, m)."""
    root = np.sqrt(np.maximum(np.diagonal(square, axis1=1, axis2=2), 1e-300))
    return square / (root[:, :, None] * root[:, None, :]), root


def _solve(square: np.ndarray, aim: np.ndarray) -> np.ndarray:
    part, root = _scaled(square)
    part = part + 1e-13 * np.eye(part.shape[1])
    return np.linalg.solve(part, (aim / root)[:, :, None])[:, :, 0] / root


def _invert(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return log determinants (b,) and inverses; not finite where a matrix is not positive."""
    part, root = _scaled(square)
    values, vectors = np.linalg.eigh(part)
    good = values[:, 0] > 0
    safe = np.where(good[:, None], values, 1.0)
    log_det = np.where(good, np.sum(np.log(safe), axis=1) + 2 * np.sum(np.log(root), axis=1), np.nan)
    inverse = (vectors / safe[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return log_det, inverse / (root[:, :, None] * root[:, None, :])


def _scores(priors: Mapping[str, Prior], values: np.ndarray) -> np.ndarray:
    scores = np.array([float(p.score(v)) for p, v in zip(priors.values(), values, strict=True)])
    return np.clip(np.nan_to_num(scores, posinf=6.0, neginf=-6.0), -1e9, 1e9)


def _maps(priors: Mapping[str, Prior], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values at scores z, (k,), and their slopes; straight lines on both sides of a fold at 0."""
    values, slopes = np.empty(z.size), np.empty(z.size)
    for i, (prior, score) in enumerate(zip(priors.values(), z, strict=True)):
        if prior.reflected:
            slopes[i] = float(prior.value(np.asarray(1.0)))
            values[i] = slopes[i] * score
            continue
        ends = prior.value(np.array([score - DERIVATIVE, score + DERIVATIVE]))
        values[i] = float(prior.value(np.asarray(score)))
        slopes[i] = float(np.diff(ends)[0]) / (2 * DERIVATIVE)
    return values, slopes
