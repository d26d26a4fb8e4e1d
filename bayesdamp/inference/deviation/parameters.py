"""The parameters of a candidate as standard normal scores, vectorised over what a kernel takes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayesdamp.inference.model.target import Scores
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.priors import Prior, log_prior_of

SMALL_STEP = 1e-6
"""Scores over which slopes of the straight coordinates are taken."""


@dataclass(frozen=True)
class Parameters(Scores):
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "priors", {n: self.priors[n] for n in self.names if n in self.priors})

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Names of what is inferred, in the kernel's order."""
        return tuple(self.priors)

    @property
    def positive(self) -> np.ndarray:
        """Which of the scores, (d,), must not be negative: those of half-normal priors."""
        return self.reflected

    @cached_property
    def damping(self) -> np.ndarray:
        """Which of the scores, (d,), are of damping terms: coefficients and the terms' own parameters."""
        terms = [TERMS.get(name) for name in TERMS.names()]
        own = {n for t in terms for n in (t.parameter, *(p.name for p in t.inferred))}
        return np.array([n in own for n in self.free_names], bool)

    @property
    def damping_names(self) -> tuple[str, ...]:
        """Names of the inferred parameters of damping terms."""
        return tuple(n for n, yes in zip(self.free_names, self.damping, strict=True) if yes)

    def log_prior(self, z: np.ndarray) -> np.ndarray:
        """Log density of scores z, (..., d), shape (...); −∞ where a score that must not be negative is."""
        return log_prior_of(z, self.positive, self.shared)

    @cached_property
    def _fixed(self) -> np.ndarray:
        return np.array([self.known.get(n, 0.0) for n in self.names], float)

    def values(self, z: np.ndarray) -> np.ndarray:
        """The kernel's parameters at scores z, (..., d): shape (..., k)."""
        return self._filled(z, range(self.free.size))

    def _filled(self, z: np.ndarray, scores: Iterable[int]) -> np.ndarray:
        """The kernel's parameters, (..., k): what is known, and what these of the scores, (..., d), stand for."""
        p = np.empty((*z.shape[:-1], self._fixed.size))
        p[...] = self._fixed
        for j in scores:
            p[..., self.free[j]] = self.priors[self.free_names[j]].value(z[..., j])
        return p

    @property
    def absorbs(self) -> tuple[bool, bool]:
        """Whether a constant deviation of damping, and of frequency, is in a parameter that is inferred already."""
        return bool(np.any(self.positive)), "stiffness" in self.priors

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of values by name, (d,): ±6 where a prior ends, and as far away as a fit has them elsewhere."""
        found = [float(self.priors[n].score(values[n])) for n in self.free_names]
        return np.nan_to_num(found, posinf=6.0, neginf=-6.0)

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Tangents by the scores at z, (n, d), of those by the kernel's parameters, (n, k)."""
        return tangents[:, self.free] * self.rates(z)

    def plain(self, z: np.ndarray) -> np.ndarray:
        """Return the standard normal scores of z, both (d,): z itself."""
        return z

    def log_prior_ratio(self, z: np.ndarray) -> float:
        """Return the log of the prior's density at z, (d,), over that of the same prior of these scores: 0."""
        return 0.0

    def named(self, z: np.ndarray) -> dict[str, float]:
        """All of the kernel's parameters at scores z, (d,), by name."""
        return dict(zip(self.names, map(float, self.values(z)), strict=True))


