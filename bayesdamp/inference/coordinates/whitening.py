"""Coordinates in which a posterior is round: its curved ridge is straightened, and it is whitened.

A shear straightens the ridge of the motion's parameters, and a map makes the posterior of correlated noise's normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates.truncated_normal import TruncatedNormal, truncated_moments
from bayesdamp.inference.mode import Mode, maximise
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.numerics.levenberg_marquardt import Maximum
from bayesdamp.types import Refusal

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

FIRST_STEP = 0.5
"""First step along the ridge of tied parameters of the noise, in posterior sds at the mode."""
SMALL_FALL, LARGE_FALL = 0.4, 1.5
"""Changes of the log density, in nats, below which steps grow and above which they shrink."""
GROWTH = 1.6
"""Factor by which steps grow and shrink."""
DEEPEST = 16.0
"""Fall of the log density, in nats, at which the ridge ends: about 5.6 sds of a normal distribution."""
MOST_STEPS = 60
"""Largest number of steps to each side."""
FEWEST = 4
"""Smallest number of steps in all for which the map is not the identity."""
PARTS = 8
"""Parts of each step on which the log density is interpolated."""
WIDEST = 4.5
"""Normal score up to which the noise's map is tabulated; beyond, it is a straight line."""
FAR = 1000.0
"""Normal score at which the straight lines end."""
NEWTON_STEPS = 6
"""Steps of Newton's method that invert the map; it starts so close that four are enough."""
WIDE = 2
"""Number of scores along which a ridge may run."""
REACH = 1.5
"""Distance from the mode, in posterior sds, at which the ridge is measured."""
VISIBLE = 0.02
"""Distance of the ridge from its tangent at one sd, in whitened units, from which it is worth straightening."""
H = 0.3
"""Step of second differences in whitened units: they reach 0.6 sds from the centre, and the mean of a truncated
distribution is an sd or more from the wall."""
FLATTEST = 0.1
"""Smallest curvature that is believed, in units of the Gauss–Newton one."""


