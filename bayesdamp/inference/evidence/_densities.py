"""Densities on the folded side of the scores."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model import batches
from bayesdamp.inference.model.target import Target


def folded_log_posterior(target: Target, mode: Mode, y: np.ndarray) -> np.ndarray:
    """The density of scores y, (n, d), of which the folded ones are not negative: they have all the mass of both
    mirror images on one side, log 2 more each."""
    return batches.log_posterior(target, mode.context, y) + np.sum(target.layout.folded) * np.log(2.0)
