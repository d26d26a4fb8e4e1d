"""A posterior's curved ridge, straightened without changing volumes: of the motion, and of correlated noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from bayesdamp.inference.fit.maximise import maximise
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.priors import LogNormal, LogUniform
from bayesdamp.types import Refusal


@dataclass(frozen=True)
class NoiseShear:
    """A shear of the scores, for noise of which the data determine a ratio of one parameter to a power of another.

    The scores are level ones plus, for the one parameter, what keeps that ratio as the other changes. The Jacobian is
    one, and at the mode the shear is flat. The other parameter has a log-uniform prior, whose logarithm changes with
    its score z as Φ(z) does.

    moved: size of the shear, (d,), zero except for the one parameter; along: index of the other parameter; centre: its
    score at the mode.
    """

    moved: np.ndarray
    along: int
    centre: float

    @classmethod
    def none(cls, d: int) -> NoiseShear:
        """Return the identity."""
        return cls(np.zeros(d), 0, 0.0)

    @classmethod
    def of(cls, target: Target, mode: Mode) -> NoiseShear:
        """Return the shear of the target's noise: the identity where it ties nothing, or under other priors."""
        d = mode.z.size
        tied = NOISES.get(target.noise).tied
        if tied is None or not {tied.one, tied.other} <= set(target.names):
            return cls.none(d)
        one, other = target.priors[tied.one], target.priors[tied.other]
        if not (isinstance(one, LogNormal) and isinstance(other, LogUniform)):
            return cls.none(d)
        i, j = target.names.index(tied.one), target.names.index(tied.other)
        moved = np.zeros(d)
        moved[i] = tied.power * np.log(other.high / other.low) / one.sigma
        return cls(moved, j, float(mode.z[j]))

    def sheared(self, level: np.ndarray) -> np.ndarray:
        """Return the scores of level ones, both (..., d)."""
        return level + self._height(level) * self.moved if self._any else level

    def level(self, scores: np.ndarray) -> np.ndarray:
        """Return the level scores of scores, both (..., d)."""
        return scores - self._height(scores) * self.moved if self._any else scores

    def slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of the scores by the level ones, (..., d, d), at level scores (..., d)."""
        slope = np.zeros((*level.shape, level.shape[-1])) + np.eye(level.shape[-1])
        if not self._any:
            return slope
        steepness = _density(level[..., self.along]) - _density(self.centre)
        slope[..., self.along] += steepness[..., None] * self.moved
        return slope

    @cached_property
    def _any(self) -> bool:
        """Whether any score is moved at all."""
        return bool(np.any(self.moved))

    def _height(self, z: np.ndarray) -> np.ndarray:
        there = z[..., self.along, None]
        return ndtr(there) - ndtr(self.centre) - _density(self.centre) * (there - self.centre)


def _density(z: np.ndarray | float) -> np.ndarray:
    return np.exp(-0.5 * np.square(z)) / np.sqrt(2 * np.pi)


WIDE = 2
"""Scores along which a ridge may run."""
REACH = 1.5
"""Posterior sds from the mode at which the ridge is looked up."""
SEEN = 0.02
"""Whitened units that the ridge must leave its tangent by, at one sd, to be worth straightening."""


@dataclass(frozen=True)
class Shear:
    """Scores are `straight` ones plus a quadratic form of their wide components, which itself moves neither these nor
    reflected scores, and then the shear of its noise (Haario, Saksman and Tamminen's twisted normal, 1999; a coupling
    of Dinh's, 2014): two shears, whose Jacobians are one, and which mirror images share.

    centre: (d,); wide: indices (k,); curve: (d, k, k), zero for the wide and the reflected; noise: its own shear.
    """

    centre: np.ndarray
    wide: np.ndarray
    curve: np.ndarray
    noise: NoiseShear

    @classmethod
    def none(cls, d: int) -> Shear:
        """No shear at all."""
        wide = np.arange(min(WIDE, d))
        return cls(np.zeros(d), wide, np.zeros((d, wide.size, wide.size)), NoiseShear.none(d))

    @classmethod
    def of_noise(cls, target: Target, mode: Mode) -> Shear:
        """The noise's shear alone."""
        return replace(cls.none(mode.z.size), noise=NoiseShear.of(target, mode))

    def scores(self, straight: np.ndarray) -> np.ndarray:
        """Scores of straightened ones, both (..., d)."""
        return self.noise.sheared(self.level(straight))

    def level(self, straight: np.ndarray) -> np.ndarray:
        """Scores of straightened ones, both (..., d), before the noise's shear."""
        return straight + self._shift(straight) if self._curved else straight

    def straight(self, scores: np.ndarray) -> np.ndarray:
        """Straightened scores, both (..., d)."""
        level = self.noise.level(scores)
        return level - self._shift(level) if self._curved else level

    def slope(self, straight: np.ndarray) -> np.ndarray:
        """Derivatives of the scores by the straightened ones, (d, d), at one point (d,)."""
        found = np.eye(straight.size)
        found[:, self.wide] += self.curve @ (straight - self.centre)[self.wide]
        return self.noise.slope(self.level(straight)) @ found

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
    """The bend of a posterior's ridge; None where there is none to speak of.

    The ridge is where the posterior is highest at given wide scores, those that determine each other least; its second
    differences are taken at `REACH` posterior sds. A product of two parameters, of which the data know one direction
    alone, makes such a ridge: gravity and spring of the horizontal pendulum, for one.
    """
    reflected = target.reflected
    covariance = mode.factor @ mode.factor.T
    moving = [n in target.oscillator.parameters for n in target.names]
    wide = _widest(covariance, np.flatnonzero(~reflected & moving))
    others = np.setdiff1d(np.arange(mode.z.size), wide)
    if wide.size < min(WIDE, mode.z.size) or np.all(reflected[others]):
        return None
    root = np.linalg.cholesky(covariance[np.ix_(wide, wide)])
    k = wide.size
    curve = np.zeros((mode.z.size, k, k))
    try:
        top = _ridge(target, mode, wide, others, np.zeros(k))
        for a in range(k):
            for b in range(a + 1):
                step = REACH * (root[:, a] + root[:, b]) / (2 if a == b else np.sqrt(2))
                ends = [_ridge(target, mode, wide, others, sign * step) for sign in (1, -1)]
                curve[others, a, b] = curve[others, b, a] = (ends[0] + ends[1] - 2 * top) / REACH**2
    except Refusal:
        return None
    curve[reflected] = 0.0
    # What was taken along (e_a + e_b)/√2 is the half of the two own and the mixed derivative.
    for a in range(k):
        for b in range(a):
            mixed = curve[:, a, b] - 0.5 * (curve[:, a, a] + curve[:, b, b])
            curve[:, a, b] = curve[:, b, a] = mixed
    sheared = np.linalg.solve(mode.factor, curve.reshape(mode.z.size, -1))
    if 0.5 * np.max(np.abs(sheared)) < SEEN:
        return None
    inverse = np.linalg.inv(root)
    return Shear(
        mode.z.copy(), wide, np.einsum("jab,ac,bd->jcd", curve, inverse, inverse), NoiseShear.of(target, mode)
    )


def _widest(covariance: np.ndarray, among: np.ndarray) -> np.ndarray:
    """Indices of the scores with the largest sds, each given the ones before it."""
    left, found = covariance.copy(), []
    for _ in range(min(WIDE, among.size)):
        i = among[int(np.argmax(np.diag(left)[among]))]
        if left[i, i] <= 1e-12:
            break
        found.append(int(i))
        left = left - np.outer(left[:, i], left[:, i]) / left[i, i]
    return np.array(found, int)


def _ridge(target: Target, mode: Mode, wide: np.ndarray, others: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The highest scores, (d − k,), of `others` where the wide ones are moved by `step`, (k,). Raises Refusal."""
    whole = mode.z.copy()
    whole[wide] += step

    def at(inner: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        z = whole.copy()
        z[others] = inner
        value, gradient, information = mode.near.curvature(z)
        return value, gradient[others], information[np.ix_(others, others)]

    information = np.linalg.inv(mode.factor @ mode.factor.T)
    inner = information[np.ix_(others, others)]
    start = mode.z[others] - np.linalg.solve(inner, information[np.ix_(others, wide)] @ step)
    reflected = target.reflected[others]
    top = maximise(at, reflected, start, limit=20)
    if not np.isfinite(top.value):
        raise Refusal("the ridge ends")
    return top.x
