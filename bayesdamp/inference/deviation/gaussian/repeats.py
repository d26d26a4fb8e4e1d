"""Several records of one specimen: one set of damping coefficients, times a factor for each run.

A run's coefficients are those of the specimen times exp η, η ~ N(0, s²) with a spread s that is inferred; parameters of
a term beside its coefficient (an exponent) are the same in all runs. Everything else (start, spring, offset, noise,
deviations along the record) belongs to the run and is integrated out already: of each run the likelihood of the damping
alone is needed. The sizes and lengths of the deviations from the laws are common to all runs, as they are the damper's.

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

from bayesdamp.inference.deviation.gaussian.linear import DampingLikelihood, Normals, with_priors
from bayesdamp.priors import Prior, SharedHalfNormal

SPREAD = 0.1
"""Scale of the half-normal prior of the spread between runs, the sd of the logarithm of a run's factor."""
SPREADS = np.geomspace(5e-4, 0.45, 27)
"""Spreads that are summed over; the prior beyond the last is below 1e-5. With half as many the upper end of a wide
spread was a tenth to a fifth too large."""
DRAWS = 4000
STEPS, SETTLED = 60, 1e-7
"""Gauss–Newton steps at most, and nats that the last one may promise."""
BEHIND = 18.0
"""Nats behind the best, at the ends of the spreads, from which a combination of deviations' sizes is left out."""
DERIVATIVE = 1e-5
"""Scores over which the slope of a prior's map is taken."""


@dataclass(frozen=True)
class RunLikelihood:
    """The likelihood of one run as a function of the damping alone, in natural units.

    names: of the damping's parameters; coefficients: which of them are coefficients, (k,); mode: their values at the
    run's own best motion, (k,); likelihood: of the parameters, under each combination of the deviations' sizes.
    """

    names: tuple[str, ...]
    coefficients: np.ndarray
    mode: np.ndarray
    likelihood: DampingLikelihood

    @staticmethod
    def of_scores(
        priors: Mapping[str, Prior], coefficients: Sequence[str], z: np.ndarray, found: DampingLikelihood
    ) -> RunLikelihood:
        """From the likelihood of scores.

        Parameters
        ----------
        priors
            Of the damping's parameters, in the order of the scores.
        coefficients
            Names of those that are coefficients.
        z
            Scores at the best motion, (k,), where the maps from scores to parameters are linearised; those of
            half-normal priors are linear.
        found
            As a function of the scores.
        """
        values, slopes = _maps(priors, z)
        changed = found.mapped(z - values / slopes, np.diag(1.0 / slopes))
        which = np.array([n in coefficients for n in priors], bool)
        return RunLikelihood(tuple(priors), which, values, changed)

    def shifted(self, nats: float) -> Self:
        """With so many nats more, whatever the damping."""
        return replace(self, likelihood=replace(self.likelihood, log=self.likelihood.log + nats))


