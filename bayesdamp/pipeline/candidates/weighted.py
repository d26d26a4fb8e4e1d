"""Damping against amplitude of a candidate that was weighed but not sampled, from the draws of its evidence."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.curves.derived import CURVE_DRAWS, Motions
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import curves
from bayesdamp.types import OK


def weighted_curves(branch: Branch, seed: int) -> dict[str, np.ndarray]:
    """What a posterior's cell has of its curves; empty where the candidate has no importance draws to be trusted."""
    cell = branch.store.find(f"evidence/{branch.path}/importance")
    if cell is None or cell.outcome != OK or "log_weights" not in cell.arrays:
        return {}
    chosen = resampled(cell.arrays["log_weights"].astype(float), CURVE_DRAWS, np.random.default_rng(seed))
    inferred = branch.target.values(cell.arrays["y"].astype(float)[chosen])
    values = {**branch.target.known, **inferred}
    seen, oscillator = branch.record.seen, branch.target.oscillator
    own = {n: values[n] for n in oscillator.inputs}
    return curves(Motions(oscillator, own, seen.rest, seen.amplitude), seen)
