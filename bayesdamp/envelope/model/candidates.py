"""One damping sum (or a power law) on a record: its fit, and its evidence with the deviation integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.special import ndtr

from bayesdamp.envelope.model.deviation import KNOTS, knot_precisions, warp_integrals, weights
from bayesdamp.envelope.model.floor import SeenFloor
from bayesdamp.envelope.model.law import Law
from bayesdamp.envelope.model.laws import RESTED, power_decay
from bayesdamp.envelope.model.marginal import Marginal, weigh_scales
from bayesdamp.envelope.model.noise import Noise, whiten
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
_ZERO = 1e-5
"""Stands for τ = 0."""


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
    marginal
        Likelihood of the rates under each of c combinations of noise, its scale, τ and ℓ.
    log_evidence
        Nats under each pair of a combination and a scale of the prior that counts, (m,).
    combination
        Place of each pair's combination, (m,).
    centre, spread
        Mean and covariance of the rates before these are cut off at 0, (m, d) and (m, d, d).
    scores
        Of the terms' further parameters, at one point of their posterior.
    log_share
        Share of that point in the sum, nats.
    """

    law: Law
    x0: float
    rates: np.ndarray
    fit: np.ndarray
    marginal: Marginal
    log_evidence: np.ndarray
    combination: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    scores: tuple[float, ...] = ()
    log_share: float = 0.0

    @property
    def exact(self) -> np.ndarray:
        """Whether τ is 0 in each pair, (m,)."""
        return self.marginal.tau[self.combination] == 0.0

    @property
    def log_by_combination(self) -> np.ndarray:
        """Log evidence of each combination of hyperparameters, (c,); −∞ where it was left out."""
        found = np.full(self.marginal.log.size, -np.inf)
        np.logaddexp.at(found, self.combination, self.log_evidence)
        return found

    def posterior(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and covariance of (rates, deviation) before rates are cut off at 0.

        Parameters
        ----------
        places
            Of the pairs, (k,).

        Returns
        -------
        mean, covariance
            (k, d + KNOTS) and (k, d + KNOTS, d + KNOTS).
        """
        of, known = self.combination[places], self.marginal
        gain, centre, spread = known.gain[of], self.centre[places], self.spread[places]
        deviation = known.mean[of] + (gain @ (centre - self.rates)[:, :, None])[:, :, 0]
        cross = gain @ spread
        own = known.covariance[of] + cross @ np.swapaxes(gain, 1, 2)
        above = np.concatenate([spread, np.swapaxes(cross, 1, 2)], axis=2)
        covariance = np.concatenate([above, np.concatenate([cross, own], axis=2)], axis=1)
        return np.concatenate([centre, deviation], axis=1), covariance

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
        return float(np.logaddexp.reduce(self.log_evidence))

    @property
    def total_exact(self) -> float:
        """Log evidence, times its prior probability, of the law that holds exactly."""
        return float(np.logaddexp.reduce(self.log_evidence[self.exact]))


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
    marginal = _marginal(blocks, blocks.x - fit, h0, h, fit, warp, noises)
    found = weigh_scales(marginal, rates, blocks.omega)
    spread = found.factors @ np.swapaxes(found.factors, 1, 2)
    return Candidate(
        law, x0, rates, fit, marginal, found.log_each, found.combos, found.means, spread, scores, log_share
    )


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
    found = _marginal(blocks, blocks.x - fit, h0, h, fit, warp, noises)
    # Wide normals stand for the priors of ln c and p, whose heights are put right below.
    covariance = np.linalg.inv(found.information + 1e-4 * np.eye(2))
    move = (covariance @ found.slope[:, :, None])[:, :, 0]
    log_z = found.log + 0.5 * np.sum(move * found.slope, axis=1) + 0.5 * np.linalg.slogdet(covariance)[1]
    power, variance = move[:, 1] + values[1], covariance[:, 1, 1]
    score = np.exp(values[0]) / (SCORE_RATIO * blocks.omega)
    density = float(shared_log_density(score**2, 1) + np.log(score))  # of ln c
    log_z = log_z + density - np.log(POWER_MOST) + np.log(2 * np.pi)
    sd = np.sqrt(variance)
    inside = ndtr((POWER_MOST - power) / sd) - ndtr(-power / sd)
    return log_z + np.log(np.maximum(inside, 1e-300)), power, variance


def _marginal(
    blocks: Blocks,
    residual: np.ndarray,
    h0: np.ndarray,
    h: np.ndarray,
    fit: np.ndarray,
    warp: np.ndarray,
    noises: Sequence[tuple[Noise, np.ndarray]],
) -> Marginal:
    """The likelihood of the parameters over noises, their scales, τ and ℓ.

    residual: the readings less the fit; h0, h: its derivatives by its start and by the parameters, (n,) and (n, d);
    warp: by the deviation at the knots.
    """
    parts = [_grid(blocks, residual, h0, h, fit, warp, *one) for one in noises]
    log, *rest = (np.concatenate(part) for part in zip(*parts, strict=True))
    weight = np.array([noise.log_weight for noise, _ in noises])
    weight = np.repeat(weight - np.logaddexp.reduce(weight), log.size // weight.size)
    return Marginal(log + weight, *rest)


def _grid(
    blocks: Blocks,
    residual: np.ndarray,
    h0: np.ndarray,
    h: np.ndarray,
    fit: np.ndarray,
    warp: np.ndarray,
    noise: Noise,
    covariance: np.ndarray,
) -> tuple[np.ndarray, ...]:
    """The fields of `Marginal` under one noise, over its scales, τ and ℓ."""
    tau, _, log_prior = weights()
    n, d = h.shape
    extra = [0.5 * noise.constant * np.exp(-2.0 * fit)] if noise.constant > 0 else []
    white, log_det = whiten(covariance, [h0, *extra, warp, h, residual])
    e = len(extra)
    q = 1 + e + KNOTS  # all but the parameters
    gram = white.T @ white
    places, log_dets = knot_precisions()
    width = np.where(tau > 0, tau, _ZERO)
    precision = np.zeros((tau.size, q, q))
    precision[:, 0, 0] = START_SD**-2
    mu = np.zeros(q)
    sure = (noise.constant / noise.constant_sd) ** 2 if e else 1.0
    if e:  # the constant part of the floor, as seen behind the decay
        precision[:, 1, 1] = sure
        mu[1] = 1.0
    precision[:, 1 + e :, 1 + e :] = places / width[:, None, None] ** 2
    log_det_prior = -2 * np.log(START_SD) + np.log(sure) + log_dets - 2 * KNOTS * np.log(width)
    pull = precision @ mu
    quiet = 0.5 * np.einsum("i,bi->b", mu, pull)
    every = SCALES if n < MANY else SCALES_MANY
    scales = every[:, None, None, None]
    whole = gram[:q, :q] / scales**2 + precision
    side = gram[:q, -1] / scales[..., 0] ** 2 + pull
    across = np.broadcast_to(gram[:q, q : q + d] / scales**2, (*whole.shape[:2], q, d))
    inverse = np.linalg.inv(whole)
    mean = (inverse @ side[..., None])[..., 0]
    gain = -inverse @ across
    log_det_whole = 2.0 * np.log(np.einsum("sbii->sbi", np.linalg.cholesky(whole))).sum(axis=-1)
    s = every[:, None]
    log = -n * np.log(s) - log_det - 0.5 * gram[-1, -1] / s**2 - quiet + 0.5 * log_det_prior
    log = (
        log
        - 0.5 * log_det_whole
        + 0.5 * np.einsum("sbi,sbi->sb", mean, side)
        + log_prior
        - np.log(every.size)
    )
    turned = np.swapaxes(across, 2, 3)
    slope = gram[q : q + d, -1] / scales[..., 0] ** 2 - (turned @ mean[..., None])[..., 0]
    information = gram[q : q + d, q : q + d] / scales**2 + turned @ gain
    information = 0.5 * (information + np.swapaxes(information, 2, 3))

    def flat(array: np.ndarray) -> np.ndarray:
        return array.reshape(-1, *array.shape[2:])

    knots = slice(1 + e, q)
    return (
        log.ravel(), flat(slope), flat(information), flat(mean[..., knots]), flat(gain[..., knots, :]),
        flat(inverse[..., knots, knots]), np.tile(tau, every.size),
    )  # fmt: skip
