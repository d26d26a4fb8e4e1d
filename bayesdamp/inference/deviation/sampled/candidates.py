"""The candidates that matter, sampled: posteriors and evidence of the motions themselves, not of a linear model.

Sampling starts from a linear model, in straight coordinates where the restoring law has such, and along the ridge of
the damping terms' own parameters where they have such. A record tells the angle at rest and the frequency far better
than gravity, so that a posterior of spring, gravity and spring's angle lies along a curve, which a linear model leaves
after a few of its sds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.candidate import Linearised, exact, linearised, refit, relinearised
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import Linear, Weighed, weigh
from bayesdamp.inference.deviation.gaussian.tempered import DRAWS, sampled
from bayesdamp.inference.deviation.parameters import Parameters, Straight, straight_at
from bayesdamp.inference.deviation.sampled.motions import motions_near
from bayesdamp.inference.deviation.sampled.ridge import Ridge, ridge_of
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.kernel import Solver

ANCHORS = 3
"""How often the coordinates are laid through the mode that was found in the last ones."""
CLOSE = 0.1
"""Scores by which v may differ from z at the mode for the coordinates not to be laid anew."""


@dataclass(frozen=True)
class Reference:
    """What sampling starts from: a linear model in the coordinates of `parameters`, weighed."""

    parameters: Parameters | Ridge
    model: Linear
    weighed: Weighed

    def scores(self, draws: np.ndarray) -> np.ndarray:
        """Standard normal scores with g and h, (n, K), of draws."""
        d, found = self.parameters.free.size, draws.copy()
        found[:, :d] = [self.parameters.plain(row[:d]) for row in draws]
        return found


def reference_of(weighing: Weighing, result: Result, approximate: bool) -> Reference:
    """The linear model that a candidate's draws begin with: in straight coordinates where there are such, about the
    mode in them; else that which it was weighed by; along a ridge where there is one."""
    model = result.exact if not approximate or result.about is None else result.about.model
    weighed = result.weighed if approximate else result.exact_weighed
    assert weighed is not None
    found = _straightened(weighing, result, approximate) or Reference(result.fit.parameters, model, weighed)
    assert isinstance(found.parameters, Parameters)
    ridge = ridge_of(weighing, result, approximate, found.parameters, found.model, found.weighed)
    if ridge is None:
        return found
    model = replace(found.model, positive=ridge.positive)
    knots = result.solver.knots.size if approximate else 0
    grid = grid_of(knots, exact=not approximate, absorbed=ridge.base.absorbs)
    variance = weighing.variance if approximate else result.exact_variance
    return Reference(ridge, model, weigh(model, grid, variance, weighing.samples))


def _straightened(weighing: Weighing, result: Result, approximate: bool) -> Reference | None:
    data, solver = weighing.data, result.solver
    samples, variance = weighing.samples, weighing.variance
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


def _about(
    coordinates: Straight, result: Result, solver: Solver, data: Data, u: np.ndarray | None
) -> Linearised | None:
    z = result.fit.z if u is None else u[: result.fit.z.size]
    found = replace(result.fit, parameters=coordinates, z=z)
    return linearised(result.candidate, solver, data, found, u)


def _exact(coordinates: Straight, result: Result, data: Data, samples: float) -> Reference | None:
    fitted = refit(result.solver, data, replace(result.fit, parameters=coordinates))
    if fitted is None:
        return None
    model = exact(fitted)
    return Reference(coordinates, model, weigh(model, grid_of(0, exact=True), result.exact_variance, samples))


BEHIND = 5.0
"""Nats behind the best under linear models up to which a candidate is sampled: more than sampling has moved any by."""
MOST = 6
"""Candidates that are sampled at most."""


def with_samples(weighing: Weighing, approximate: bool, seed: int = 0) -> Weighing:
    """The weighing with its likeliest candidates and rivals sampled.

    Which they are is decided by the evidence of the linear models.
    """
    every = [r for r in (*weighing.results, *weighing.forms) if not approximate or r.weighed is not None]
    if not every:
        return weighing
    best = max(r.log_evidence for r in every)
    close = sorted((r for r in every if r.log_evidence > best - BEHIND), key=lambda r: -r.log_evidence)[:MOST]
    found = {id(r): sampled_result(weighing, r, approximate, seed) for r in close}
    return replace(
        weighing,
        results=tuple(found.get(id(r), r) for r in weighing.results),
        forms=tuple(found.get(id(r), r) for r in weighing.forms),
    )


def sampled_result(
    weighing: Weighing, result: Result, approximate: bool, seed: int = 0, draws: int = DRAWS
) -> Result:
    """A candidate's result with its motions sampled; the same seed gives the same draws of each candidate."""
    variance = weighing.variance if approximate else result.exact_variance
    start = reference_of(weighing, result, approximate)
    motions = motions_near(
        result.solver, start.parameters, result.fit.active, start.weighed, float(np.sqrt(variance))
    )
    y, model, d = weighing.data.y, start.model, start.parameters.free.size

    def squares(row: np.ndarray) -> float:
        motion = motions.at(row)
        return np.inf if motion is None else float(np.sum((y - motion) ** 2))

    def ratio(u: np.ndarray) -> np.ndarray:
        """Return the log of the likelihood of the motion itself over the linear model's, of draws (n, K): (n,), −∞
        where it escapes."""
        exact = np.array(at_once(squares, u))
        linear = np.sum((u @ model.root.T - model.target) ** 2, axis=1) + model.rest
        return 0.5 * (linear - exact) / variance + [start.parameters.log_prior_ratio(row[:d]) for row in u]

    found = sampled(
        ratio,
        start.weighed,
        start.parameters.positive,
        draws=draws,
        seed=crc32(result.candidate.name.encode()) + seed % 2**32,
    )
    return replace(result, sampled=replace(found, draws=start.scores(found.draws)))
