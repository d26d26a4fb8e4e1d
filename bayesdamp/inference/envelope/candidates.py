"""Fit a sum of damping terms or a power law to an envelope, and compute its evidence.

The damping law may be only approximately right: the decay rate that it gives is multiplied by 1 + g(t). This deviation
g has a Gaussian process prior and is integrated out.
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
"""Number of equidistant times (knots) in a decay at which g is inferred; between them g(t) is linear. g is the relative
deviation of the decay rate from the damping law."""
FIT_SCALE = 30.0
"""Scale of a half-normal prior that each damping term's decay rate has during a fit, as a multiple of the mean decay
rate of the record. The prior keeps the fit well-conditioned if two terms have nearly the same effect. It is not part of
the evidence."""
WIDE_SD = 100.0
"""Standard deviation of normal priors that are so wide that they hardly affect a fit. ln(A/A_ref) at the start of a
decay has such a prior (A: amplitude, A_ref: reference amplitude). In the fit of a power law dA/dt = -c A^p, ln c and p
have such priors; after the fit these two are replaced by the actual priors."""
NOISE_SCALES = np.exp(np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.3]))
"""Factors by which the standard deviation of the inferred noise is multiplied, because it is uncertain. The evidence is
averaged over these factors with equal weights. They are used if a decay has fewer than `MANY_READINGS` blocks of
readings."""
NOISE_SCALES_MANY = np.exp(np.array([-0.25, 0.0, 0.25]))
"""Factors of the noise's standard deviation that are used instead of `NOISE_SCALES` if a decay has at least
`MANY_READINGS` blocks of readings. Their range is narrower, because more blocks determine the noise better."""
MANY_READINGS = 40
"""Smallest number of blocks of readings for which the narrower range `NOISE_SCALES_MANY` of noise scales is used
instead of `NOISE_SCALES` (conventional)."""
MOST_POWER = 3.0
"""Largest exponent p of the power law dA/dt = -c A^p of the amplitude A. The prior of p is uniform from 0 to this
value."""
IMPROBABLE_EXACT = 0.1
"""A posterior is a mixture over sizes of the deviation g from the damping law, in which improbable components are left
out. If g = 0 (the law is exact) has at most this posterior probability, the posterior for g = 0 is therefore computed
again by itself."""
EXPONENT_GRID = 3001
"""Number of values of the exponent of a power law, from 0 to `MOST_POWER`, at which its distribution is computed."""
NEGLIGIBLE_WEIGHT = 1e-3
"""A posterior is a mixture over combinations of the noise, its scale, and the size and correlation length of the
deviation from the damping law. Where a fitted curve or the distribution of an exponent is computed, combinations are
left out if their probability is at most this fraction of the largest one."""


@dataclass(frozen=True)
class Blocks:
    """The readings of a free decay, averaged in n blocks, with their possible noises.

    A is the amplitude. A_ref is the reference amplitude: its level in dB is halfway between the levels at the start and
    at the end.

    Attributes
    ----------
    t
        Mean times of the readings in each block in s, minus that of the first block, (n,).
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
        Mean number of readings in a block.
    frequency
        Angular frequency of the oscillation in rad/s; None if it is not known.
    noises
        Possible noises of the readings, each with the covariance of x that it causes, (n, n); empty before
        `decay.infer_noises`.
    inverse
        Inverse of the lower Cholesky factor of the covariance of x, (n, n). Fits multiply residuals by it, so that
        these become independent with variance 1. Its shape is (0, 0) before `decay.infer_noises`.
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
        """The decay rate in 1/s that corresponds to a score of 1. The score of a rate is the rate divided by this unit.

        The unit is 0.1 times the angular frequency, which corresponds to a damping ratio of 0.1. If the frequency is
        not known, the unit is chosen so that the possible prior scales of a rate have the geometric mean 1/duration.
        """
        if self.frequency is not None:
            return SCORE_RATIO * self.frequency
        return SCORE_RATIO * (1.0 / (self.duration * float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))))

    @property
    def ends(self) -> tuple[float, float]:
        """ln(A/A_ref) at start and end of the decay: its means over the first and the last thirtieth of the blocks."""
        edge = max(1, self.x.size // 30)
        return float(self.x[:edge].mean()), float(self.x[-edge:].mean())


@dataclass(frozen=True)
class EnvelopeCandidate:
    """A sum of damping terms fitted to an envelope, with its evidence and posterior.

    Some terms have parameters besides their coefficients, such as an exponent. A sum with such terms has several
    candidates, each with other values of these parameters.

    Attributes
    ----------
    law
        The decay law of the sum.
    x0, rates, fit
        The fit: ln(A/A_ref) at the start (A_ref: see `Blocks`); rates c_i in 1/s of the law's terms (see `DecayLaw`),
        (d,); fitted ln(A/A_ref) at the blocks, (n,).
    about
        Normal posteriors of the model linearised about the fit, one for each combination of noise, its scale, and size
        and correlation length of the deviation g from the law.
    unit
        The rate in 1/s that corresponds to a score of 1; in `about`, rates are expressed by their scores, rate/unit.
    scores
        Standard normal scores of the terms' parameters besides their coefficients; () if there are none.
    log_share
        Number of nats to add to the log evidence `total` of this candidate. It contains the log prior odds of the sum.
        If the sum has several candidates, it also contains the log of this one's weight among them, so that the
        candidates add up to the evidence of the sum.
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
        """The posterior of the decay rates and of the deviation g from the law, averaged over the possible noises.

        It is the mixture of the normal posteriors in `about`, with half-normal priors of the rates, so that no rate is
        negative. Its unknowns are those in `about`: scores of the rates, not rates in 1/s.
        """
        return self.about.apply_priors()

    @cached_property
    def exact(self) -> LinearPosterior:
        """The posterior of the scores of the decay rates if the damping law is exact (deviation g = 0).

        Its `log_evidence` includes the log prior probability that the law is exact.
        """
        exact = self.about.size[self.posterior.combos] == 0.0
        if self.posterior.weights[exact].sum() > IMPROBABLE_EXACT:
            return self.posterior.only(exact)
        return self.about.apply_priors(self.about.size == 0.0)

    def draws(self, exact: bool, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw rates in 1/s, (count, d), and the deviation g at the knots in time, (count, KNOTS), from the posterior.

        The rates are the c_i of the law (see `DecayLaw`). g is the relative deviation of the decay rate from the law.
        exact: True to draw from the posterior under the exact law, where g = 0; False to draw from the whole posterior.
        """
        u, _ = (self.exact if exact else self.posterior).draws(count, rng)
        return self.unit * u[:, : len(self.terms)], u[:, -KNOTS:]

    def curve(self, blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
        """Return the posterior mean and standard deviation of ln(A/A_ref) at the n blocks of readings, (n,) each.

        blocks: those to which the candidate was fitted. Both results include the deviation from the law. They are
        computed to first order about the fit, like the evidence, but without the condition that no rate is negative.
        """
        d, at = self.rates.size, np.append(self.rates, self.x0)
        motion = solver_of(blocks, self.law).solve(at, tangents=ALL)
        # The 0.0 is for the error of the noise floor, which does not change the amplitudes.
        units = [*[self.unit] * d, WIDE_SD, 0.0, *[1.0] * KNOTS]
        columns = np.insert(motion.tangents, d + 1, 0.0, axis=1) * units
        used = np.flatnonzero(self.posterior.weights > NEGLIGIBLE_WEIGHT * self.posterior.weights.max())
        means, factors = self.posterior.posteriors(used)
        weights = self.posterior.weights[used] / self.posterior.weights[used].sum()
        curves = motion.y - motion.tangents[:, :d] @ self.rates + means @ columns.T
        mean = weights @ curves
        return mean, np.sqrt(weights @ ((curves - mean) ** 2 + np.sum((columns @ factors) ** 2, axis=2)))

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
        """Log evidence in nats, averaged over the possible noises, their scales and the deviation from the damping law.

        It is the evidence for the values in `scores`. The log prior odds of the sum, which `log_share` contains, are
        not included.
        """
        return self.posterior.log_evidence

    @property
    def total_exact(self) -> float:
        """Log evidence in nats if the damping law is exact, plus the log prior probability that it is exact.

        `log_share` is not included.
        """
        return self.exact.log_evidence


def solver_of(blocks: Blocks, law: DecayLaw | PowerLaw, white: np.ndarray | None = None) -> AmplitudeSolver:
    """Return a solver that computes the decay of the amplitude under a damping law at the times of the blocks.

    white: matrix by which the solver multiplies decays and derivatives to whiten the noise of the blocks, (n, n); None
    to leave them as they are.
    """
    return AmplitudeSolver(law, blocks.t, blocks.duration, KNOTS, white)


def fit_rates(blocks: Blocks, law: DecayLaw, white: np.ndarray) -> LeastSquaresFit:
    """Fit the decay rates of a sum of damping terms, and ln(A/A_ref) at the start, by least squares.

    No rate is negative; wide priors (`FIT_SCALE`, `WIDE_SD`) are included. The fit starts at the mean rate of the
    record, divided equally among the terms. If the oscillation would then come to rest too early, the fit starts at
    smaller rates.

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
        The fit; its values are the d rates c_i in 1/s (see `DecayLaw`), then ln(A/A_ref) at the start.
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

    white: matrix that whitens the noise, (n, n). priors: priors of the law's parameters, by name. begin: values of
    these parameters at which the fit starts, in the law's order. ln(A/A_ref) at the start has a wide normal prior
    (`WIDE_SD`). The values of the result are the law's parameters, then ln(A/A_ref) at the start.
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

    Both are averaged over the possible noises, their scales, and the size and correlation length of the deviation from
    the law.

    Parameters
    ----------
    blocks : Blocks
        The readings with their possible noises.
    law : DecayLaw
        The decay law of the sum.
    fitted : EnvelopeCandidate, optional
        A candidate with the same law that was computed with other noises. If it is given, its rates and its value at
        the start are used, and there is no new fit.
    scores, log_share
        Numbers that are only stored in the result, see `EnvelopeCandidate`; `scores` do not change the law.

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

    A is relative to the reference amplitude A_ref. white: matrix that whitens the noise, (n, n). The result has three
    values: ln c, where c is the decay rate (1/s) at A_ref; the exponent p, which is not limited; and ln(A/A_ref) at the
    start.
    """
    wide = Normal(mean=0.0, sd=WIDE_SD)
    begin = np.array([np.log(blocks.mean_rate), 1.0])
    return _fit_with_priors(blocks, PowerLaw(), white, {"log_rate": wide, "exponent": wide}, begin)


def power_law_evidence(blocks: Blocks) -> tuple[float, Quantity]:
    """Compute the evidence of the power law dA/dt = -c A^p and the posterior of its exponent.

    p has a uniform prior from 0 to `MOST_POWER`. The decay rate at the reference amplitude has the same prior as the
    rate of a single damping term.

    Parameters
    ----------
    blocks : Blocks
        The readings with their possible noises.

    Returns
    -------
    log_evidence : float
        Log evidence in nats, without prior odds, like `EnvelopeCandidate.total`.
    exponent : Quantity
        Median and 95 % interval of p, averaged over noises, their scales and the deviation from the law.
    """
    p = fit_power(blocks, blocks.inverse).values
    normals = _posteriors_about(blocks, PowerLaw(), p, np.full(2, WIDE_SD), False)[1].normals
    mean = WIDE_SD * normals.means[:, 1]
    sd = WIDE_SD * np.linalg.norm(normals.factors[:, 1], axis=1)
    rate_score = np.exp(p[0]) / blocks.unit
    log_density = float(shared_log_density(rate_score**2, 1) + np.log(rate_score))  # prior of ln c
    # Replace the wide normal priors of ln c and p, whose density is 1/(2π WIDE_SD²), by the actual ones.
    log_z = normals.log + log_density - np.log(MOST_POWER) + np.log(2 * np.pi * WIDE_SD**2)
    log_z = log_z + np.log(np.maximum(ndtr((MOST_POWER - mean) / sd) - ndtr(-mean / sd), 1e-300))
    # The distribution function of p is a mixture of normals, each truncated to the range of the prior. The mean of a
    # component that is far outside the range is moved to 6 sds from its end, so that its density there is not zero.
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
    law. They are ordered so that the correlation length varies fastest and the noise slowest. The unknowns of each
    posterior are d + 2 scores with the prior N(0, 1), then the values of g at the knots in time. The scores represent
    the d parameters of the law, ln(A/A_ref) at the start, and the error of the noise floor.

    Attributes
    ----------
    normals
        The posteriors; their log evidences include the log prior probabilities of the combinations.
    size
        Size (prior standard deviation) of g in each combination, (c,); 0 for the exact law.
    log_sizes
        Log prior probability of the size and the length in each combination, (c,).
    positive
        Mask of the scores that represent damping rates, which must not be negative, (d + 2,).
    """

    normals: Normals
    size: np.ndarray
    log_sizes: np.ndarray
    positive: np.ndarray

    def apply_priors(self, which: np.ndarray | None = None) -> LinearPosterior:
        """Return the posterior in which the damping rates have half-normal priors with one common, unknown scale.

        which: mask of the combinations of hyperparameters (noise, its scale, size and correlation length of the
        deviation from the law) to use, (c,); by default all.
        """
        normals = self.normals if which is None else self.normals.only(which)
        return with_priors(normals, self.positive, self.positive)


def _posteriors_about(
    blocks: Blocks, law: DecayLaw | PowerLaw, p: np.ndarray, units: np.ndarray, rates: bool
) -> tuple[Motion, FitPosteriors]:
    """Return the decay at parameters p, (d + 1,), with its derivatives, and the normal posteriors linearised about p.

    There is one posterior of all unknowns for each combination of hyperparameters: noise, its scale, and size and
    correlation length of the deviation from the law. In these posteriors the parameters are represented by scores with
    standard normal priors.

    p: the d parameters of the law, then ln(A/A_ref) at the start. units: values of the parameters that correspond to a
    score of 1, (d,). rates: True if the parameters are damping rates, which cannot be negative; False for those of a
    power law.
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
        # The constant part of the noise floor is subtracted; its error is an additional unknown.
        floor = 0.5 * noise.constant * np.exp(-2.0 * motion.y)
        unsure = noise.constant_sd / noise.constant if noise.constant > 0 else 0.0
        whole = [columns[:, : d + 1], unsure * floor, columns[:, d + 1 :], residual - floor]
        white, log_det = whiten_columns(covariance, whole)
        part = normals_of(condense(white[:, :-1], white[:, -1], positive), grid, variance, n)
        parts.append(replace(part, log=part.log + log_weight - log_det))
    every = Normals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Normals)))
    times = len(blocks.noises)
    return motion, FitPosteriors(every, np.tile(grid.size_g, times), np.tile(grid.log_prior, times), positive)