@dataclass(frozen=True)
class Repeats:
    """What several runs say of one damping.

    log_evidence in nats; names: of the damping's parameters; draws: of the specimen's, (n, k), in natural units;
    spreads: of the logarithm of a run's factor, with each draw, (n,); combos: with each draw the combination of the
    deviations' sizes, (n,).
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
    """The evidence and the posterior of one damping for all runs.

    Parameters
    ----------
    runs
        One or more, of the same parameters.
    priors
        Of the damping's parameters for the specimen, in the order of the runs' names.
    log_sizes
        Log prior probability of each combination of the deviations' sizes, (c,).
    spread
        Of the runs' factors where it is known; 0: all runs have the same coefficients.

    Raises
    ------
    ValueError
        Where there is no run, or runs have other parameters.
    """
    if not runs or any(r.names != runs[0].names for r in runs) or tuple(priors) != runs[0].names:
        raise ValueError("joined runs need the same parameters, and a prior of each")
    values, slopes = _maps(priors, _scores(priors, np.mean([r.mode for r in runs], axis=0)))
    offset = values - slopes * _scores(priors, values)
    which, n = runs[0].coefficients, len(runs)
    if spread is not None or n == 1:
        # Of one run the factor and the coefficients are told together only: its spread is the prior's.
        spreads, masses = np.array([spread or 0.0]), np.ones(1)
    else:
        # Of the half-normal prior between the middles, in the logarithm, of neighbours.
        spreads, masses = SPREADS, np.diff(erf(_edges() / (SPREAD * np.sqrt(2.0))))
    logs = np.stack([r.likelihood.log for r in runs])
    slope = np.stack([r.likelihood.slope for r in runs])
    information = np.stack([r.likelihood.information for r in runs])
    problem = _Problem(logs, slope, information, offset, slopes, which)
    kept = _combos_kept(problem, log_sizes, spreads)
    combo, at = (a.ravel() for a in np.meshgrid(kept, np.arange(spreads.size), indexing="ij"))
    found = problem.integrated(combo, spreads[at])
    found = replace(found, log=found.log + log_sizes[combo] + np.log(masses[at]))
    positive = np.array([p.reflected for p in priors.values()], bool)
    shared = np.array([isinstance(p, SharedHalfNormal) for p in priors.values()], bool)
    weighed = with_priors(found, positive, shared)
    z, places = weighed.draws(positive, draws, np.random.default_rng(seed))
    of = weighed.combos[places]
    natural = np.column_stack([p.value(z[:, i]) for i, p in enumerate(priors.values())])
    drawn = spreads[at[of]]
    if spreads.size > 1:  # anywhere in the cells that these stand for
        low, high = (
            _edges()[at[of]],
            np.minimum(_edges()[at[of] + 1], SPREADS[-1] ** 1.5 / SPREADS[-2] ** 0.5),
        )
        drawn = low + (high - low) * np.random.default_rng([seed, 1]).random(of.size)
    return Repeats(weighed.log_evidence, runs[0].names, natural, drawn, combo[of])


def _edges() -> np.ndarray:
    return np.concatenate([[0.0], np.sqrt(SPREADS[1:] * SPREADS[:-1]), [np.inf]])


def _combos_kept(problem: _Problem, log_sizes: np.ndarray, spreads: np.ndarray) -> np.ndarray:
    """Combinations of the deviations' sizes that count at the least or the largest spread."""
    every = np.arange(log_sizes.size)
    if every.size == 1:
        return every
    logs = np.stack([
        problem.integrated(every, np.full(every.size, s)).log + log_sizes for s in {spreads[0], spreads[-1]}
    ])  # fmt: skip
    behind = logs.max(axis=1, keepdims=True) - logs
    return np.flatnonzero(behind.min(axis=0) < BEHIND)


