"""One damping sum (or a power law) on a record: its fit, and its evidence with the deviation integrated out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property

import numpy as np
from scipy.special import ndtr

from bayesdamp.inference.deviation.gaussian.hyperparameters import Grid, grid_of
from bayesdamp.inference.deviation.gaussian.linear import (
    DampingLikelihood,
    Normals,
    Weighed,
    condensed,
    damping_likelihood,
    normals,
    with_priors,
)
from bayesdamp.inference.deviation.least_squares import Fit, fit
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.envelope.noise import Noise, whiten
from bayesdamp.physics.amplitude.laws import AmplitudeSolver, Law, PowerLaw
from bayesdamp.physics.kernel.solve import ALL, Motion
from bayesdamp.priors import (
    SCORE_RATIO,
    SHARED_SCALES,
    Normal,
    Prior,
    SharedHalfNormal,
    shared_log_density,
)
from bayesdamp.records.envelope.decay import SeenFloor

KNOTS = 14
"""At which the deviation is given."""
HOLD = 30.0
"""Rates are held to 0 within so many times the record's own mean rate while a fit is sought: it only keeps the fit
well-conditioned where two terms lose nearly alike, and is no part of the evidence."""
START_SD = 100.0
"""Of ln A at the start: wide, and the same in all sums."""
SCALES, SCALES_MANY = (
    np.exp(np.array([-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9, 1.3])),
    np.exp(np.array([-0.25, 0.0, 0.25])),
)
"""Factors by which the noise may be other than inferred: few readings do not know it well, MANY do."""
MANY = 40
POWER_MOST = 3.0
SEEN = 1e-3
"""Weight, of the largest, from which a combination of hyperparameters counts for the curve in a picture."""
IMPROBABLE = 0.1
"""Probability of a law that holds exactly below which what counts among all may lack a part of it."""


@dataclass(frozen=True)
class Blocks:
    """A free decay: t in s from its start, x = ln(A/A_ref) (means over runs of readings), shape (n,).

    duration in s; mean_rate in 1/s; floor: as seen behind the decay, in units of A_ref², None where none is;
    each: readings that are averaged to one; frequency: of the oscillation in rad/s, None where it is not known.
    """

    t: np.ndarray
    x: np.ndarray
    duration: float
    mean_rate: float
    floor: SeenFloor | None = None
    each: float = 1.0
    frequency: float | None = None

    @property
    def omega(self) -> float:
        """Rate in 1/s at a damping ratio of 1, in which the scales of the rates' prior are.

        Where the frequency is not known, it is such that the middle of the scales is one over the duration: the record
        is then taken for one of a middle damping ratio, and no result depends on the unit of time.
        """
        if self.frequency is not None:
            return self.frequency
        return 1.0 / (self.duration * float(np.sqrt(SHARED_SCALES[0] * SHARED_SCALES[-1])))

    @property
    def ends(self) -> tuple[float, float]:
        """x at the start and at the end, means of a thirtieth of the readings."""
        edge = max(1, self.x.size // 30)
        return float(self.x[:edge].mean()), float(self.x[-edge:].mean())


@dataclass(frozen=True)
class Candidate:
    """A sum on a record, with its posterior over hyperparameters and scales of the prior.

    Attributes
    ----------
    law
        The sum.
    x0, rates, fit
        The fit: ln(A/A_ref) at the start, rates in 1/s at the reference amplitude, (d,), and ln(A/A_ref), (n,).
    about
        The posterior of the model that is linear about the fit.
    weighed
        The same under half-normal priors of the rates.
    unit
        Rate in 1/s at a score of 1.
    scores
        Of the terms' further parameters, at one point of their posterior.
    log_share
        Share of that point in the sum, nats.
    """

    law: Law
    x0: float
    rates: np.ndarray
    fit: np.ndarray
    about: About
    weighed: Weighed
    unit: float
    scores: tuple[float, ...] = ()
    log_share: float = 0.0

    @cached_property
    def exact(self) -> Weighed:
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

        To first order about the fit, as the evidence has it, before rates are cut off at zero.
        """
        d, at = self.rates.size, np.append(self.rates, self.x0)
        motion = solver_of(blocks, self.law).solve(at, tangents=ALL)
        units = [*[self.unit] * d, START_SD, 0.0, *[1.0] * KNOTS]  # the floor's error moves no amplitude
        columns = np.insert(motion.tangents, d + 1, 0.0, axis=1) * units
        taken = np.flatnonzero(self.weighed.weights > SEEN * self.weighed.weights.max())
        means, factors = self.weighed.posteriors(taken)
        weights = self.weighed.weights[taken] / self.weighed.weights[taken].sum()
        curves = motion.y - motion.tangents[:, :d] @ self.rates + means @ columns.T
        mean = weights @ curves
        variance = weights @ ((curves - mean) ** 2 + np.sum((columns @ factors) ** 2, axis=2))
        return mean, np.sqrt(variance)

    @property
    def likelihood(self) -> DampingLikelihood:
        """Of the rates' scores alone, under each combination."""
        return damping_likelihood(self.about.normals, np.arange(len(self.terms)), self.about.log_sizes)

    @property
    def terms(self) -> tuple[str, ...]:
        """Of the sum."""
        return self.law.terms

    @property
    def name(self) -> str:
        """Of the sum."""
        return "+".join(self.law.terms)

    @property
    def total(self) -> float:
        """Log evidence over the whole grid."""
        return self.weighed.log_evidence

    @property
    def total_exact(self) -> float:
        """Log evidence, times its prior probability, of the law that holds exactly."""
        return self.exact.log_evidence


