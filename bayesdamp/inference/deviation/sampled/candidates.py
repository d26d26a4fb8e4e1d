"""The candidates that matter, sampled: posteriors and evidence of the motions themselves, not of a linear model."""

from __future__ import annotations

from dataclasses import replace
from zlib import crc32

import numpy as np

from bayesdamp.inference.deviation.gaussian.tempered import DRAWS, sampled
from bayesdamp.inference.deviation.sampled.motions import motions_near
from bayesdamp.inference.deviation.sampled.reference import reference_of
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.machine.threads import at_once

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
