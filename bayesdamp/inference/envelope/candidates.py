"""One damping sum, or a power law, on a record: its fit, and its evidence with the deviation integrated out."""

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
from bayesdamp.inference.envelope.noise import Noise, whiten
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
"""Number of knots of the deviation."""
HOLD = 30.0
"""Scale of a half-normal prior of the rates during a fit, in mean rates of the record. It only keeps the fit
well-conditioned where two terms lose nearly alike, and is not a part of the evidence."""
START_SD = 100.0
"""Prior sd of ln A at the start: wide, and the same in all sums."""
SCALES = np.exp(np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.3]))
"""Possible factors on the inferred noise: few readings do not determine it well."""
SCALES_MANY = np.exp(np.array([-0.25, 0.0, 0.25]))
"""The same with MANY readings."""
MANY = 40
POWER_MOST = 3.0
"""Largest exponent of a power law."""
NEGLIGIBLE = 1e-3
"""Weight of a combination of hyperparameters, relative to the largest, that is ignored in the curve of a picture."""
IMPROBABLE = 0.1
"""Below this probability of a law that holds exactly, its posterior is computed alone: the whole one may lack a part of
it."""


@dataclass(frozen=True)
class Blocks:
    """A free decay as means over runs of readings.

    Attributes
    ----------
    t
        Times in s from the start, (n,).
    x
        ln(A/A_ref), (n,).
    duration
        In s.
    mean_rate
        In 1/s.
    floor
        The noise floor after the decay, in units of A_ref², None where there is none.
    each
        Number of readings in a mean.
    frequency
        Of the oscillation in rad/s, None where it is not known.
    noises
        Possible noises, each with the covariance of x, (n, n).
    inverse
        Inverse triangle of the covariance under which fits are made, (n, n).
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
        """Rate in 1/s at a score of 1.

        Where the frequency is not known, the middle of the prior's scales is one over the duration: the record is
        assumed to have a middle damping ratio, and no result depends on the unit of time.
        """
        if self.frequency is not None:
            return SCORE_RATIO * self.frequency
        return SCORE_RATIO * (1.0 / (self.duration * float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1]))))

    @property
    def with_first_noise(self) -> Blocks:
        """The same with the first of the possible noises alone."""
        return replace(self, noises=self.noises[:1])

    @property
    def ends(self) -> tuple[float, float]:
        """x at the start and at the end: means of a thirtieth of the readings."""
        edge = max(1, self.x.size // 30)
        return float(self.x[:edge].mean()), float(self.x[-edge:].mean())


@dataclass(frozen=True)
class EnvelopeCandidate:
    """A damping sum on a record, with its posterior over hyperparameters and scales of the prior.

    Attributes
    ----------
    law
        The sum.
    x0, rates, fit
        The fit: ln(A/A_ref) at the start; rates in 1/s at the reference amplitude, (d,); ln(A/A_ref), (n,).
    about
        The posterior of the model that is linear about the fit.
    weighed
        The same posterior under half-normal priors of the rates.
    unit
        Rate in 1/s at a score of 1.
    scores
        Scores of the terms' further parameters, at one point of their posterior.
    log_share
        Log share of that point in the sum's evidence, in nats.
    """

    law: DecayLaw
    x0: float
    rates: np.ndarray
    fit: np.ndarray
    about: FitPosteriors
    weighed: LinearPosterior
    unit: float
    scores: tuple[float, ...] = ()
    log_share: float = 0.0

    @cached_property
    def exact(self) -> LinearPosterior:
        """The posterior given that the law holds exactly, times its prior probability."""
        exact = self.about.size[self.weighed.combos] == 0.0
        if self.weighed.weights[exact].sum() > IMPROBABLE:
            return self.weighed.only(exact)
        return self.about.under_priors(self.about.size == 0.0)

    def draws(self, exact: bool, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw rates in 1/s, (n, d), and the deviation at the knots, (n, KNOTS)."""
        u, _ = (self.exact if exact else self.weighed).draws(self.about.positive, count, rng)
        return self.unit * u[:, : len(self.terms)], u[:, -KNOTS:]

    def curve(self, blocks: Blocks) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean and the sd of ln(A/A_ref) at the readings with the law's deviation, (n,) both.

        It is to first order about the fit, as the evidence is, and without the truncation of rates at zero.
        """
        d, at = self.rates.size, np.append(self.rates, self.x0)
        motion = solver_of(blocks, self.law).solve(at, tangents=ALL)
        units = [*[self.unit] * d, START_SD, 0.0, *[1.0] * KNOTS]  # the floor's error changes no amplitude
        columns = np.insert(motion.tangents, d + 1, 0.0, axis=1) * units
        used = np.flatnonzero(self.weighed.weights > NEGLIGIBLE * self.weighed.weights.max())
        means, factors = self.weighed.posteriors(used)
        weights = self.weighed.weights[used] / self.weighed.weights[used].sum()
        curves = motion.y - motion.tangents[:, :d] @ self.rates + means @ columns.T
        mean = weights @ curves
        variance = weights @ ((curves - mean) ** 2 + np.sum((columns @ factors) ** 2, axis=2))
        return mean, np.sqrt(variance)

    @property
    def terms(self) -> tuple[str, ...]:
        """Terms of the sum."""
        return self.law.terms

    @property
    def name(self) -> str:
        """Name of the sum."""
        return "+".join(self.law.terms)

    @property
    def total(self) -> float:
        """Log evidence over the whole grid."""
        return self.weighed.log_evidence

    @property
    def total_exact(self) -> float:
        """Log evidence of the law that holds exactly, with its prior probability."""
        return self.exact.log_evidence


def solver_of(blocks: Blocks, law: DecayLaw, white: np.ndarray | None = None) -> AmplitudeSolver:
    """Return a solver of decays at the blocks under a law; white: matrix that whitens their noise, (n, n)."""
    return AmplitudeSolver(law, blocks.t, blocks.duration, KNOTS, 1e-4 * blocks.mean_rate, white)


def fit_rates(
    blocks: Blocks, law: DecayLaw, white: np.ndarray, begin: np.ndarray | None = None
) -> LeastSquaresFit:
    """Fit a sum's rates, which are not negative, and ln A at the start.

    Parameters
    ----------
    blocks : Blocks
        The readings.
    law : DecayLaw
        The sum.
    white : ndarray, shape (n, n)
        Matrix that whitens their noise.
    begin : ndarray, optional
        Rates at which the fit starts.
    """
    rates = np.full(len(law.terms), blocks.mean_rate / len(law.terms)) if begin is None else begin
    for _ in range(40):  # until the amplitude still moves at the end of the record
        if law.decay(blocks.t[-1:], _start_of(blocks), rates)[0] > blocks.x.min() - 1.0:
            break
        rates = 0.7 * rates
    prior = SharedHalfNormal(per_ratio=HOLD * blocks.mean_rate / SCORE_RATIO)
    return _fitted(blocks, law, white, dict.fromkeys(law.terms, prior), rates)


def _start_of(blocks: Blocks) -> float:
    """Return a first guess of x at the start."""
    return float(blocks.x[: max(1, blocks.x.size // 20)].mean())


def _fitted(
    blocks: Blocks, law: DecayLaw, white: np.ndarray, priors: Mapping[str, Prior], begin: np.ndarray
) -> LeastSquaresFit:
    names = (*law.terms, "start")
    parameters = Parameters(names, {**priors, "start": Normal(mean=0.0, sd=START_SD)}, {})
    z = parameters.scores(dict(zip(names, map(float, (*begin, _start_of(blocks))), strict=True)))
    solver, every = solver_of(blocks, law, white), np.ones(len(names), bool)
    fitted = fit(solver, parameters, every, white @ blocks.x, z, noise=1.0, windows=False)
    assert fitted is not None  # no decay escapes
    return fitted


def weigh(
    blocks: Blocks,
    law: DecayLaw,
    fitted: EnvelopeCandidate | None = None,
    scores: tuple[float, ...] = (),
    log_share: float = 0.0,
    begin: np.ndarray | None = None,
) -> EnvelopeCandidate:
    """Compute a sum's evidence and posterior over the grid of hyperparameters.

    Parameters
    ----------
    blocks : Blocks
        The readings with their noises.
    law : DecayLaw
        The sum.
    fitted : Candidate, optional
        The same sum with another noise, whose fit is used.
    scores, log_share
        As in `EnvelopeCandidate`.
    begin : ndarray, optional
        Rates at which the fit starts, without `fitted`.
    """
    p = np.append(fitted.rates, fitted.x0) if fitted else fit_rates(blocks, law, blocks.inverse, begin).values
    motion, about = _posteriors_about(blocks, law, p, np.full(len(law.terms), blocks.unit), True)
    weighed = about.under_priors()
    return EnvelopeCandidate(
        law, float(p[-1]), p[:-1], motion.y, about, weighed, blocks.unit, scores, log_share
    )


def weigh_power(blocks: Blocks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weigh the power law dA/dt = -c A^p, with p uniform on 0 to POWER_MOST.

    c, the rate at the reference amplitude, has the prior of the rate of a single term.

    Parameters
    ----------
    blocks : Blocks
        The readings with their noises.

    Returns
    -------
    log_evidence, mean, variance : ndarray, shape (b,)
        Of p over the grid of hyperparameters.
    """
    begin, wide = np.array([np.log(blocks.mean_rate), 1.0]), Normal(mean=0.0, sd=START_SD)
    p = _fitted(blocks, PowerLaw(), blocks.inverse, {"log_rate": wide, "exponent": wide}, begin).values
    # Wide normals replace the priors of ln c and p; their heights are corrected below.
    normals = _posteriors_about(blocks, PowerLaw(), p, np.full(2, START_SD), False)[1].normals
    power, sd = START_SD * normals.means[:, 1], START_SD * np.linalg.norm(normals.factors[:, 1], axis=1)
    score = np.exp(p[0]) / blocks.unit
    density = float(shared_log_density(score**2, 1) + np.log(score))  # of ln c
    log_z = normals.log + density - np.log(POWER_MOST) + np.log(2 * np.pi * START_SD**2)
    inside = ndtr((POWER_MOST - power) / sd) - ndtr(-power / sd)
    return log_z + np.log(np.maximum(inside, 1e-300)), power, sd**2


