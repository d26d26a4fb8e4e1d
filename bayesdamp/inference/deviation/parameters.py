"""Map standard normal scores to the parameters of a candidate, in the order in which its solver takes them.

A candidate is a sum of damping terms under a restoring law. A score stands for an inferred parameter and has the prior
N(0, 1); the parameter's own prior defines the map.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayesdamp.inference.model.target import Scores
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.priors import Prior, log_prior_of

DERIVATIVE_STEP = 1e-6
"""Step of numerical derivatives of parameters by straight coordinates, in the unit of the coordinate (conventional).
Straight coordinates replace some standard normal scores, and make motions more nearly linear (`StraightParameters`)."""


@dataclass(frozen=True)
class Parameters(Scores):
    """The inferred parameters of an equation of motion with their priors, and the values of its other parameters.

    Methods take inferred parameters as standard normal scores z: each parameter is a function of its score, which has
    the prior N(0, 1).

    Attributes
    ----------
    names : tuple of str
        All k parameters of the equation of motion, in the order of `Solver.names`.
    priors : mapping of str to Prior
        Priors of the d inferred parameters. They are put in the order of `names`; entries for other names are dropped.
    known : mapping of str to float
        Values of the other parameters, by name; a parameter that is in neither mapping is 0.
    """

    names: tuple[str, ...]
    priors: Mapping[str, Prior]
    known: Mapping[str, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "priors", {n: self.priors[n] for n in self.names if n in self.priors})

    def with_fixed(self, name: str, value: float) -> Self:
        """Return a copy in which the inferred parameter `name` is fixed at a value, in the parameter's unit."""
        priors = {n: p for n, p in self.priors.items() if n != name}
        return replace(self, priors=priors, known={**self.known, name: value})

    @cached_property
    def free(self) -> np.ndarray:
        """Return the indices in `names` of the inferred parameters, (d,)."""
        return np.array([i for i, n in enumerate(self.names) if n in self.priors], int)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Return the names of the d inferred parameters, in the order of `names`."""
        return tuple(self.priors)

    @property
    def positive(self) -> np.ndarray:
        """Return a boolean mask, (d,), of the inferred parameters that must be ≥ 0: those with half-normal priors."""
        return self.reflected

    @cached_property
    def damping(self) -> np.ndarray:
        """Return a boolean mask, (d,), of the inferred parameters that belong to damping terms.

        These are the coefficients, and the parameters that a term has besides its coefficient, such as an exponent.
        """
        terms = [TERMS.get(name) for name in TERMS.names()]
        own = {n for t in terms for n in (t.parameter, *(p.name for p in t.inferred))}
        return np.array([n in own for n in self.free_names], bool)

    @property
    def masks(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return three boolean masks of the d inferred parameters: `positive`, `shared` and `damping`, (d,) each.

        positive: must not be negative. shared: coefficients whose priors have a common, unknown scale. damping: belong
        to damping terms.
        """
        return self.positive, self.shared, self.damping

    @property
    def damping_names(self) -> tuple[str, ...]:
        """Return the names of the inferred parameters of damping terms, in the order of `names`."""
        return tuple(n for n, yes in zip(self.free_names, self.damping, strict=True) if yes)

    @property
    def absorbs(self) -> tuple[bool, bool]:
        """Return whether the inferred parameters include an equivalent of a constant g, and one of a constant h.

        g and h are the deviations from the laws: the damping force is multiplied by exp g, and the frequency by 1 + h.
        A coefficient acts like a constant g; the first flag is True if any parameter has a half-normal prior, as
        coefficients have by default. The stiffness acts like a constant h; the second flag is True if it is inferred.
        """
        return bool(np.any(self.positive)), "stiffness" in self.priors

    def log_prior(self, z: np.ndarray) -> np.ndarray:
        """Return the log prior density, (...), of standard normal scores z, (..., d).

        It is the density of z, not of the parameters, and −∞ where a score that must be ≥ 0 is negative. For
        coefficients whose half-normal priors have a common, unknown scale, the density is averaged over its possible
        values (`SHARED_SIGMAS`). `StraightParameters` has other coordinates for some parameters; they are treated as
        scores here, and `log_prior_ratio` is the correction.
        """
        value = log_prior_of(z, self.shared) + int(self.positive.sum()) * np.log(2.0)
        return np.where(np.all(z[..., self.positive] >= 0, axis=-1), value, -np.inf)

    @cached_property
    def _fixed(self) -> np.ndarray:
        return np.array([self.known.get(n, 0.0) for n in self.names], float)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return all k parameters of the equation of motion, (..., k), at standard normal scores z, (..., d).

        A score stands for an inferred parameter and has the prior N(0, 1). The result is in the order of `names`, in
        the parameters' units.
        """
        p = np.empty((*z.shape[:-1], self._fixed.size))
        p[...] = self._fixed
        each = zip(self.free, self._functions, np.moveaxis(z, -1, 0), strict=True)
        for place, (transform, _, numbers, _), x in each:
            p[..., place] = transform(x, *numbers)
        return p

    def named(self, z: np.ndarray) -> dict[str, float]:
        """Return all parameters of the equation of motion, known and inferred, by name, at standard normal scores z."""
        return dict(zip(self.names, map(float, self.values(z)), strict=True))

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the inferred parameters as standard normal scores, (d,), for values by name.

        A score stands for a parameter and has the prior N(0, 1). `values` must contain each inferred parameter; other
        names have no effect. An infinite score, such as that of 0 under a log-normal prior, becomes ±6, and nan becomes
        0. The result contains scores in `StraightParameters` too, not straight coordinates.
        """
        scores = [float(self.priors[n].score(values[n])) for n in self.free_names]
        return np.nan_to_num(scores, posinf=6.0, neginf=-6.0)

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Convert derivatives of n values by all k parameters, (n, k), to derivatives by the d scores, (n, d).

        z: standard normal scores of the inferred parameters, at which the derivatives are taken, (d,).
        """
        return tangents[:, self.free] * self.rates(z)

    def plain(self, z: np.ndarray) -> np.ndarray:
        """Convert coordinates z to standard normal scores, both (..., d); here they are equal, and z is returned.

        The subclass `StraightParameters` has other coordinates for some parameters.
        """
        return z

    def log_prior_ratio(self, z: np.ndarray) -> np.ndarray:
        """Return the log prior density of coordinates z, (..., d), minus `log_prior(z)`; it is 0 in this class, (...).

        All coordinates are standard normal scores here, and `log_prior` is their density; it includes the half-normal
        priors and the common prior scale of coefficients. The subclass `StraightParameters` has other coordinates for
        some parameters, which `log_prior` treats as scores. The importance weights of draws contain this difference.
        """
        return np.zeros(z.shape[:-1])


@dataclass(frozen=True)
class StraightParameters(Parameters):
    """Parameters with straight coordinates v in place of the scores of θ₀ and of the restoring law's parameters.

    Scores are parameters transformed so that their priors are standard normal; θ₀ is the displacement at the first
    sample. Motions are more nearly linear in v = z₀ + J (ν − ν₀). Here ν are the natural coordinates of the law
    (`RestoringLaw.natural`), quantities such as the frequency, which a record determines well. z₀ and ν₀ are the scores
    and the natural coordinates at one point, the anchor. J is the derivative of the scores by ν at the anchor, so that
    v agrees with the scores to first order.

    Attributes
    ----------
    law : RestoringLaw
        The restoring law, which defines ν.
    places : ndarray of int, shape (b,)
        Indices of the coordinates v among all d coordinates.
    at : tuple of str
        Names of the b parameters whose scores v replaces, in the order of v: those of the law, then theta0.
    anchor, origin : ndarray, shape (b,)
        z₀ and ν₀.
    inverse_jacobian : ndarray, shape (b, b)
        J⁻¹.
    """

    law: RestoringLaw
    places: np.ndarray
    at: tuple[str, ...]
    anchor: np.ndarray
    origin: np.ndarray
    inverse_jacobian: np.ndarray

    def with_fixed(self, name: str, value: float) -> Self:
        """Return a copy in which the inferred parameter `name` is fixed at a value, in the parameter's unit.

        name: a parameter whose coordinate is a standard normal score; parameters in `at` have straight coordinates and
        cannot be fixed.
        """
        before = self.free_names.index(name) < self.places
        return replace(super().with_fixed(name, value), places=self.places - before)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return all k parameters of the equation of motion, (..., k), at coordinates z, (..., d).

        z: standard normal scores of the inferred parameters or, for θ₀ and the restoring law, straight coordinates (see
        the class). At least one of the parameters `at` is NaN where no valid parameters have these coordinates.
        """
        p = super().values(z)
        p[..., self.free[self.places]] = self._law_values(z[..., self.places])
        return p

    def _law_values(self, v: np.ndarray) -> np.ndarray:
        """Return the parameters in `at`, (..., b), in their units, for their straight coordinates v, (..., b).

        Straight coordinates are those in which motions are more nearly linear (see the class). At least one parameter
        is NaN where no valid parameters have these coordinates.
        """
        natural = self.origin + (v - self.anchor) @ self.inverse_jacobian.T
        values = self.law.from_natural({name: natural[..., i] for i, name in enumerate(self.at)})
        assert values is not None  # `straighten_at` has checked this
        return np.stack([values[name] for name in self.at], axis=-1)

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Convert derivatives of n values by all k parameters, (n, k), to those by the d coordinates, (n, d).

        z: coordinates of the inferred parameters at which the derivatives are taken, (d,): standard normal scores or,
        for θ₀ and the restoring law, straight coordinates (see the class).
        """
        columns = super().by_scores(tangents, z)
        columns[:, self.places] = tangents[:, self.free[self.places]] @ self.slopes(z)
        return columns

    def plain(self, z: np.ndarray) -> np.ndarray:
        """Convert coordinates z to standard normal scores, both (..., d).

        z: standard normal scores or, for θ₀ and the restoring law, straight coordinates (see the class). At least one
        score is NaN where no valid parameters have these coordinates.
        """
        scores = z.copy()
        scores[..., self.places] = self._law_scores(z)
        return scores

    def _law_scores(self, z: np.ndarray) -> np.ndarray:
        """Return the standard normal scores, (..., b), of the parameters in `at`, which have straight coordinates.

        z: coordinates of all d inferred parameters, (..., d): standard normal scores or, for θ₀ and the restoring law,
        straight coordinates (see the class).
        """
        values = self._law_values(z[..., self.places])
        return np.stack([self.priors[name].score(values[..., i]) for i, name in enumerate(self.at)], axis=-1)

    def retract(self, restoring: str, z: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return `new`, the end of a step from z, unchanged.

        The base class, whose coordinates are scores, bends the step so that it follows the curve of parameters that fit
        about equally well. In straight coordinates this curve is nearly straight, so that a straight step follows it.
        """
        return new

    def log_prior_ratio(self, z: np.ndarray) -> np.ndarray:
        """Return the log prior density of coordinates z, (..., d), minus `log_prior(z)`, (...).

        `log_prior` treats straight coordinates, in which motions are more nearly linear (see the class), as independent
        N(0, 1). The result is the difference for these coordinates, and −∞ where no valid parameters have them or a
        prior excludes the parameters. The other coordinates have no effect.
        """
        ratios, plain = np.full(z.shape[:-1], -np.inf), self._law_scores(z)
        inside = np.all(np.isfinite(plain), axis=-1)
        z, plain = z[inside], plain[inside]
        rates = [self.priors[name].rate(plain[..., i]) for i, name in enumerate(self.at)]
        log = np.linalg.slogdet(self.slopes(z) / np.stack(rates, axis=-1)[..., None])[1]
        own = log - 0.5 * np.sum(plain**2, axis=-1) + 0.5 * np.sum(z[..., self.places] ** 2, axis=-1)
        ratios[inside] = np.where(np.isfinite(own), own, -np.inf)
        return ratios

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """Return the derivatives of the parameters in `at` by their straight coordinates v, (..., b, b).

        Straight coordinates are those in which motions are more nearly linear (see the class). Rows are parameters, in
        their units, and columns are coordinates. z: coordinates of all d inferred parameters, (..., d).
        """
        v, steps = z[..., self.places], DERIVATIVE_STEP * np.eye(self.places.size)
        changes = [self._law_values(v + step) - self._law_values(v - step) for step in steps]
        return np.stack(changes, axis=-1) / (2 * DERIVATIVE_STEP)