@dataclass(frozen=True)
class _Problem:
    """Likelihoods of n runs under c combinations, log (n, c), slope (n, c, k), information (n, c, k, k), in natural
    units x = offset + scale z, both (k,); which: coefficients, which a run's factor multiplies, (k,)."""

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    offset: np.ndarray
    scale: np.ndarray
    which: np.ndarray

    def integrated(self, combos: np.ndarray, spreads: np.ndarray) -> Normals:
        """Log evidence (b,), means (b, k) and factors of the covariances (b, k, k) of the scores z, whose priors are
        N(0, 1) of either sign, at combinations (b,) with spreads (b,)."""
        k, n = self.scale.size, self.log.shape[0]
        b, big = np.moveaxis(self.slope[:, combos], 0, 1), np.moveaxis(self.information[:, combos], 0, 1)
        whole = np.eye(k) + np.sum(self.scale[:, None] * big * self.scale, axis=1)
        pull = np.sum(self.scale * (b - big @ self.offset), axis=1)
        u = np.zeros((combos.size, k + n))
        u[:, :k] = _solved(whole, pull)
        precision = 1.0 / np.maximum(spreads, 1e-12) ** 2
        moving = spreads > 0
        value = self._value(u, b, big, precision)
        for _ in range(STEPS if moving.any() else 0):
            slope, square = self._derivatives(u, b, big, precision, moving, whole=False)
            step = _solved(square, slope)
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
        log_det, covariance = _inverted(square)
        bad = ~np.isfinite(log_det)
        if bad.any():  # far from a maximum that is round: the information without its second part is positive
            part = [a[bad] for a in (u, b, big, precision, moving)]
            log_det[bad], covariance[bad] = _inverted(self._derivatives(*part, whole=False)[1])
        log = value + self.log[:, combos].sum(axis=0) - 0.5 * log_det
        log = log - np.where(moving, n * np.log(np.maximum(spreads, 1e-12)), 0.0)
        return Normals(log, u[:, :k], np.linalg.cholesky(covariance[:, :k, :k]))

    def _value(self, u: np.ndarray, b: np.ndarray, big: np.ndarray, precision: np.ndarray) -> np.ndarray:
        """Log prior, but for constants, plus log likelihoods less their constants, (b,)."""
        k = self.scale.size
        y = self._of_runs(u)
        fit = np.sum(b * y, axis=(1, 2)) - 0.5 * np.einsum("bni,bnij,bnj->b", y, big, y)
        return fit - 0.5 * np.sum(u[:, :k] ** 2, axis=1) - 0.5 * precision * np.sum(u[:, k:] ** 2, axis=1)

    def _of_runs(self, u: np.ndarray) -> np.ndarray:
        """Each run's parameters, (b, n, k)."""
        k = self.scale.size
        return (self.offset + self.scale * u[:, :k])[:, None, :] * self._factors(u)

    def _factors(self, u: np.ndarray) -> np.ndarray:
        grown = np.exp(np.clip(u[:, self.scale.size :], -5.0, 5.0))
        return np.where(self.which, grown[:, :, None], 1.0)

    def _derivatives(
        self,
        u: np.ndarray,
        b: np.ndarray,
        big: np.ndarray,
        precision: np.ndarray,
        moving: np.ndarray,
        whole: bool,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Slope of `_value`, (b, k + n), and minus its second derivatives, (b, k + n, k + n); without the curvature of
        the parameters themselves where not `whole`. Factors do not move where their spread is 0."""
        k, n = self.scale.size, self.log.shape[0]
        y, factors = self._of_runs(u), self._factors(u)
        pull = b - np.einsum("bnij,bnj->bni", big, y)
        by_z = factors * self.scale  # (b, n, k)
        along = np.where(self.which, y, 0.0)  # of y by a run's log factor
        size = u.shape[0]
        slope, square = np.zeros_like(u), np.zeros((size, k + n, k + n))
        slope[:, :k] = np.sum(by_z * pull, axis=1) - u[:, :k]
        slope[:, k:] = np.where(
            moving[:, None], np.sum(along * pull, axis=2) - precision[:, None] * u[:, k:], 0.0
        )
        square[:, :k, :k] = np.eye(k) + np.einsum("bni,bnij,bnj->bij", by_z, big, by_z)
        pushed = np.einsum("bnij,bnj->bni", big, along)
        cross = by_z * pushed
        own = np.sum(along * pushed, axis=2)
        if whole:
            cross = cross - np.where(self.which, by_z * pull, 0.0)
            own = own - np.sum(along * pull, axis=2)
        on = moving[:, None]
        square[:, :k, k:] = np.where(on[:, :, None], np.swapaxes(cross, 1, 2), 0.0)
        square[:, k:, :k] = np.where(on[:, :, None], cross, 0.0)
        places = np.arange(k, k + n)
        square[:, places, places] = np.where(on, own + precision[:, None], 1.0)
        return slope, square


def _scaled(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (b, m, m) with ones on their diagonals, and the roots of the diagonals, (b, m)."""
    root = np.sqrt(np.maximum(np.diagonal(square, axis1=1, axis2=2), 1e-300))
    return square / (root[:, :, None] * root[:, None, :]), root


def _solved(square: np.ndarray, aim: np.ndarray) -> np.ndarray:
    part, root = _scaled(square)
    part = part + 1e-13 * np.eye(part.shape[1])
    return np.linalg.solve(part, (aim / root)[:, :, None])[:, :, 0] / root


def _inverted(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Log determinants (b,) and inverses; not finite where a matrix is not positive."""
    part, root = _scaled(square)
    values, vectors = np.linalg.eigh(part)
    good = values[:, 0] > 0
    safe = np.where(good[:, None], values, 1.0)
    log_det = np.where(good, np.sum(np.log(safe), axis=1) + 2 * np.sum(np.log(root), axis=1), np.nan)
    inverse = (vectors / safe[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    return log_det, inverse / (root[:, :, None] * root[:, None, :])


def _scores(priors: Mapping[str, Prior], values: np.ndarray) -> np.ndarray:
    found = np.array([float(p.score(v)) for p, v in zip(priors.values(), values, strict=True)])
    return np.clip(np.nan_to_num(found, posinf=6.0, neginf=-6.0), -1e9, 1e9)


def _maps(priors: Mapping[str, Prior], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values at scores z, (k,), and their slopes by the scores there; straight lines on both sides of a fold at 0."""
    values, slopes = np.empty(z.size), np.empty(z.size)
    for i, (prior, score) in enumerate(zip(priors.values(), z, strict=True)):
        if prior.reflected:
            slopes[i] = float(prior.value(np.asarray(1.0)))
            values[i] = slopes[i] * score
            continue
        ends = prior.value(np.array([score - DERIVATIVE, score + DERIVATIVE]))
        values[i], slopes[i] = (
            float(prior.value(np.asarray(score))),
            float(np.diff(ends)[0]) / (2 * DERIVATIVE),
        )
    return values, slopes