@dataclass(frozen=True)
class NoiseMap:
    """Scores of the noise as functions of level ones: the second of two tied parameters, and a shift of the first.

    The level score of the second parameter has a standard normal posterior, whatever the shape of that parameter's own
    posterior: it may be skew, with a steep wall on one side and the prior's tail on the other, as the correlation time
    of noise is that is not correlated. The first parameter is shifted along the ridge, its most probable value given
    the second. All other scores are level ones.

    Attributes
    ----------
    first, second : int
        Indices of the parameters.
    table : PPoly or None
        Score of the second and shift of the first, as functions of the second's level score; None for the identity.
    """

    first: int = 0
    second: int = 0
    table: PPoly | None = None

    @classmethod
    def of(cls, target: Target, mode: Mode) -> NoiseMap:
        """Return the map of the target's noise; the identity without tied parameters that are both inferred."""
        tied = NOISES.get(target.noise).tied
        if tied is None or not set(tied) <= set(target.names) or mode.linear is not None:
            return cls()
        first, second = map(target.names.index, tied)
        if target.reflected[first] or target.reflected[second]:
            return cls()
        scores, heights, firsts = _profile(target, mode, first, second)
        if scores.size <= FEWEST:
            return cls()
        fine = np.append(
            (scores[:-1, None] + np.diff(scores)[:, None] * np.arange(PARTS) / PARTS).ravel(), scores[-1]
        )
        heights = scipy.interpolate.Akima1DInterpolator(scores, heights)(fine)
        density = np.exp(heights - np.max(heights))
        parts = 0.5 * (density[1:] + density[:-1]) * np.diff(fine)
        # The normal score of the cumulative probability. Each half is computed from its own end, so that no digits are
        # lost in the tails. Both ends are infinite.
        below = np.append(0.0, np.cumsum(parts)) / parts.sum()
        above = np.append(np.cumsum(parts[::-1])[::-1], 0.0) / parts.sum()
        level = np.where(
            below < above,
            scipy.special.ndtri(np.minimum(below, 0.5)),
            -scipy.special.ndtri(np.minimum(above, 0.5)),
        )
        inside = np.abs(level) < WIDEST
        shift = scipy.interpolate.Akima1DInterpolator(scores, firsts)(fine) - mode.z[first]
        level, values = level[inside], np.stack([fine, shift], axis=1)[inside]
        # Monotone between the points, and along straight lines beyond them.
        low = values[0] - (values[1] - values[0]) / (level[1] - level[0]) * (level[0] + FAR)
        high = values[-1] + (values[-1] - values[-2]) / (level[-1] - level[-2]) * (FAR - level[-1])
        level, values = np.concatenate([[-FAR], level, [FAR]]), np.concatenate([[low], values, [high]])
        return cls(first, second, scipy.interpolate.PchipInterpolator(level, values))

    def scores(self, level: np.ndarray) -> np.ndarray:
        """Return the scores of level ones, both (..., d)."""
        if self.table is None:
            return level
        scores, values = level.copy(), self.table(level[..., self.second])
        scores[..., self.first] += values[..., 1]
        scores[..., self.second] = values[..., 0]
        return scores

    def level(self, scores: np.ndarray) -> np.ndarray:
        """Return the level scores of scores, both (..., d)."""
        if self.table is None:
            return scores
        level, own = scores.copy(), scores[..., self.second]
        cell = np.clip(np.searchsorted(self._knots, own, side="right") - 1, 0, self._knots.size - 2)
        low, high = self.table.x[cell], self.table.x[cell + 1]
        v = np.interp(own, self._knots, self.table.x)
        for _ in range(NEWTON_STEPS):
            v = np.clip(v - (self.table(v)[..., 0] - own) / self._rate(v)[..., 0], low, high)
        level[..., self.second] = v
        level[..., self.first] -= self.table(v)[..., 1]
        return level

    def slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of the scores by the level ones, (..., d, d), at level scores (..., d)."""
        slope = np.zeros((*level.shape, level.shape[-1])) + np.eye(level.shape[-1])
        if self.table is not None:
            rate = self._rate(level[..., self.second])
            slope[..., self.second, self.second] = rate[..., 0]
            slope[..., self.first, self.second] = rate[..., 1]
        return slope

    def log_volume(self, level: np.ndarray) -> np.ndarray:
        """Return the log of the determinant of `slope`, (...), at level scores (..., d)."""
        if self.table is None:
            return np.zeros(level.shape[:-1])
        return np.log(self._rate(level[..., self.second])[..., 0])

    def volume_slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of `log_volume`, (d,), at level scores (d,)."""
        slope = np.zeros(level.size)
        if self.table is not None:
            own = level[self.second]
            slope[self.second] = self._bend(own)[0] / self._rate(own)[0]
        return slope

    @cached_property
    def _knots(self) -> np.ndarray:
        """Scores of the second parameter at the knots."""
        assert self.table is not None
        return self.table(self.table.x)[:, 0]

    @cached_property
    def _rate(self) -> PPoly:
        assert self.table is not None
        return self.table.derivative()

    @cached_property
    def _bend(self) -> PPoly:
        return self._rate.derivative()