def solver_of(blocks: Blocks, law: Law, white: np.ndarray | None = None) -> AmplitudeSolver:
    """Decays at the blocks under a law; white: what their noise is white after, (n, n)."""
    return AmplitudeSolver(law, blocks.t, blocks.duration, KNOTS, 1e-4 * blocks.mean_rate, white)


def fit_rates(blocks: Blocks, law: Law, white: np.ndarray, begin: np.ndarray | None = None) -> Fit:
    """Fit a sum's rates, none of them negative, and ln A at the start, from rates of its own or from `begin`."""
    rates = np.full(len(law.terms), blocks.mean_rate / len(law.terms)) if begin is None else begin
    held = SharedHalfNormal(per_ratio=HOLD * blocks.mean_rate / SCORE_RATIO)
    return _fitted(blocks, law, white, dict.fromkeys(law.terms, held), _moving(blocks, law, rates))


def _moving(blocks: Blocks, law: Law, rates: np.ndarray) -> np.ndarray:
    """Rates that leave the amplitude moving until the end of the record."""
    x0 = float(blocks.x[: max(1, blocks.x.size // 20)].mean())
    for _ in range(40):
        if law.decay(blocks.t[-1:], x0, rates)[0] > blocks.x.min() - 1.0:
            break
        rates = 0.7 * rates
    return rates


def _fitted(
    blocks: Blocks, law: Law, white: np.ndarray, priors: Mapping[str, Prior], begin: np.ndarray
) -> Fit:
    x0 = float(blocks.x[: max(1, blocks.x.size // 20)].mean())
    names = (*law.terms, "start")
    parameters = Parameters(names, {**priors, "start": Normal(mean=0.0, sd=START_SD)}, {})
    z = parameters.scores(dict(zip(names, map(float, (*begin, x0)), strict=True)))
    solver, every = solver_of(blocks, law, white), np.ones(len(names), bool)
    found = fit(solver, parameters, every, white @ blocks.x, z, noise=1.0, windows=False, integrated=False)
    assert found is not None  # no decay escapes
    return found


def weigh(
    blocks: Blocks,
    law: Law,
    noises: Sequence[tuple[Noise, np.ndarray]],
    inverse: np.ndarray,
    fitted: Candidate | None = None,
    scores: tuple[float, ...] = (),
    log_share: float = 0.0,
    begin: np.ndarray | None = None,
) -> Candidate:
    """A sum's evidence and posterior over the grid of hyperparameters.

    noises: each with the covariance of the readings; inverse: of the triangle in which the fit is sought; fitted: the
    same sum with another noise, whose fit is taken; begin: rates from which else the fit is sought.
    """
    p = (
        fit_rates(blocks, law, inverse, begin).values
        if fitted is None
        else np.append(fitted.rates, fitted.x0)
    )
    unit = SCORE_RATIO * blocks.omega
    motion, about = _about(blocks, law, p, np.full(len(law.terms), unit), True, noises)
    return Candidate(
        law, float(p[-1]), p[:-1], motion.y, about, about.under_priors(), unit, scores, log_share
    )


def weigh_power(
    blocks: Blocks, noises: Sequence[tuple[Noise, np.ndarray]], inverse: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(log evidence, mean, variance) of the exponent p of dA/dt = -c A^p over the grid of hyperparameters, shape (b,).

    p is uniform on 0 to POWER_MOST; c, the rate at the reference amplitude, has the prior of a single term's.
    """
    begin, wide = np.array([np.log(blocks.mean_rate), 1.0]), Normal(mean=0.0, sd=START_SD)
    p = _fitted(blocks, PowerLaw(), inverse, {"log_rate": wide, "exponent": wide}, begin).values
    # Wide normals stand for the priors of ln c and p, whose heights are put right below.
    found = _about(blocks, PowerLaw(), p, np.full(2, START_SD), False, noises)[1].normals
    power, sd = START_SD * found.means[:, 1], START_SD * np.linalg.norm(found.factors[:, 1], axis=1)
    score = np.exp(p[0]) / (SCORE_RATIO * blocks.omega)
    density = float(shared_log_density(score**2, 1) + np.log(score))  # of ln c
    log_z = found.log + density - np.log(POWER_MOST) + np.log(2 * np.pi * START_SD**2)
    inside = ndtr((POWER_MOST - power) / sd) - ndtr(-power / sd)
    return log_z + np.log(np.maximum(inside, 1e-300)), power, sd**2


@dataclass(frozen=True)
class About:
    """Normal posteriors about a fit under each of c combinations of a noise, its scale, and the deviation's size and
    length, the last running fastest: of scores of the law, start and floor with priors N(0, 1), and of the deviation.

    Attributes
    ----------
    normals
        The posteriors, their logarithms with the prior probability of the combination.
    size
        Of the deviation, (c,).
    log_sizes
        Log prior probability of its size and length, (c,).
    positive
        Which scores are rates of damping, (d,).
    """

    normals: Normals
    size: np.ndarray
    log_sizes: np.ndarray
    positive: np.ndarray

    def under_priors(self, which: np.ndarray | None = None) -> Weighed:
        """Under half-normal priors of the rates that share one unknown scale. which: of the combinations, (c,)."""
        found = self.normals
        if which is not None:
            found = Normals(found.log[which], found.means[which], found.factors[which])
        return with_priors(found, self.positive, self.positive)


def _about(
    blocks: Blocks,
    law: Law,
    p: np.ndarray,
    units: np.ndarray,
    rates: bool,
    noises: Sequence[tuple[Noise, np.ndarray]],
) -> tuple[Motion, About]:
    """The decay of a law's parameters and x at the start, p (d + 1,), and the posteriors about it.

    units: of the law's parameters at a score of 1, (d,); rates: whether they are rates of damping.
    """
    motion, n, d = solver_of(blocks, law).solve(p, tangents=ALL), blocks.t.size, units.size
    columns = motion.tangents * np.concatenate([units, [START_SD], np.ones(KNOTS)])
    residual = blocks.x - motion.y + motion.tangents[:, :d] @ p[:d]
    scales = SCALES if n < MANY else SCALES_MANY
    grid = _grid(scales.size)
    variance = np.repeat(scales**2, grid.log_prior.size // scales.size)
    weight = np.array([noise.log_weight for noise, _ in noises])
    weight = weight - np.logaddexp.reduce(weight) - np.log(scales.size)
    positive = np.array([rates] * d + [False, False])
    parts = []
    for (noise, covariance), log_weight in zip(noises, weight, strict=True):
        # The floor's constant part, as seen behind the decay, is in the mean; its error is a score.
        floor = 0.5 * noise.constant * np.exp(-2.0 * motion.y)
        unsure = noise.constant_sd / noise.constant if noise.constant > 0 else 0.0
        white, log_det = whiten(
            covariance, [columns[:, : d + 1], unsure * floor, columns[:, d + 1 :], residual - floor]
        )
        one = normals(condensed(white[:, :-1], white[:, -1], positive), grid, variance, n)
        parts.append(replace(one, log=one.log + log_weight - log_det))
    every = Normals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Normals)))
    times = len(noises)
    return motion, About(every, np.tile(grid.size_g, times), np.tile(grid.log_prior, times), positive)


@cache
def _grid(times: int) -> Grid:
    """Sizes and lengths of the deviation, so many times."""
    grid = grid_of(KNOTS, phases=False)
    return Grid(*(np.concatenate([getattr(grid, f.name)] * times) for f in fields(Grid)))
