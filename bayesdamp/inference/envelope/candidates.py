"""Fit a sum of damping terms or a power law to an envelope, and compute its evidence.

The damping law may hold only approximately: the decay rate is multiplied by 1 + g(t). This deviation g has a Gaussian
process prior and is integrated out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from bayesdamp.inference.deviation.draws import Quantity
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit, fit
from bayesdamp.inference.deviation.linear import (
    LinearPosterior,
    Normals,
    condense,
    grid_of,
    normals as normals_of,
    with_priors,
)
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.envelope.noise import Noise, whiten_columns
from bayesdamp.numerics.weights import normalise
from bayesdamp.physics.amplitude import AmplitudeSolver, DecayLaw, PowerLaw
from bayesdamp.physics.kernel.solve import ALL, Motion
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, Normal, Prior, SharedHalfNormal, shared_log_density
from bayesdamp.records.envelope.window import NoiseFloor

KNOTS = 14
"""Number of equidistant times (knots) between which the deviation g(t) of the decay rate from its law is linear."""
FIT_SCALE = 30.0
"""Scale of a half-normal prior of the rates during a fit, as a multiple of the mean decay rate of the record. The prior
keeps the fit well-conditioned if two terms have nearly the same effect; it is not part of the evidence."""
WIDE_SD = 100.0
"""Standard deviation of wide normal priors: of ln(A/A_ref) at the start, where A_ref is the reference amplitude, and of
both parameters in the fit of a power law, whose priors are replaced by their actual ones after the fit."""
NOISE_SCALES = np.exp(np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.3]))
"""Factors by which the standard deviation of the inferred noise is multiplied; the evidence is averaged over them. They
are used for fewer than `MANY_READINGS` blocks."""
NOISE_SCALES_MANY = np.exp(np.array([-0.25, 0.0, 0.25]))
"""Factors that are used instead of `NOISE_SCALES` for at least `MANY_READINGS` blocks, which determine the noise
better."""
MANY_READINGS = 40
"""Number of blocks of readings from which the narrower range `NOISE_SCALES_MANY` of noise scales is used
(conventional)."""
MOST_POWER = 3.0
"""Largest exponent p of the power law dA/dt = -c A^p (the smallest is 0)."""
IMPROBABLE_EXACT = 0.1
"""If the exact law (deviation g = 0) has at most this posterior probability, its posterior is computed again without
the other components of the mixture, because the posterior of the whole mixture leaves out improbable components."""
EXPONENT_GRID = 3001
"""Number of values of the exponent of a power law, from 0 to `MOST_POWER`, at which its distribution is computed."""
NEGLIGIBLE_WEIGHT = 1e-3
"""Components of a posterior mixture (combinations of noise, its scale, and size and correlation length of the deviation
from the law) are left out of curves and of the distribution of an exponent if their probability is at most this
fraction of the largest one."""


@dataclass(frozen=True)
class Blocks:
    """The readings of a free decay, averaged in n blocks, with their possible noises.

    A is the amplitude, and A_ref the reference amplitude in the middle of the decrease in dB.

    Attributes
    ----------
    t
        Mean times of the blocks in s from the first one, (n,).
    x
        Means of ln(A/A_ref) over the blocks, (n,). `decay.infer_noises` corrects them for the curvature of the decay
        within a block.
    duration
        Time from the first to the last block in s.
    mean_rate
        Mean decay rate of the amplitude, -d ln A/dt, in 1/s.
    floor
        The noise floor measured after the decay, with powers in units of A_ref²; None if it was not measured.
    each
        Number of readings in a block.
    frequency
        Angular frequency of the oscillation in rad/s; None if it is not known.
    noises
        Possible noises, each with its covariance of x, (n, n).
    inverse
        Inverse of the Cholesky factor of the covariance of x in fits, (n, n); it whitens residuals.
    """

    t: np.ndarray
    x: np.ndarray
    duration: float
    mean_rate: float
    floor: NoiseFloor | None = None
    each: float = 1.0
    frequency: float | None = None
    noises: tuple[tuple[Noise, np.ndarray], ...] = ()
    inverse: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def unit(self) -> float:
        """The decay rate in 1/s that corresponds to a score of 1; scores are the rates in this unit.

        It is 0.1 times the angular frequency (a damping ratio of 0.1). If the frequency is not known, it is such that
        the geometric middle of the possible prior scales of a rate is 1/duration.
        """
        if self.frequency is not None:
            return SCORE_RATIO * self.frequency
        return SCORE_RATIO * (1.0 / (self.duration * float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))))

    @property
    def ends(self) -> tuple[float, float]:
        """Values of x at the start and at the end: means over the first and the last thirtieth of the blocks."""
        edge = max(1, self.x.size // 30)
        return float(self.x[:edge].mean()), float(self.x[-edge:].mean())


@dataclass(frozen=True)
class EnvelopeCandidate:
    """A sum of damping terms fitted to an envelope, with its evidence and posterior.

    A sum whose terms have parameters besides their coefficients (such as an exponent) has several candidates, each with
    other values of these parameters.

    Attributes
    ----------
    law
        The decay law of the sum.
    x0, rates, fit
        The fit: ln(A/A_ref) at the start; rates c_i in 1/s of the law's terms (see `DecayLaw`), (d,); fitted
        ln(A/A_ref) at the blocks, (n,).
    about
        Normal posteriors of the model linearised about the fit, one for each combination of hyperparameters.
    unit
        The rate in 1/s that corresponds to a score of 1; scores, with a standard normal prior, represent the rates.
    scores
        Standard normal scores of the terms' parameters besides their coefficients; () if there are none.
    log_share
        Number of nats to add to the log evidence `total` of this candidate: the log prior odds of the sum and, if it
        has several candidates, the log of the factor that makes the candidates add up to the evidence of the sum.
    """

    law: DecayLaw
    x0: float
    rates: np.ndarray
    fit: np.ndarray
    about: FitPosteriors
    unit: float
    scores: tuple[float, ...] = ()
    log_share: float = 0.0

    @cached_property
    def posterior(self) -> LinearPosterior:
        """The mixture of the posteriors in `about`, with half-normal priors of the rates (none is negative)."""
        return self.about.apply_priors()

    @cached_property
    def exact(self) -> LinearPosterior:
        """The posterior under the exact law (deviation g = 0); its evidence contains this law's prior probability."""
        exact = self.about.size[self.posterior.combos] == 0.0
        if self.posterior.weights[exact].sum() > IMPROBABLE_EXACT:
            return self.posterior.only(exact)
        return self.about.apply_priors(self.about.size == 0.0)

    def draws(self, exact: bool, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw rates in 1/s, (count, d), and the deviation g at the knots in time, (count, KNOTS), from the posterior.

        Rates are the c_i of the law (see `DecayLaw`). g is the relative deviation of the decay rate from the law.
        exact: whether to draw from the posterior under the exact law, where g = 0.
        """
        u, _ = (self.exact if exact else self.posterior).draws(count, rng)
        return self.unit * u[:, : len(self.terms)], u[:, -KNOTS:]

    def curve(self, blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
        """Return the posterior mean and standard deviation of ln(A/A_ref) at the blocks, (n,) each.

        Both include the deviation from the law. They are computed to first order about the fit, like the evidence, but
        without the condition that no rate is negative.
        """
        d, at = self.rates.size, np.append(self.rates, self.x0)
        motion = solver_of(blocks, self.law).solve(at, tangents=ALL)
        units = [
            *[self.unit] * d,
            WIDE_SD,
            0.0,
            *[1.0] * KNOTS,
        ]  # an error of the floor does not change amplitudes
        columns = np.insert(motion.tangents, d + 1, 0.0, axis=1) * units
        used = np.flatnonzero(self.posterior.weights > NEGLIGIBLE_WEIGHT * self.posterior.weights.max())
        means, factors = self.posterior.posteriors(used)
        weights = self.posterior.weights[used] / self.posterior.weights[used].sum()
        curves = motion.y - motion.tangents[:, :d] @ self.rates + means @ columns.T
        mean = weights @ curves
        variance = weights @ ((curves - mean) ** 2 + np.sum((columns @ factors) ** 2, axis=2))
        return mean, np.sqrt(variance)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the damping terms of the sum, in the order of `rates`."""
        return self.law.terms

    @property
    def name(self) -> str:
        """Name of the sum: its terms, joined by +, such as `viscous+coulomb`."""
        return "+".join(self.law.terms)

    @property
    def total(self) -> float:
        """Log evidence in nats, averaged over noises, their scales and the deviation, without `log_share`."""
        return self.posterior.log_evidence

    @property
    def total_exact(self) -> float:
        """Log of (evidence under the exact law, where the deviation g is 0, times its prior probability), in nats."""
        return self.exact.log_evidence


def solver_of(blocks: Blocks, law: DecayLaw | PowerLaw, white: np.ndarray | None = None) -> AmplitudeSolver:
    """Return a solver of the decay law at the times of the blocks.

    white: matrix by which the solver multiplies decays and derivatives to whiten the noise of the blocks, (n, n); None
    to leave them as they are.
    """
    return AmplitudeSolver(law, blocks.t, blocks.duration, KNOTS, white)


def fit_rates(blocks: Blocks, law: DecayLaw, white: np.ndarray) -> LeastSquaresFit:
    """Fit the rates of a sum of damping terms (none is negative), and ln(A/A_ref) at the start, by least squares.

    The fit starts at the mean rate of the record, divided equally among the terms.

    Parameters
    ----------
    blocks : Blocks
        The readings.
    law : DecayLaw
        The decay law of the sum, with d terms.
    white : ndarray, shape (n, n)
        Matrix that whitens the noise, such as `Blocks.inverse`.

    Returns
    -------
    LeastSquaresFit
        The fit; its values are the d rates in 1/s at the reference amplitude, then ln(A/A_ref) at the start.
    """
    rates = np.full(len(law.terms), blocks.mean_rate / len(law.terms))
    for _ in range(40):  # reduce the rates until the decay lasts to the end of the record
        if law.solve(blocks.t[-1:], blocks.ends[0], rates)[0][0] > blocks.x.min() - 1.0:
            break
        rates = 0.7 * rates
    prior = SharedHalfNormal(per_ratio=FIT_SCALE * blocks.mean_rate / SCORE_RATIO)
    return _fit_with_priors(blocks, law, white, dict.fromkeys(law.terms, prior), rates)


def _fit_with_priors(
    blocks: Blocks,
    law: DecayLaw | PowerLaw,
    white: np.ndarray,
    priors: Mapping[str, Prior],
    begin: np.ndarray,
) -> LeastSquaresFit:
    """Fit the parameters of a decay law, and ln(A/A_ref) at the start, by least squares with priors.

    white: matrix that whitens the noise, (n, n). priors: of the law's parameters, by name. begin: values of these
    parameters at which the fit starts, in the law's order. ln(A/A_ref) at the start has a wide prior (`WIDE_SD`). The
    values of the result are the law's parameters, then ln(A/A_ref) at the start.
    """
    names = (*law.terms, "start")
    parameters = Parameters(names, {**priors, "start": Normal(mean=0.0, sd=WIDE_SD)}, {})
    z = parameters.scores(dict(zip(names, map(float, (*begin, blocks.ends[0])), strict=True)))
    solver, every = solver_of(blocks, law, white), np.ones(len(names), bool)
    fitted = fit(solver, parameters, every, white @ blocks.x, z, noise=1.0, windows=False)
    assert fitted is not None  # every decay is finite
    return fitted


def fit_candidate(
    blocks: Blocks,
    law: DecayLaw,
    fitted: EnvelopeCandidate | None = None,
    scores: tuple[float, ...] = (),
    log_share: float = 0.0,
) -> EnvelopeCandidate:
    """Fit a sum of damping terms to an envelope, and compute its evidence and posterior.

    Both are averaged over noises, their scales, and the size and correlation length of the deviation from the law.

    Parameters
    ----------
    blocks : Blocks
        The readings with their possible noises.
    law : DecayLaw
        The decay law of the sum.
    fitted : EnvelopeCandidate, optional
        A candidate with the same law, computed with other noises. Its rates and start are then used instead of a new
        fit.
    scores, log_share
        Stored in the result, see `EnvelopeCandidate`.

    Returns
    -------
    EnvelopeCandidate
        The candidate with its evidence.
    """
    p = np.append(fitted.rates, fitted.x0) if fitted else fit_rates(blocks, law, blocks.inverse).values
    motion, about = _posteriors_about(blocks, law, p, np.full(len(law.terms), blocks.unit), True)
    return EnvelopeCandidate(law, float(p[-1]), p[:-1], motion.y, about, blocks.unit, scores, log_share)


def fit_power(blocks: Blocks, white: np.ndarray) -> LeastSquaresFit:
    """Fit the power law dA/dt = -c A^p, and ln(A/A_ref) at the start, by least squares.

    A is relative to the reference amplitude. white: matrix that whitens the noise, (n, n). The values of the result are
    ln c, where c is the decay rate (1/s) at the reference amplitude, p, and ln(A/A_ref) at the start. p is not limited.
    """
    wide = Normal(mean=0.0, sd=WIDE_SD)
    begin = np.array([np.log(blocks.mean_rate), 1.0])
    return _fit_with_priors(blocks, PowerLaw(), white, {"log_rate": wide, "exponent": wide}, begin)


def power_law_evidence(blocks: Blocks) -> tuple[float, Quantity]:
    """Compute the evidence of the power law dA/dt = -c A^p and the posterior of its exponent.

    p has a uniform prior from 0 to `MOST_POWER`. The decay rate at the reference amplitude has the prior that the rate
    of a damping term has in a sum of one term.

    Parameters
    ----------
    blocks : Blocks
        The readings with their possible noises.

    Returns
    -------
    log_evidence : float
        Log evidence in nats.
    exponent : Quantity
        Median and 95 % interval of p, averaged over noises, their scales and the deviation from the law.
    """
    p = fit_power(blocks, blocks.inverse).values
    normals = _posteriors_about(blocks, PowerLaw(), p, np.full(2, WIDE_SD), False)[1].normals
    mean = WIDE_SD * normals.means[:, 1]
    sd = WIDE_SD * np.linalg.norm(normals.factors[:, 1], axis=1)
    rate_score = np.exp(p[0]) / blocks.unit
    log_density = float(shared_log_density(rate_score**2, 1) + np.log(rate_score))  # prior of ln c
    # Replace the wide normal priors of ln c and p, whose density is 1/(2π WIDE_SD²), by the right ones.
    log_z = normals.log + log_density - np.log(MOST_POWER) + np.log(2 * np.pi * WIDE_SD**2)
    log_z = log_z + np.log(np.maximum(ndtr((MOST_POWER - mean) / sd) - ndtr(-mean / sd), 1e-300))
    # The distribution function of p: a mixture of normals, each truncated to the range of the prior. A component that
    # is far outside the range is at its end, at whatever distance it is.
    weight, mean = normalise(log_z), np.clip(mean, -6.0 * sd, MOST_POWER + 6.0 * sd)
    used = weight > NEGLIGIBLE_WEIGHT * weight.max()
    grid = np.linspace(0.0, MOST_POWER, EXPONENT_GRID)
    below = ndtr((grid - mean[used, None]) / sd[used, None])
    share = weight[used] @ ((below - below[:, :1]) / (below[:, -1:] - below[:, :1]))
    low, middle, high = np.interp([0.025, 0.5, 0.975], share / share[-1], grid).tolist()
    return float(np.logaddexp.reduce(log_z)), Quantity(middle, low, high)


@dataclass(frozen=True)
class FitPosteriors:
    """Normal posteriors of a decay linearised about a fit, one for each of c combinations of hyperparameters.

    A combination consists of the noise, its scale, and the size and the correlation length of the deviation g from the
    law (in the order of the posteriors the length varies fastest, the noise slowest). The unknowns are d + 2 scores
    with the prior N(0, 1), of the law's d parameters, the start and the floor, and g at the knots.

    Attributes
    ----------
    normals
        The posteriors; their log evidences include the log prior probabilities of the combinations.
    size
        Size (prior standard deviation) of g in each combination, (c,); 0 for the exact law.
    log_sizes
        Log prior probability of the size and the length in each combination, (c,).
    positive
        Which of the scores are damping rates, (d + 2,).
    """

    normals: Normals
    size: np.ndarray
    log_sizes: np.ndarray
    positive: np.ndarray

    def apply_priors(self, which: np.ndarray | None = None) -> LinearPosterior:
        """Return the posterior with half-normal priors of the rates; their scale is unknown and the same for all rates.

        which: mask of the combinations of hyperparameters (noise, its scale, size and correlation length of the
        deviation from the law) to use, (c,); by default all.
        """
        normals = self.normals
        if which is not None:
            normals = normals.only(which)
        return with_priors(normals, self.positive, self.positive)


def _posteriors_about(
    blocks: Blocks, law: DecayLaw | PowerLaw, p: np.ndarray, units: np.ndarray, rates: bool
) -> tuple[Motion, FitPosteriors]:
    """Return the decay at parameters p, (d + 1,), with its derivatives, and the normal posteriors linearised about p.

    There is one posterior of all unknowns for each combination of hyperparameters: noise, its scale, and size and
    correlation length of the deviation from the law. Scores represent the parameters and have standard normal priors.

    p: the d parameters of the law, then ln(A/A_ref) at the start. units: values of the parameters that correspond to a
    score of 1, (d,). rates: whether the parameters are damping rates, which cannot be negative.
    """
    motion, n, d = solver_of(blocks, law).solve(p, tangents=ALL), blocks.t.size, units.size
    columns = motion.tangents * np.concatenate([units, [WIDE_SD], np.ones(KNOTS)])
    residual = blocks.x - motion.y + motion.tangents[:, :d] @ p[:d]
    scales = NOISE_SCALES if n < MANY_READINGS else NOISE_SCALES_MANY
    sizes = grid_of(KNOTS, phases=False)
    grid = sizes.only(np.tile(np.arange(sizes.log_prior.size), scales.size))
    variance = np.repeat(scales**2, grid.log_prior.size // scales.size)
    weight = np.array([noise.log_weight for noise, _ in blocks.noises])
    weight = weight - np.logaddexp.reduce(weight) - np.log(scales.size)
    positive = np.array([rates] * d + [False, False])
    parts = []
    for (noise, covariance), log_weight in zip(blocks.noises, weight, strict=True):
        # The constant part of the floor is subtracted; its error is an additional unknown.
        floor = 0.5 * noise.constant * np.exp(-2.0 * motion.y)
        unsure = noise.constant_sd / noise.constant if noise.constant > 0 else 0.0
        white, log_det = whiten_columns(
            covariance, [columns[:, : d + 1], unsure * floor, columns[:, d + 1 :], residual - floor]
        )
        part = normals_of(condense(white[:, :-1], white[:, -1], positive), grid, variance, n)
        parts.append(replace(part, log=part.log + log_weight - log_det))
    every = Normals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Normals)))
    times = len(blocks.noises)
    return motion, FitPosteriors(every, np.tile(grid.size_g, times), np.tile(grid.log_prior, times), positive)
