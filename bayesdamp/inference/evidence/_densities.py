"""Densities on the reflected side of the scores."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target


def reflected_log_posterior(target: Target, mode: Mode, y: np.ndarray) -> np.ndarray:
    """The density of scores y, (n, d), of which the reflected ones are not negative: they have all the mass of both
    mirror images on one side, log 2 more each."""
    found = mode.likelihood.log_posteriors(y)
    return np.where(np.isfinite(found), found, -np.inf) + np.sum(target.reflected) * np.log(2.0)
