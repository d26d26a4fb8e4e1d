"""Fit a damping sum or a power law to an envelope, and compute its evidence with the deviation integrated out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr

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
from bayesdamp.physics.amplitude import AmplitudeSolver, DecayLaw, PowerLaw
from bayesdamp.physics.kernel.solve import ALL, Motion
from bayesdamp.priors import (
    SCORE_RATIO,
    SHARED_SCALES,
    Normal,
    Prior,
    SharedHalfNormal,
    shared_log_density,
)
from bayesdamp.records.envelope.window import NoiseFloor

KNOTS = 14
"""Number of knots in time between which the deviation of the law is linear."""
FIT_SCALE = 30.0
"""Scale of a half-normal prior of the rates during a fit, in mean rates of the record. It keeps the fit
well-conditioned if two terms have nearly the same effect, and is not part of the evidence."""
WIDE_SD = 100.0
"""Standard deviation of wide normal priors: that of ln A at the start, which is the same in all sums, and those in the
fit of a power law."""
NOISE_SCALES = np.exp(np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.3]))
"""Factors of the sd of the inferred noise over which the evidence is averaged if there are few readings."""
NOISE_SCALES_MANY = np.exp(np.array([-0.25, 0.0, 0.25]))
"""Factors in place of `NOISE_SCALES` for at least `MANY_READINGS` readings, which determine the noise better."""
MANY_READINGS = 40
"""Number of readings from which `NOISE_SCALES_MANY` are used (conventional)."""
MOST_POWER = 3.0
"""Largest exponent of a power law."""
NEGLIGIBLE_WEIGHT = 1e-3
"""A combination of hyperparameters with at most this weight, relative to the largest, is left out of
`EnvelopeCandidate.curve`."""
IMPROBABLE_EXACT = 0.1
"""If the exact law has less than this probability, its posterior is computed separately, because the posterior of the
whole mixture leaves out improbable combinations."""


@dataclass(frozen=True)
class Blocks:
    """A free decay: means over short runs of readings, with their noise.

    Attributes
    ----------
    t
        Times in s from the start, (n,).
    x
        ln(A/A_ref), (n,).
    duration
        Duration of the decay in s.
    mean_rate
        Mean decay rate of the amplitude in 1/s.
    floor
        The noise floor after the decay, in units of A_ref²; None without one.
    each
        Number of readings in a mean.
    frequency
        Frequency of the oscillation in rad/s; None if it is not known.
    noises
        Possible noises, each with the covariance of x that it causes, (n, n).
    inverse
        Inverse Cholesky factor of the covariance that is used in fits, (n, n).
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
        """The rate in 1/s whose score is 1.

        If the frequency is not known, the geometric middle of the prior scales is at one over the duration.
        """
        if self.frequency is not None:
            return SCORE_RATIO * self.frequency
        return SCORE_RATIO * (1.0 / (self.duration * float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))))

    @property
    def with_first_noise(self) -> Blocks:
        """These blocks with only the first of the possible noises."""
        return replace(self, noises=self.noises[:1])

    @property
    def ends(self) -> tuple[float, float]:
        """Values of x at the start and at the end: means over the first and the last thirtieth of the blocks."""
        edge = max(1, self.x.size // 30)
        return float(self.x[:edge].mean()), float(self.x[-edge:].mean())


@dataclass(frozen=True)
class EnvelopeCandidate:
    """A damping sum fitted to an envelope, with its posterior.

    Attributes
    ----------
    law
        The decay law of the sum.
    x0, rates, fit
        The fit: ln(A/A_ref) at the start; rates in 1/s at the reference amplitude, (d,); fitted ln(A/A_ref) at the
        blocks, (n,).
    about
        Normal posteriors of the model linearised about the fit.
    posterior
        The posterior with half-normal priors of the rates.
    unit
        The rate in 1/s whose score is 1.
    scores
        Scores of the terms' own parameters, at one point of their posterior.
    log_share
        Log fraction of the evidence of the sum that this point represents, in nats.
    """

    law: DecayLaw
    x0: float
    rates: np.ndarray
    fit: np.ndarray
    about: FitPosteriors
    posterior: LinearPosterior
    unit: float
    scores: tuple[float, ...] = ()
    log_share: float = 0.0

    @cached_property
    def exact(self) -> LinearPosterior:
        """The posterior under the exact law; its evidence includes the prior probability of the exact law."""
        exact = self.about.size[self.posterior.combos] == 0.0
        if self.posterior.weights[exact].sum() > IMPROBABLE_EXACT:
            return self.posterior.only(exact)
        return self.about.apply_priors(self.about.size == 0.0)

    def draws(self, exact: bool, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw rates in 1/s, (count, d), and the deviation at the knots, (count, KNOTS).

        exact: whether to draw from the posterior under the exact law.
        """
        u, _ = (self.exact if exact else self.posterior).draws(self.about.positive, count, rng)
        return self.unit * u[:, : len(self.terms)], u[:, -KNOTS:]

    def curve(self, blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
        """Return the posterior mean and sd of ln(A/A_ref) at the blocks, with the deviation, (n,) each.

        They are computed to first order about the fit, like the evidence, and without the truncation of rates at zero.
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
        """Names of the damping terms of the sum."""
        return self.law.terms

    @property
    def name(self) -> str:
        """Name of the sum: its terms, joined by +."""
        return "+".join(self.law.terms)

    @property
    def total(self) -> float:
        """Log evidence of the mixture over all hyperparameters, in nats."""
        return self.posterior.log_evidence

    @property
    def total_exact(self) -> float:
        """Log evidence under the exact law plus the log of its prior probability, in nats."""
        return self.exact.log_evidence


def solver_of(blocks: Blocks, law: DecayLaw, white: np.ndarray | None = None) -> AmplitudeSolver:
    """Return a solver of the decay law at the times of the blocks. white: matrix that whitens their noise, (n, n)."""
    return AmplitudeSolver(law, blocks.t, blocks.duration, KNOTS, 1e-4 * blocks.mean_rate, white)


def fit_rates(
    blocks: Blocks, law: DecayLaw, white: np.ndarray, begin: np.ndarray | None = None
) -> LeastSquaresFit:
    """Fit the rates of a sum, which are not negative, and ln(A/A_ref) at the start.

    Parameters
    ----------
    blocks : Blocks
        The readings.
    law : DecayLaw
        The decay law.
    white : ndarray, shape (n, n)
        Matrix that whitens the noise.
    begin : ndarray, optional
        Rates at which the fit starts; by default equal parts of the mean rate.

    Returns
    -------
    LeastSquaresFit
        The fit; its values are the rates in 1/s and x at the start.
    """
    rates = np.full(len(law.terms), blocks.mean_rate / len(law.terms)) if begin is None else begin
    for _ in range(40):  # reduce the rates until the decay lasts to the end of the record
        if law.decay(blocks.t[-1:], _guess_start(blocks), rates)[0] > blocks.x.min() - 1.0:
            break
        rates = 0.7 * rates
    prior = SharedHalfNormal(per_ratio=FIT_SCALE * blocks.mean_rate / SCORE_RATIO)
    return _fit_with_priors(blocks, law, white, dict.fromkeys(law.terms, prior), rates)


def _guess_start(blocks: Blocks) -> float:
    """Return a first estimate of x at the start: the mean over the first twentieth of the blocks."""
    return float(blocks.x[: max(1, blocks.x.size // 20)].mean())


def _fit_with_priors(
    blocks: Blocks, law: DecayLaw, white: np.ndarray, priors: Mapping[str, Prior], begin: np.ndarray
) -> LeastSquaresFit:
    """Fit the parameters of a law with these priors, and x at the start, by least squares.

    begin: values of the law's parameters at which the fit starts.
    """
    names = (*law.terms, "start")
    parameters = Parameters(names, {**priors, "start": Normal(mean=0.0, sd=WIDE_SD)}, {})
    z = parameters.scores(dict(zip(names, map(float, (*begin, _guess_start(blocks))), strict=True)))
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
    begin: np.ndarray | None = None,
) -> EnvelopeCandidate:
    """Fit a damping sum, and compute its evidence and posterior over the grid of hyperparameters.

    Parameters
    ----------
    blocks : Blocks
        The readings with their noises.
    law : DecayLaw
        The decay law of the sum.
    fitted : EnvelopeCandidate, optional
        The same sum with other noises, whose fit is used instead of a new one.
    scores, log_share
        Scores of the terms' own parameters at which the sum is fitted, and the log fraction of the sum's evidence that
        this point represents; stored in the result.
    begin : ndarray, optional
        Rates at which a new fit starts.

    Returns
    -------
    EnvelopeCandidate
        The sum with its evidence.
    """
    p = np.append(fitted.rates, fitted.x0) if fitted else fit_rates(blocks, law, blocks.inverse, begin).values
    motion, about = _posteriors_about(blocks, law, p, np.full(len(law.terms), blocks.unit), True)
    posterior = about.apply_priors()
    return EnvelopeCandidate(
        law, float(p[-1]), p[:-1], motion.y, about, posterior, blocks.unit, scores, log_share
    )


def power_law_evidence(blocks: Blocks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the evidence of the power law dA/dt = -c A^p and the posterior of its exponent.

    p has a uniform prior from 0 to `MOST_POWER`; c, the rate at the reference amplitude, has the prior of a single
    term.

    Parameters
    ----------
    blocks : Blocks
        The readings with their noises.

    Returns
    -------
    log_evidence, mean, variance : ndarray, shape (b,)
        Log of the evidence times the prior probability, and mean and variance of p, for each combination of
        hyperparameters.
    """
    begin, wide = np.array([np.log(blocks.mean_rate), 1.0]), Normal(mean=0.0, sd=WIDE_SD)
    p = _fit_with_priors(
        blocks, PowerLaw(), blocks.inverse, {"log_rate": wide, "exponent": wide}, begin
    ).values
    normals = _posteriors_about(blocks, PowerLaw(), p, np.full(2, WIDE_SD), False)[1].normals
    exponent_mean = WIDE_SD * normals.means[:, 1]
    exponent_sd = WIDE_SD * np.linalg.norm(normals.factors[:, 1], axis=1)
    rate_score = np.exp(p[0]) / blocks.unit
    log_density = float(shared_log_density(rate_score**2, 1) + np.log(rate_score))  # prior of ln c
    # Replace the wide normal priors of ln c and p, whose density is 1/(2π WIDE_SD²), by the right ones.
    log_z = normals.log + log_density - np.log(MOST_POWER) + np.log(2 * np.pi * WIDE_SD**2)
    inside = ndtr((MOST_POWER - exponent_mean) / exponent_sd) - ndtr(-exponent_mean / exponent_sd)
    return log_z + np.log(np.maximum(inside, 1e-300)), exponent_mean, exponent_sd**2


@dataclass(frozen=True)
class FitPosteriors:
    """Normal posteriors of the linear model about a fit, for each of c combinations of hyperparameters.

    The hyperparameters are the noise, its scale, and size and length of the deviation (the length varies fastest). The
    unknowns are the scores of law, start and floor with priors N(0, 1), and the deviation at the knots.

    Attributes
    ----------
    normals
        The posteriors; their log evidences include the prior probabilities of the combinations.
    size
        Size of the deviation, (c,).
    log_sizes
        Log prior probability of its size and length, (c,).
    positive
        Which scores are damping rates, (d,).
    """

    normals: Normals
    size: np.ndarray
    log_sizes: np.ndarray
    positive: np.ndarray

    def apply_priors(self, which: np.ndarray | None = None) -> LinearPosterior:
        """Return the posterior with half-normal priors on the rates, which have one common, unknown scale.

        which: mask of the combinations that are used, (c,); by default all.
        """
        normals = self.normals
        if which is not None:
            normals = normals.only(which)
        return with_priors(normals, self.positive, self.positive)


def _posteriors_about(
    blocks: Blocks, law: DecayLaw, p: np.ndarray, units: np.ndarray, rates: bool
) -> tuple[Motion, FitPosteriors]:
    """Return the decay at p, (d + 1,), and the posteriors linearised about it.

    p: the d parameters of the law, and x at the start. units: values of the parameters that have a score of 1, (d,).
    rates: whether the parameters are damping rates.
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
