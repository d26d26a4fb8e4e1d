"""One damping sum (or a power law) on a record: its fit, and its evidence with the deviation integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtr

from bayesdamp.envelope.model.deviation import KNOTS, warp_integrals
from bayesdamp.envelope.model.floor import SeenFloor
from bayesdamp.envelope.model.law import Law
from bayesdamp.envelope.model.laws import RESTED, power_decay
from bayesdamp.envelope.model.noise import Noise, whiten
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
from bayesdamp.inference.deviation.numbers.draws import scores_of
from bayesdamp.priors import SCORE_RATIO, SHARED_SCALES, shared_log_density

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
STEPS = 25


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
        return self.about.under_priors(self.about.size == 0.0)

    def draws(self, exact: bool, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw rates in 1/s, (n, d), and the deviation at the knots, (n, KNOTS)."""
        u = scores_of(self.exact if exact else self.weighed, self.about.positive, count, rng)
        return self.unit * u[:, : len(self.terms)], u[:, -KNOTS:]

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


def fit_rates(
    blocks: Blocks, law: Law, triangle_inverse: np.ndarray, begin: np.ndarray | None = None
) -> tuple[float, np.ndarray, float]:
    """(ln A at the start, rates ≥ 0) of a sum at the mode, the noise being white after triangle_inverse (n, n), and the
    squares that are left there."""
    scale, terms = HOLD * blocks.mean_rate, law.terms
    rates = np.full(len(terms), blocks.mean_rate / len(terms)) if begin is None else begin.copy()
    x0 = float(blocks.x[: max(1, blocks.x.size // 20)].mean())

    def cost(x0: float, rates: np.ndarray) -> tuple[float, np.ndarray]:
        r = triangle_inverse @ (blocks.x - law.decay(blocks.t, x0, rates))
        return float(r @ r + np.sum((rates / scale) ** 2)), r

    rates = _sane(blocks, law, rates, x0)
    value, r = cost(x0, rates)
    for _ in range(STEPS):
        h0, h = derivatives(blocks, law, x0, rates)
        a0, a = triangle_inverse @ h0, triangle_inverse @ h
        unit = a0 / np.sqrt(a0 @ a0)
        left = np.vstack([a - np.outer(unit, unit @ a), np.eye(len(terms)) / scale])
        goal = r + a @ rates
        right = np.concatenate([goal - unit * (unit @ goal), np.zeros(len(terms))])
        norms = np.linalg.norm(left, axis=0)
        new = nnls(left / norms, right)[0] / norms
        if new.sum() < 0.3 * rates.sum():  # a line is no guide that far
            new = np.maximum(new, 0.3 * rates)
        move = new - rates
        shift = float(a0 @ (r - a @ move)) / float(a0 @ a0)
        share = 1.0
        while share > 1e-4:
            trial = cost(x0 + share * shift, rates + share * move)
            if trial[0] < value:
                break
            share *= 0.4
        else:
            break
        x0, rates = x0 + share * shift, rates + share * move
        done = value - trial[0] < 1e-6 * (1.0 + value)
        value, r = trial
        if done:
            break
    return x0, rates, float(r @ r)


def _sane(blocks: Blocks, law: Law, rates: np.ndarray, x0: float) -> np.ndarray:
    """Rates that leave the amplitude moving until the end of the record."""
    for _ in range(40):
        if law.decay(blocks.t[-1:], x0, rates)[0] > blocks.x.min() - 1.0:
            break
        rates = 0.7 * rates
    return rates


def speed(law: Law, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """-dx/dt in 1/s at x, (n,): 0 where it has come to rest."""
    return np.where(x > RESTED, law.rate(x, rates), 0.0)


def derivatives(blocks: Blocks, law: Law, x0: float, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of x by x0, shape (n,), and by the rates, shape (n, d)."""
    x = law.decay(blocks.t, x0, rates)
    whole = speed(law, x, rates)
    at_start = float(law.rate(np.array([x0]), rates)[0])
    return whole / max(at_start, 1e-300), law.slopes(blocks.t, x, x0, rates, 1e-4 * blocks.mean_rate)


def warp_columns(blocks: Blocks, speed: np.ndarray) -> np.ndarray:
    """Derivatives of x by the deviation's knots, shape (n, KNOTS); speed: -dx/dt at the blocks."""
    return -speed[:, None] * warp_integrals(blocks.t / blocks.duration, KNOTS) * blocks.duration


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
    x0, rates = fit_rates(blocks, law, inverse, begin)[:2] if fitted is None else (fitted.x0, fitted.rates)
    fit = law.decay(blocks.t, x0, rates)
    h0, h = derivatives(blocks, law, x0, rates)
    warp = warp_columns(blocks, speed(law, fit, rates))
    unit = SCORE_RATIO * blocks.omega
    about = _about(blocks.x - fit + h @ rates, h * unit, True, h0, fit, warp, noises)
    return Candidate(law, x0, rates, fit, about, about.under_priors(), unit, scores, log_share)


def weigh_power(
    blocks: Blocks, noises: Sequence[tuple[Noise, np.ndarray]], inverse: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(log evidence, mean, variance) of the exponent p of dA/dt = -c A^p over the grid of hyperparameters, shape (b,).

    p is uniform on 0 to POWER_MOST; c, the rate at the reference amplitude, has the prior of a single term's.
    """
    x0, values = float(blocks.x[0]), np.array([np.log(blocks.mean_rate), 1.0])

    def model(x0: float, values: np.ndarray) -> np.ndarray:
        return power_decay(blocks.t, x0, values[0], values[1])

    def columns(x0: float, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h = 1e-4
        found = [
            (model(x0 + h * e[0], values + h * e[1:]) - model(x0 - h * e[0], values - h * e[1:])) / (2 * h)
            for e in np.eye(3)
        ]
        return found[0], np.stack(found[1:], axis=1)

    r = inverse @ (blocks.x - model(x0, values))
    value = r @ r
    for _ in range(STEPS):
        h0, h = columns(x0, values)
        move = np.linalg.lstsq(inverse @ np.column_stack([h0, h]), r, rcond=None)[0]
        share = 1.0
        while share > 1e-4:
            trial = values + share * move[1:]
            trial[1] = np.clip(trial[1], 0.0, POWER_MOST)
            new = inverse @ (blocks.x - model(x0 + share * move[0], trial))
            if new @ new < value:
                break
            share *= 0.4
        else:
            break
        x0, values, r = x0 + share * move[0], trial, new
        done = value - r @ r < 1e-6 * (1.0 + value)
        value = r @ r
        if done:
            break
    fit = model(x0, values)
    h0, h = columns(x0, values)
    warp = warp_columns(blocks, np.exp(values[0] + (values[1] - 1.0) * fit))
    # Wide normals stand for the priors of ln c and p, whose heights are put right below.
    found = _about(blocks.x - fit, h * START_SD, False, h0, fit, warp, noises).normals
    power = START_SD * found.means[:, 1] + values[1]
    sd = START_SD * np.linalg.norm(found.factors[:, 1], axis=1)
    score = np.exp(values[0]) / (SCORE_RATIO * blocks.omega)
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
    y: np.ndarray,
    law: np.ndarray,
    rates: bool,
    h0: np.ndarray,
    fit: np.ndarray,
    warp: np.ndarray,
    noises: Sequence[tuple[Noise, np.ndarray]],
) -> About:
    """The posteriors of a linear model of y, (n,).

    law: columns by the law's scores, (n, d); rates: whether these are rates of damping; h0, warp: by the start and by
    the deviation at the knots; fit: ln(A/A_ref), (n,).
    """
    n, d = law.shape
    scales = SCALES if n < MANY else SCALES_MANY
    grid = _grid(scales.size)
    variance = np.repeat(scales**2, grid.log_prior.size // scales.size)
    weight = np.array([noise.log_weight for noise, _ in noises])
    weight = weight - np.logaddexp.reduce(weight) - np.log(scales.size)
    floors = [0.5 * noise.constant * np.exp(-2.0 * fit) for noise, _ in noises]
    sure = [noise.constant_sd / noise.constant if noise.constant > 0 else 0.0 for noise, _ in noises]
    positive = np.array([rates] * d + [False, False])
    parts = []
    for (_, covariance), log_weight, floor, unsure in zip(noises, weight, floors, sure, strict=True):
        # The floor's constant part, as seen behind the decay, is in the mean; its error is a score.
        white, log_det = whiten(covariance, [law, START_SD * h0, unsure * floor, warp, y - floor])
        one = normals(condensed(white[:, :-1], white[:, -1], positive), grid, variance, n)
        parts.append(replace(one, log=one.log + log_weight - log_det))
    every = Normals(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Normals)))
    times = len(noises)
    return About(every, np.tile(grid.size_g, times), np.tile(grid.log_prior, times), positive)


@cache
def _grid(times: int) -> Grid:
    """Sizes and lengths of the deviation, so many times."""
    grid = grid_of(KNOTS, phases=False)
    return Grid(*(np.concatenate([getattr(grid, f.name)] * times) for f in fields(Grid)))