def ridge_point(mode: Mode, reflected: np.ndarray, z: np.ndarray, others: np.ndarray) -> Maximum:
    """Maximise the log posterior over some scores from z, (d,), with the rest fixed.

    Parameters
    ----------
    mode : Mode
        Of the posterior.
    reflected : ndarray of bool, shape (d,)
        Which scores end at zero.
    z : ndarray, shape (d,)
        Start.
    others : ndarray of int, shape (k,)
        The scores that vary.

    Raises
    ------
    Refusal
        Where the posterior is not finite there.
    """

    def at(inner: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        whole = z.copy()
        whole[others] = inner
        value, gradient, information = mode.near.curvature(whole)
        return value, gradient[others], information[np.ix_(others, others)]

    top = maximise(at, reflected[others], z[others], limit=20)
    if not np.isfinite(top.value):
        raise Refusal("the ridge ends")
    return top


def _profile(
    target: Target, mode: Mode, first: int, second: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return scores of the second parameter, their marginal log density, and the first's score there, (m,) each.

    The marginal is Laplace's: the height of the ridge and the volume of the other scores about it.
    """
    others = np.setdiff1d(np.arange(mode.z.size), [second])
    place = int(np.searchsorted(others, first))

    def at(score: float, inner: np.ndarray) -> tuple[float, np.ndarray]:
        z = np.insert(inner, second, score)
        top = ridge_point(mode, target.reflected, z, others)
        return top.value - 0.5 * float(np.linalg.slogdet(top.information)[1]), top.x

    sides = []
    try:
        centre = (float(mode.z[second]), *at(float(mode.z[second]), mode.z[others]))
    except Refusal:
        return np.empty(0), np.empty(0), np.empty(0)
    highest = centre[1]
    for way in (-1.0, 1.0):
        (score, height, inner), side = centre, []
        step = FIRST_STEP * float(mode.sd()[second])
        for _ in range(MOST_STEPS):
            if height < highest - DEEPEST:
                break
            try:
                next_height, next_inner = at(score + way * step, inner)
            except Refusal:
                break
            change = abs(next_height - height)
            if change > 2 * LARGE_FALL:
                step /= GROWTH**2
                continue
            score, height, inner = score + way * step, next_height, next_inner
            side.append((score, height, inner))
            highest = max(highest, height)
            step *= GROWTH if change < SMALL_FALL else 1 / GROWTH if change > LARGE_FALL else 1.0
        sides.append(side)
    points = [*sides[0][::-1], centre, *sides[1]]
    return (
        np.array([p[0] for p in points]),
        np.array([p[1] for p in points]),
        np.array([p[2][place] for p in points]),
    )


@dataclass(frozen=True)
class Shear:
    """A shear whose Jacobian is one, and a map of the noise's parameters, which mirror images share.

    Level scores are `straight` ones plus a quadratic form of their wide components; the noise's map makes scores of
    them. The quadratic form changes neither the wide nor the reflected scores.

    Attributes
    ----------
    centre : ndarray, shape (d,)
        Where the form is flat.
    wide : ndarray of int, shape (k,)
        Indices of the wide scores.
    curve : ndarray, shape (d, k, k)
        The quadratic form, zero for the wide and the reflected scores.
    noise : NoiseMap
        The map of the noise's parameters.

    References
    ----------
    The twisted normal of Haario, Saksman and Tamminen, 1999; a coupling of Dinh, 2014.
    """

    centre: np.ndarray
    wide: np.ndarray
    curve: np.ndarray
    noise: NoiseMap

    @classmethod
    def none(cls, d: int) -> Shear:
        """Return the identity."""
        wide = np.arange(min(WIDE, d))
        return cls(np.zeros(d), wide, np.zeros((d, wide.size, wide.size)), NoiseMap())

    @classmethod
    def of_noise(cls, target: Target, mode: Mode) -> Shear:
        """Return the map of the noise alone."""
        return replace(cls.none(mode.z.size), noise=NoiseMap.of(target, mode))

    def scores(self, straight: np.ndarray) -> np.ndarray:
        """Return the scores of straightened ones, both (..., d)."""
        return self.noise.scores(self.level(straight))

    def level(self, straight: np.ndarray) -> np.ndarray:
        """Return the scores of straightened ones before the map of the noise, both (..., d)."""
        return straight + self._shift(straight) if self._curved else straight

    def straight(self, scores: np.ndarray) -> np.ndarray:
        """Return straightened scores, both (..., d)."""
        level = self.noise.level(scores)
        return level - self._shift(level) if self._curved else level

    def slope(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of the scores by the straightened ones, (d, d), at one point (d,)."""
        return self.noise.slope(self.level(straight)) @ (np.eye(straight.size) + self._bending(straight))

    def log_volume(self, straight: np.ndarray) -> np.ndarray:
        """Return the log of the determinant of the scores' derivatives, (...), at straightened scores (..., d)."""
        return self.noise.log_volume(self.level(straight))

    def volume_slope(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of `log_volume`, (d,), at one point (d,)."""
        slope = self.noise.volume_slope(self.level(straight))
        return slope + slope @ self._bending(straight)

    def _bending(self, straight: np.ndarray) -> np.ndarray:
        """Return the derivatives of the quadratic form, (d, d), at one point (d,)."""
        bending = np.zeros((straight.size, straight.size))
        bending[:, self.wide] = self.curve @ (straight - self.centre)[self.wide]
        return bending

    @cached_property
    def _curved(self) -> bool:
        """Whether any score is moved at all."""
        return bool(np.any(self.curve))

    def _shift(self, z: np.ndarray) -> np.ndarray:
        away = z[..., self.wide] - self.centre[self.wide]
        both = away[..., :, None] * away[..., None, :]
        size = self.wide.shape[0] ** 2
        return 0.5 * both.reshape(*both.shape[:-2], size) @ self.curve.reshape(-1, size).T


def shear_of(target: Target, mode: Mode) -> Shear | None:
    """Return the shear that straightens a posterior's ridge; None where the ridge is straight.

    The ridge is the line of highest posterior at given wide scores, those that determine each other least. Its second
    differences are taken at `REACH` posterior sds. A product of two parameters of which the data determine only one
    direction has such a ridge, as gravity and spring of the horizontal pendulum do.
    """
    reflected, d = target.reflected, mode.z.size
    covariance = mode.factor @ mode.factor.T
    moving = [n in target.oscillator.parameters for n in target.names]
    among, left = np.flatnonzero(~reflected & moving), covariance.copy()
    widest: list[int] = []  # the scores with the largest sds, each given the ones before it
    for _ in range(min(WIDE, among.size)):
        i = int(among[int(np.argmax(np.diag(left)[among]))])
        if left[i, i] <= 1e-12:
            break
        widest.append(i)
        left = left - np.outer(left[:, i], left[:, i]) / left[i, i]
    wide = np.array(widest, int)
    others = np.setdiff1d(np.arange(d), wide)
    if wide.size < min(WIDE, d) or np.all(reflected[others]):
        return None
    root = np.linalg.cholesky(covariance[np.ix_(wide, wide)])
    noise, k = NoiseMap.of(target, mode), wide.size
    curve = np.zeros((d, k, k))
    try:
        top = _ridge(target, mode, noise, wide, others, np.zeros(k))
        for a in range(k):
            for b in range(a + 1):
                step = REACH * (root[:, a] + root[:, b]) / (2 if a == b else np.sqrt(2))
                ends = [_ridge(target, mode, noise, wide, others, sign * step) for sign in (1, -1)]
                curve[others, a, b] = curve[others, b, a] = (ends[0] + ends[1] - 2 * top) / REACH**2
    except Refusal:
        return None
    curve[reflected] = 0.0
    # The difference along (e_a + e_b)/√2 is half the sum of both second derivatives plus the mixed one.
    for a in range(k):
        for b in range(a):
            mixed = curve[:, a, b] - 0.5 * (curve[:, a, a] + curve[:, b, b])
            curve[:, a, b] = curve[:, b, a] = mixed
    sheared = np.linalg.solve(mode.factor, noise.slope(noise.level(mode.z)) @ curve.reshape(d, -1))
    if 0.5 * np.max(np.abs(sheared)) < VISIBLE:
        return None
    inverse = np.linalg.inv(root)
    curve = np.einsum("jab,ac,bd->jcd", curve, inverse, inverse)
    return Shear(mode.z.copy(), wide, curve, noise)


def _ridge(
    target: Target, mode: Mode, noise: NoiseMap, wide: np.ndarray, others: np.ndarray, step: np.ndarray
) -> np.ndarray:
    """Return the level scores `others`, (d − k,), that are highest where the wide scores are moved by `step`, (k,).

    Raises Refusal where the posterior is not finite there.
    """
    information = np.linalg.inv(mode.factor @ mode.factor.T)
    inner = information[np.ix_(others, others)]
    z = mode.z.copy()
    z[wide] += step
    z[others] -= np.linalg.solve(inner, information[np.ix_(others, wide)] @ step)
    z[others] = ridge_point(mode, target.reflected, z, others).x
    return noise.level(z)[others]


@dataclass(frozen=True)
class Whitening:
    """Straightened scores are centre + factor @ u, where u has mean about 0 and covariance about the identity.

    Attributes
    ----------
    centre : ndarray, shape (d,)
        Straightened scores at u = 0.
    factor : ndarray, shape (d, d)
        As above.
    lacking : ndarray, shape (d, d)
        Curvature that the linearised motion lacks at the centre.
    good : bool
        Whether the curvature could be measured.
    shear : Shear
        Straightens scores.
    """

    centre: np.ndarray
    factor: np.ndarray
    lacking: np.ndarray
    good: bool
    shear: Shear

    def straight(self, u: np.ndarray) -> np.ndarray:
        """Return straightened scores at coordinates u, both (..., d)."""
        return self.centre + u @ self.factor.T

    def scores(self, u: np.ndarray) -> np.ndarray:
        """Return scores at coordinates u, both (..., d)."""
        return self.shear.scores(self.straight(u))

    def log_volume(self, u: np.ndarray) -> np.ndarray:
        """Return the log volume of scores per volume of straightened ones, (...), at coordinates u, (..., d)."""
        return self.shear.log_volume(self.straight(u))

    def whitened(self, z: np.ndarray) -> np.ndarray:
        """Return coordinates of scores z, both (m, d)."""
        return np.linalg.solve(self.factor, (self.shear.straight(z) - self.centre).T).T


def whitening_of(target: Target, mode: Mode, shear: Shear | None = None) -> Whitening:
    """Return the coordinates of a posterior from its mode, and the gradient and the whole curvature near it.

    Where laws may hold approximately, the posterior is a mixture that is wider than its mode. The coordinates are then
    those of the linear model's draws.

    Parameters
    ----------
    target : Target
        Whose posterior it is.
    mode : Mode
        Its mode.
    shear : Shear, optional
        Of its ridge, where that is to be straightened; by default that of its noise alone.
    """
    d = mode.z.size
    shear = Shear.of_noise(target, mode) if shear is None else shear
    if mode.linear is not None:
        level = shear.straight(mode.linear.draws)
        factor = np.linalg.cholesky(np.atleast_2d(np.cov(level.T)))
        return Whitening(level.mean(axis=0), factor, np.zeros((d, d)), True, shear)
    reflected = np.flatnonzero(target.reflected)
    at, factor = expansion(target, mode, shear)
    information = np.linalg.inv(factor @ factor.T)
    centre, factor = truncated_moments(information, slope_at(mode, shear, at), at, reflected)
    whole, linear = _curvatures(mode, centre, factor, shear)
    if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(linear))):
        return Whitening(centre, factor, np.zeros((d, d)), False, shear)
    values, vectors = np.linalg.eigh(whole)
    inverse = np.linalg.inv(factor)
    believed = inverse.T @ (vectors * np.maximum(values, FLATTEST)) @ vectors.T @ inverse
    factor = truncated_moments(believed, slope_at(mode, shear, centre), centre, reflected)[1]
    return Whitening(centre, factor, inverse.T @ (whole - linear) @ inverse, True, shear)


def expansion(target: Target, mode: Mode, shear: Shear) -> tuple[np.ndarray, np.ndarray]:
    """Return a normal approximation of a posterior in straightened scores: a centre, (d,), and a factor, (d, d).

    It is that of the mode, apart from the score that the noise's map makes standard normal.
    """
    at = shear.straight(np.where(target.reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z))
    if shear.noise.table is None:
        return at, mode.factor
    second, rest = shear.noise.second, np.delete(np.arange(at.size), shear.noise.second)
    factor = np.eye(at.size)
    root = np.linalg.qr(np.linalg.solve(shear.slope(at), mode.factor)[rest].T)[1]
    factor[np.ix_(rest, rest)] = (root * np.sign(np.diag(root))[:, None]).T
    at[second] = 0.0
    return at, factor


def slope_at(mode: Mode, shear: Shear, at: np.ndarray) -> np.ndarray:
    """Return the gradient of the log density of straightened scores at one point, both (d,)."""
    return mode.near.gradient(shear.scores(at))[1] @ shear.slope(at) + shear.volume_slope(at)


def truncated_about(target: Target, mode: Mode, shear: Shear) -> TruncatedNormal:
    """Return that approximation with the gradient of the log posterior, which ends where a reflected score is zero."""
    at, factor = expansion(target, mode, shear)
    covariance = factor @ factor.T
    return TruncatedNormal(at + covariance @ slope_at(mode, shear, at), covariance, target.reflected)


def whitening_under(mode: Mode, combination: int, shear: Shear) -> Whitening:
    """Return the coordinates of a posterior given a combination of hyperparameters of its deviations.

    They are those of the truncated normal about the mode.
    """
    reflected, d = mode.likelihood.target.reflected, mode.z.size
    at = np.where(reflected, np.maximum(np.abs(mode.z), 1e-12), mode.z)
    _, gradient, information = mode.near.under(combination).curvature(at)
    centre, factor = truncated_moments(information, gradient, at, np.flatnonzero(reflected))
    return Whitening(shear.straight(centre), factor, np.zeros((d, d)), True, shear)


def _curvatures(
    mode: Mode, at: np.ndarray, factor: np.ndarray, shear: Shear
) -> tuple[np.ndarray, np.ndarray]:
    """Return −∂² of the log posterior and of that with the motion linearised, in units of factor, both (d, d)."""
    d = at.size
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    corners = np.array(
        [[a * np.eye(d)[i] + b * np.eye(d)[j] for a in (1, -1) for b in (1, -1)] for i, j in pairs]
    )
    away = H * corners.reshape(-1, d) @ factor.T
    line = mode.near.line(shear.scores(at))

    def hessian(values: np.ndarray) -> np.ndarray:
        f = values.reshape(-1, 4)
        curvature = np.zeros((d, d))
        for (i, j), v in zip(pairs, -(f[:, 0] - f[:, 1] - f[:, 2] + f[:, 3]) / (4 * H * H), strict=True):
            curvature[i, j] = curvature[j, i] = v
        return curvature

    volume = shear.log_volume(at + away)
    whole = hessian([mode.near.log_posterior(z) for z in shear.scores(at + away)] + volume)
    level = shear.level(at) + away
    along = [mode.near.log_posterior_along(line, z) for z in shear.noise.scores(level)]
    return whole, hessian(along + shear.noise.log_volume(level))