def straighten_at(parameters: Parameters, restoring: str, z: np.ndarray) -> StraightParameters | None:
    """Return parameters with straight coordinates, in which motions are more nearly linear (see `StraightParameters`).

    restoring: name of the restoring law. z: standard normal scores of the inferred parameters, (d,); near them straight
    coordinates and scores agree to first order. Return None if the law has no natural coordinates (at z), if θ₀
    (displacement at the first sample) or a parameter of the law is not inferred, or if the derivatives of the scores by
    the natural coordinates at z are infinite or (nearly) singular.
    """
    law = LAWS.get(restoring)
    at = (*law.parameters, "theta0")
    if not set(at) <= set(parameters.free_names):
        return None
    natural = law.natural({n: v for n, v in parameters.named(z).items() if n in parameters.priors})
    if natural is None or law.from_natural(natural) is None:
        return None
    places = np.array([parameters.free_names.index(name) for name in at])
    origin = np.array([natural[name] for name in at])
    # With the identity for J⁻¹, `slopes` are the derivatives of the parameters by ν.
    own = (parameters.names, parameters.priors, parameters.known)
    straight = StraightParameters(*own, law, places, at, z[places], origin, np.eye(len(at)))
    slopes = straight.slopes(z) / parameters.rates(z)[places][:, None]
    if not np.all(np.isfinite(slopes)) or np.linalg.cond(slopes) > 1e12:
        return None
    return replace(straight, inverse_jacobian=np.linalg.inv(slopes))