@dataclass(frozen=True)
class Straight(Parameters):
    """Parameters whose law's scores and θ₀'s are replaced by v = z₀ + J (ν − ν₀), ν the law's natural coordinates and J
    the slopes of the scores by them at the anchor: there v and the scores z agree to first order.

    places: of v among all scores, (b,); at: their names; anchor: z₀, (b,); origin: ν₀, (b,); root: J⁻¹, (b, b).
    """

    law: RestoringLaw
    places: np.ndarray
    at: tuple[str, ...]
    anchor: np.ndarray
    origin: np.ndarray
    root: np.ndarray

    def values(self, z: np.ndarray) -> np.ndarray:
        """The kernel's parameters at z, (..., d): shape (..., k); NaN where no parameters have these coordinates."""
        if z.ndim > 1:
            return np.array([self.values(row) for row in z])
        p = self._filled(z, self._others)
        p[self.free[self.places]] = self._of_law(z[self.places])
        return p

    @cached_property
    def _others(self) -> tuple[int, ...]:
        """Places among the scores of what is not of the law."""
        return tuple(i for i in range(self.free.size) if i not in self.places)

    def _of_law(self, v: np.ndarray) -> np.ndarray:
        """Values of what v stands for, both (b,); NaN where there are none."""
        natural = self.origin + self.root @ (v - self.anchor)
        found = self.law.from_natural(dict(zip(self.at, natural.tolist(), strict=True)))
        return np.full(v.size, np.nan) if found is None else np.array([found[name] for name in self.at])

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Tangents by v of those by the kernel's parameters, (n, k): shape (n, d)."""
        found = super().by_scores(tangents, z)
        found[:, self.places] = tangents[:, self.free[self.places]] @ self._slopes(z)
        return found

    def plain(self, z: np.ndarray) -> np.ndarray:
        """Standard normal scores of v, both (d,); NaN where there are none."""
        found = z.copy()
        found[self.places] = self._plain_of(self._of_law(z[self.places]))
        return found

    def _plain_of(self, values: np.ndarray) -> list[float]:
        return [float(self.priors[name].score(value)) for name, value in zip(self.at, values, strict=True)]

    def retracted(self, restoring: str, z: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return `new`: these coordinates are straight."""
        return new

    def log_prior_ratio(self, z: np.ndarray) -> float:
        """Log of the prior's density at v, (d,), over that of the same prior of scores v; −∞ where it has none."""
        p = self._of_law(z[self.places])
        plain = np.array(self._plain_of(p))
        if not np.all(np.isfinite(plain)):
            return -np.inf
        slopes = self._slopes(z)
        rates = [float(self.priors[name].rate(score)) for name, score in zip(self.at, plain, strict=True)]
        sign, log = np.linalg.slogdet(slopes / np.array(rates)[:, None])
        if not np.isfinite(log) or sign == 0:
            return -np.inf
        return float(log - 0.5 * np.sum(plain**2) + 0.5 * np.sum(z[self.places] ** 2))

    def _slopes(self, z: np.ndarray) -> np.ndarray:
        """Of the values by v, (b, b)."""
        found = np.empty((self.places.size, self.places.size))
        for i in range(self.places.size):
            ends = []
            for sign in (-1.0, 1.0):
                moved = z[self.places]
                moved[i] += sign * SMALL_STEP
                ends.append(self._of_law(moved))
            found[:, i] = (ends[1] - ends[0]) / (2 * SMALL_STEP)
        return found


def straight_at(parameters: Parameters, restoring: str, z: np.ndarray) -> Straight | None:
    """The straight coordinates laid through scores z, (d,); None where the law has none, or not all of what they are
    made of is inferred."""
    law = LAWS.get(restoring)
    at = (*law.parameters, "theta0")
    if not set(at) <= set(parameters.free_names):
        return None
    p = dict(zip(parameters.free_names, map(float, parameters.values(z)[parameters.free]), strict=True))
    natural = law.natural(p)
    if natural is None or law.from_natural(natural) is None:
        return None
    places = np.array([parameters.free_names.index(name) for name in at])
    origin = np.array([natural[name] for name in at])
    # Laid with the identity first, whose slopes are those of the values by ν.
    found = Straight(
        parameters.names,
        parameters.priors,
        parameters.known,
        law,
        places,
        at,
        z[places],
        origin,
        np.eye(len(at)),
    )
    by_natural = found._slopes(z)
    scales = parameters.rates(z)[places]
    slopes = by_natural / scales[:, None]
    if not np.all(np.isfinite(slopes)) or np.linalg.cond(slopes) > 1e12:
        return None
    return replace(found, root=np.linalg.inv(slopes))