@dataclass(frozen=True)
class FitPosteriors:
    """Normal posteriors about a fit under each of c combinations of hyperparameters.

    These are a noise, its scale, and the deviation's size and length, the last one running fastest. The posteriors are
    those of the scores of law, start and floor with priors N(0, 1), and of the deviation.

    Attributes
    ----------
    normals
        The posteriors; their log evidences contain the prior probability of the combination.
    size
        Size of the deviation, (c,).
    log_sizes
        Log prior probability of its size and length, (c,).
    positive
        Which scores are rates of damping, (d,).
    """

    normals: Normals
    size: np.ndarray
    log_sizes: np.ndarray
    positive: np.ndarray

    def under_priors(self, which: np.ndarray | None = None) -> LinearPosterior:
        """Return the posterior under half-normal priors of the rates that share one unknown scale.

        `which` selects combinations, (c,).
        """
        normals = self.normals
        if which is not None:
            normals = normals.only(which)
        return with_priors(normals, self.positive, self.positive)


def _posteriors_about(
    blocks: Blocks, law: DecayLaw, p: np.ndarray, units: np.ndarray, rates: bool
) -> tuple[Motion, FitPosteriors]:
    """Return the decay of a law's parameters and x at the start, p (d + 1,), and the posteriors about it.

    units: of the law's parameters at a score of 1, (d,); rates: whether they are rates of damping.
    """
    motion, n, d = solver_of(blocks, law).solve(p, tangents=ALL), blocks.t.size, units.size
    columns = motion.tangents * np.concatenate([units, [START_SD], np.ones(KNOTS)])
    residual = blocks.x - motion.y + motion.tangents[:, :d] @ p[:d]
    scales = SCALES if n < MANY else SCALES_MANY
    sizes = grid_of(KNOTS, phases=False)
    grid = sizes.only(np.tile(np.arange(sizes.log_prior.size), scales.size))
    variance = np.repeat(scales**2, grid.log_prior.size // scales.size)
    weight = np.array([noise.log_weight for noise, _ in blocks.noises])
    weight = weight - np.logaddexp.reduce(weight) - np.log(scales.size)
    positive = np.array([rates] * d + [False, False])
    parts = []
    for (noise, covariance), log_weight in zip(blocks.noises, weight, strict=True):
        # The constant part of the floor after the decay is in the mean; its error is a score.
        floor = 0.5 * noise.constant * np.exp(-2.0 * motion.y)
        unsure = noise.constant_sd / noise.constant if noise.constant > 0 else 0.0
        white, log_det = whiten(
            covariance, [columns[:, : d + 1], unsure * floor, columns[:, d + 1 :], residual - floor]
        )
        part = normals_of(condense(white[:, :-1], white[:, -1], positive), grid, variance, n)
        parts.append(replace(part, log=part.log + log_weight - log_det))
    every = Normals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Normals)))
    times = len(blocks.noises)
    return motion, FitPosteriors(every, np.tile(grid.size_g, times), np.tile(grid.log_prior, times), positive)
