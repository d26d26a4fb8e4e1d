"""Coordinates in which what a record shows of its restoring law is straight, where a law has such.

A record tells the angle at rest and the frequency far better than gravity, so that a posterior of spring, gravity and
spring's angle lies along a curve, which a linear model leaves after a few of its sds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import Linearised, exact, linearised, relinearised
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import Linear, Weighed, weigh
from bayesdamp.inference.deviation.least_squares import fit
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.restoring._law import RestoringLaw

STEP = 1e-6
"""Of a coordinate, as a share of its prior sd, over which slopes are taken."""
ANCHORS = 3
"""How often the coordinates are laid through the mode that was found in the last ones."""


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
        p = super().values(z)
        natural = self.origin + self.root @ (z[self.places] - self.anchor)
        found = self.law.from_natural(dict(zip(self.at, map(float, natural), strict=True)))
        p[self.free[self.places]] = np.nan if found is None else [found[name] for name in self.at]
        return p

    def by_scores(self, tangents: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Tangents by v of those by the kernel's parameters, (n, k): shape (n, d)."""
        found = super().by_scores(tangents, z)
        found[:, self.places] = tangents[:, self.free[self.places]] @ self._slopes(z)
        return found

    def plain(self, z: np.ndarray) -> np.ndarray:
        """Standard normal scores of v, both (d,); NaN where there are none."""
        p, found = self.values(z)[self.free[self.places]], z.copy()
        found[self.places] = [
            float(self.priors[name].score(value)) for name, value in zip(self.at, p, strict=True)
        ]
        return found

    def log_prior(self, z: np.ndarray) -> float:
        """Log of the prior's density at v, (d,), over that of standard normal v; −∞ where it has none."""
        plain = self.plain(z)[self.places]
        if not np.all(np.isfinite(plain)):
            return -np.inf
        p, slopes = self.values(z)[self.free[self.places]], self._slopes(z)
        scales = []
        for name, score, value in zip(self.at, plain, p, strict=True):
            d = STEP * max(1.0, abs(score))
            ends = self.priors[name].value(np.array([score - d, score + d]))
            scales.append(float(np.diff(ends)[0]) / (2 * d) if np.isfinite(value) else np.nan)
        sign, log = np.linalg.slogdet(slopes / np.array(scales)[:, None])
        if not np.isfinite(log) or sign == 0:
            return -np.inf
        return float(log - 0.5 * np.sum(plain**2) + 0.5 * np.sum(z[self.places] ** 2))

    def _slopes(self, z: np.ndarray) -> np.ndarray:
        """Of the values by v, (b, b)."""
        found = np.empty((self.places.size, self.places.size))
        for i, place in enumerate(self.places):
            ends = []
            for sign in (-1.0, 1.0):
                moved = z.copy()
                moved[place] += sign * STEP
                ends.append(self.values(moved)[self.free[self.places]])
            found[:, i] = (ends[1] - ends[0]) / (2 * STEP)
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
    scales = parameters.slopes(z)[places]
    slopes = by_natural / scales[:, None]
    if not np.all(np.isfinite(slopes)) or np.linalg.cond(slopes) > 1e12:
        return None
    return replace(found, root=np.linalg.inv(slopes))


@dataclass(frozen=True)
class Reference:
    """What sampling starts from: a linear model in the coordinates of `parameters`, weighed."""

    parameters: Parameters
    model: Linear
    weighed: Weighed

    def scores(self, draws: np.ndarray) -> np.ndarray:
        """Standard normal scores with g and h, (n, K), of draws."""
        if not isinstance(self.parameters, Straight):
            return draws
        d, found = self.parameters.free.size, draws.copy()
        found[:, :d] = [self.parameters.plain(row[:d]) for row in draws]
        return found

    @property
    def log_prior(self) -> Callable[[np.ndarray], float] | None:
        """Log of the prior's density over a standard normal one, of scores (d,); None where they are the same."""
        return self.parameters.log_prior if isinstance(self.parameters, Straight) else None


def reference_of(weighing: Weighing, result: Result, approximate: bool) -> Reference:
    """The linear model that a candidate's draws begin with: in straight coordinates where there are such, about the
    mode in them; else that which it was weighed by."""
    model = result.exact if not approximate or result.about is None else result.about.model
    weighed = result.weighed if approximate else result.exact_weighed
    assert weighed is not None
    found = _straightened(weighing, result, approximate)
    return found or Reference(result.fit.parameters, model, weighed)


def _straightened(weighing: Weighing, result: Result, approximate: bool) -> Reference | None:
    data, solver = weighing.data, result.solver
    samples, variance = data.y.size / weighing.inflation, weighing.variance
    z = result.fit.z if not approximate or result.about is None else result.about.u[: result.fit.z.size]
    coordinates = straight_at(result.fit.parameters, result.candidate.restoring, z)
    if coordinates is None:
        return None
    if not approximate:
        return _exact(coordinates, result, data, samples)
    at = _about(coordinates, result, solver, data, None if result.about is None else result.about.u)
    if at is None:
        return None
    for _ in range(ANCHORS):
        found = relinearised(result.candidate, solver, data, at.fit, variance, at)
        if found is None:
            return None
        mode, d = found[0], at.fit.z.size
        assert isinstance(mode.parameters, Straight)
        plain = mode.parameters.plain(mode.u[:d])
        there = straight_at(result.fit.parameters, result.candidate.restoring, plain)
        if there is None:
            return None
        new = _about(there, result, solver, data, np.concatenate([plain, mode.u[d:]]))
        if new is None:
            return None
        apart = np.abs(plain - mode.u[:d]).max()
        at = new
        if apart < CLOSE:
            break
    grid = grid_of(solver.knots.size, absorbed=result.fit.parameters.absorbs)
    return Reference(at.parameters, at.model, weigh(at.model, grid, variance, samples))


CLOSE = 0.1
"""Scores by which v may differ from z at the mode for the coordinates not to be laid anew."""


def _about(
    coordinates: Straight, result: Result, solver: Solver, data: Data, u: np.ndarray | None
) -> Linearised | None:
    z = result.fit.z if u is None else u[: result.fit.z.size]
    found = replace(result.fit, parameters=coordinates, z=z)
    return linearised(result.candidate, solver, data, found, u)


def _exact(coordinates: Straight, result: Result, data: Data, samples: float) -> Reference | None:
    fitted = fit(
        result.solver, coordinates, result.fit.active, data.y, result.fit.z, noise=data.noise, windows=False
    )
    if fitted is None:
        return None
    model = exact(fitted)
    return Reference(coordinates, model, weigh(model, grid_of(0, exact=True), result.exact_variance, samples))
