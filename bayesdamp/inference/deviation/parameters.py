"""The parameters of a candidate as standard normal scores, vectorised over what a kernel takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.priors import HalfNormal, Prior

STEP = 1e-5
"""Scores over which the slope of a prior's map is taken."""


@dataclass(frozen=True)
class Parameters:
    """Which of a kernel's parameters are inferred, with their priors, and the values of the others.

    names: (k,), the kernel's order; priors: of those that are inferred; known: of the others, absent coefficients at 0.
    """

    names: tuple[str, ...]
    priors: Mapping[str, Prior]
    known: Mapping[str, float]

    @cached_property
    def free(self) -> np.ndarray:
        """Places in `names` of what is inferred, (d,)."""
        return np.array([i for i, n in enumerate(self.names) if n in self.priors], int)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Names of what is inferred, in the kernel's order."""
        return tuple(self.names[i] for i in self.free)

    @cached_property
    def positive(self) -> np.ndarray:
        """Which of the scores, (d,), must not be negative: those of half-normal priors."""
        return np.array([isinstance(self.priors[n], HalfNormal) for n in self.free_names], bool)

    @cached_property
    def _fixed(self) -> np.ndarray:
        return np.array([self.known.get(n, 0.0) for n in self.names], float)

    def values(self, z: np.ndarray) -> np.ndarray:
        """The kernel's parameters at scores z, (..., d): shape (..., k)."""
        p = np.empty((*z.shape[:-1], self._fixed.size))
        p[...] = self._fixed
        for j, (i, name) in enumerate(zip(self.free, self.free_names, strict=True)):
            p[..., i] = self.priors[name].value(z[..., j])
        return p

    @property
    def absorbs(self) -> tuple[bool, bool]:
        """Whether a constant deviation of damping, and of frequency, is in a parameter that is inferred already."""
        return bool(np.any(self.positive)), "stiffness" in self.priors

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of values by name, (d,), within ±6."""
        found = [float(self.priors[n].score(values[n])) for n in self.free_names]
        return np.clip(np.nan_to_num(found, posinf=6.0, neginf=-6.0), -6.0, 6.0)

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """By how much each inferred parameter changes with its score at z, (d,)."""
        found = []
        for name, score, positive in zip(self.free_names, z, self.positive, strict=True):
            prior = self.priors[name]
            around = np.array([score - STEP, score + STEP]) + (STEP if positive else 0.0)
            found.append(float(np.diff(prior.value(around))[0]) / (2 * STEP))
        return np.array(found)

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Tangents by the scores at z, (n, d), of those by the kernel's parameters, (n, k)."""
        return tangents[:, self.free] * self.slopes(z)

    def named(self, z: np.ndarray) -> dict[str, float]:
        """All of the kernel's parameters at scores z, (d,), by name."""
        return dict(zip(self.names, map(float, self.values(z)), strict=True))


def only(priors: Mapping[str, Prior], names: Sequence[str]) -> dict[str, Prior]:
    """The priors of some names."""
    return {n: p for n, p in priors.items() if n in names}
