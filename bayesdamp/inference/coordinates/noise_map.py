"""A map of correlated noise's parameters to coordinates in which their posterior is close to normal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads its modules when they are used
from scipy.special import ndtri

from bayesdamp.inference.fit.mode import Mode, maximise
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.numerics.levenberg_marquardt import Maximum
from bayesdamp.types import Refusal

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

FIRST_STEP = 0.5
"""First step along the ridge, in posterior sds at the mode."""
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
"""Normal score up to which the map is tabulated; beyond, it is a straight line."""
FAR = 1000.0
"""Normal score at which the straight lines end."""
NEWTON_STEPS = 6
"""Steps of Newton's method that invert the map; it starts so close that four are enough."""


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
        level = _normal_scores(fine, scipy.interpolate.Akima1DInterpolator(scores, heights)(fine))
        inside = np.abs(level) < WIDEST
        shift = scipy.interpolate.Akima1DInterpolator(scores, firsts)(fine) - mode.z[first]
        return cls(first, second, _table(level[inside], np.stack([fine, shift], axis=1)[inside]))

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


def _normal_scores(x: np.ndarray, log_density: np.ndarray) -> np.ndarray:
    """Return Φ⁻¹ of the cumulative probability at points x, (m,), with an unnormalised log density there.

    Each half is computed from its own end, so that no digits are lost in the tails. Both ends are infinite.
    """
    density = np.exp(log_density - np.max(log_density))
    parts = 0.5 * (density[1:] + density[:-1]) * np.diff(x)
    below = np.append(0.0, np.cumsum(parts)) / parts.sum()
    above = np.append(np.cumsum(parts[::-1])[::-1], 0.0) / parts.sum()
    return np.where(below < above, ndtri(np.minimum(below, 0.5)), -ndtri(np.minimum(above, 0.5)))


def _table(level: np.ndarray, values: np.ndarray) -> PPoly:
    """Interpolate values, (m, 2), over level scores, (m,), monotonically, and go on along straight lines."""
    low = values[0] - (values[1] - values[0]) / (level[1] - level[0]) * (level[0] + FAR)
    high = values[-1] + (values[-1] - values[-2]) / (level[-1] - level[-2]) * (FAR - level[-1])
    return scipy.interpolate.PchipInterpolator(
        np.concatenate([[-FAR], level, [FAR]]), np.concatenate([[low], values, [high]])
    )
