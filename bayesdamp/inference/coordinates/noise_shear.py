"""Noise of which the data tell a ratio, in coordinates where its parameters are no curved ridge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtr

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.numerics.lazily import jnp, traced, tree
from bayesdamp.priors import LogNormal, LogUniform

if TYPE_CHECKING:
    pass


@tree(["moved", "along", "centre"])
@dataclass(frozen=True)
class NoiseShear:
    """Scores are level ones plus, for one parameter, what holds its ratio to a power of another: a shear, whose
    Jacobian is one, and which is flat at the mode. Of NumPy's arrays or of JAX's.

    The other parameter has a log-uniform prior, whose logarithm levels off towards the ends in scores, z, as Φ(z) does.
    moved: (d,), zero but for the parameter; along: the other's index, (1,); centre: its score at the mode, (1,).
    """

    moved: np.ndarray
    along: np.ndarray
    centre: np.ndarray

    @classmethod
    def none(cls, d: int) -> NoiseShear:
        """No shear at all."""
        return cls(np.zeros(d), np.zeros(1, int), np.zeros(1))

    @classmethod
    def of(cls, target: Target, mode: Mode) -> NoiseShear:
        """That of the target's noise; none where it ties nothing, or under priors of another kind."""
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
        return cls(moved, np.array([j]), mode.z[[j]])

    def sheared(self, level: Any) -> Any:
        """Scores of level ones, both (..., d)."""
        return level + self._height(level) * self.moved

    def level(self, scores: Any) -> Any:
        """Level scores, both (..., d)."""
        return scores - self._height(scores) * self.moved

    def slope(self, level: np.ndarray) -> np.ndarray:
        """Derivatives of the scores by the level ones, (d, d), at one point (d,)."""
        found = np.eye(level.size)
        found[:, self.along[0]] += self.moved * (_density(level[self.along]) - _density(self.centre))
        return found

    def _height(self, z: Any) -> Any:
        cumulated = _traced_ndtr if traced(z) else ndtr
        there = z[..., self.along]
        return cumulated(there) - cumulated(self.centre) - _density(self.centre) * (there - self.centre)


def _traced_ndtr(z: Any) -> Any:
    from jax.scipy.special import ndtr

    return ndtr(z)


def _density(z: Any) -> Any:
    exp = jnp.exp if traced(z) else np.exp
    return exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
