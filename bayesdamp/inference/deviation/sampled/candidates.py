"""The candidates that matter, sampled: posteriors and evidence of the motions themselves, not of a linear model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.linear import Linear
from bayesdamp.inference.deviation.gaussian.tempered import DRAWS, sampled
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE

BEHIND = 5.0
"""Nats behind the best under linear models up to which a candidate is sampled: more than sampling has moved any by."""
MOST = 6
"""Candidates that are sampled at most."""


def with_samples(weighing: Weighing, approximate: bool, seed: int = 0) -> Weighing:
    """The weighing with its likeliest candidates and rivals, and the power law, sampled.

    Which they are is decided by the evidence of the linear models.
    """
    every = [r for r in (*weighing.results, *weighing.forms) if not approximate or r.weighed is not None]
    if not every:
        return weighing
    best = max(r.log_evidence for r in every)
    close = sorted((r for r in every if r.log_evidence > best - BEHIND), key=lambda r: -r.log_evidence)[:MOST]
    found = {id(r): sampled_result(weighing, r, approximate, seed) for r in close}
    power = weighing.power
    if power is not None and (not approximate or power.weighed is not None):
        power = sampled_result(weighing, power, approximate, seed)
    return replace(
        weighing,
        results=tuple(found.get(id(r), r) for r in weighing.results),
        forms=tuple(found.get(id(r), r) for r in weighing.forms),
        power=power,
    )


def sampled_result(
    weighing: Weighing, result: Result, approximate: bool, seed: int = 0, draws: int = DRAWS
) -> Result:
    """A candidate's result with its motions sampled; the same seed gives the same draws of each candidate."""
    parameters, data = result.fit.parameters, weighing.data
    variance = weighing.variance if approximate else result.exact_variance
    model = result.exact if not approximate or result.about is None else result.about.model
    weighed = result.weighed if approximate else result.exact_weighed
    assert weighed is not None
    ratio = likelihood_ratio(result.solver, parameters, result.fit.active, model, data, variance)
    name = "+".join(result.candidate.damping) + "@" + result.candidate.restoring
    found = sampled(
        ratio, weighed, parameters.positive, draws=draws, seed=crc32(name.encode()) + seed % 2**32
    )
    return replace(result, sampled=found)


def likelihood_ratio(
    solver: Solver,
    parameters: Parameters,
    active: np.ndarray,
    model: Linear,
    data: Data,
    variance: float,
) -> Callable[[np.ndarray], np.ndarray]:
    """Log of the likelihood of the motion itself over the linear model's, of draws (n, K): (n,), −∞ where it escapes.

    variance: of the noise that counts, in the record's unit squared.
    """
    d, n = parameters.free.size, solver.knots.size

    def squares(row: np.ndarray) -> float:
        g, h = (np.expm1(row[d : d + n]), row[d + n :]) if row.size > d else (None, None)
        motion = solver.solve(parameters.values(row[:d]), active, g, h, NONE)
        return np.inf if motion is None else float(np.sum((data.y - motion.y) ** 2))

    def ratio(u: np.ndarray) -> np.ndarray:
        exact = np.array(at_once(squares, u))
        linear = np.sum((u @ model.root.T - model.target) ** 2, axis=1) + model.rest
        return 0.5 * (linear - exact) / variance

    return ratio
