"""Coordinates in which correlated noise has no curved ridge between its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.priors import LogNormal, LogUniform


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
        return level + self._height(level) * self.moved

    def level(self, scores: np.ndarray) -> np.ndarray:
        """Return the level scores of scores, both (..., d)."""
        return scores - self._height(scores) * self.moved

    def slope(self, level: np.ndarray) -> np.ndarray:
        """Return the derivatives of the scores by the level ones, (..., d, d), at level scores (..., d)."""
        slope = np.zeros((*level.shape, level.shape[-1])) + np.eye(level.shape[-1])
        steepness = _density(level[..., self.along]) - _density(self.centre)
        slope[..., self.along] += steepness[..., None] * self.moved
        return slope

    def _height(self, z: np.ndarray) -> np.ndarray:
        there = z[..., self.along, None]
        return ndtr(there) - ndtr(self.centre) - _density(self.centre) * (there - self.centre)


def _density(z: np.ndarray | float) -> np.ndarray:
    return np.exp(-0.5 * np.square(z)) / np.sqrt(2 * np.pi)
