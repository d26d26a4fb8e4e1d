"""From scores to the top of the posterior that they are below."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.numerics.levenberg_marquardt import (
    HIGHEST,
    Expansion,
    Maximum,
    Retract,
    Step,
    levenberg_marquardt,
    straight_on,
)

CLOSE = 1e-3
"""Posterior sds from which on a step ends a search, if what it gains, in nats, is less than its cube."""
ROUGHLY = 0.1
"""The same where a mode is only compared with another: of a part of a record, of a window that grows."""
WALL = 1e-9
"""Where a reflected score stops in place of zero, at which it has no slope."""
LONGEST = 3.0
"""Scores that a step may change by: a prior's sds."""
HOPELESS = 1e-7
"""Nats: what a step that fails must have promised for the search to go on with a shorter one."""
STEPS = 60


def maximise_posterior(
    likelihood: Likelihood,
    z: np.ndarray,
    *,
    limit: int = STEPS,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> Maximum:
    """Climb to the mode of a posterior from scores z, (d,). retract: where steps end. close: as `CLOSE`.

    Every score has the prior N(0, 1) here: a scale that coefficients share is held at 1. Averaged over all scales the
    prior is highest where all these coefficients are 0, and searches would end there on records of little damping.
    """
    reflected = likelihood.target.reflected
    return maximise(likelihood.held(1.0).curvature, reflected, z, limit=limit, retract=retract, close=close)


def maximise(
    curvature: Callable[[np.ndarray], tuple[float, np.ndarray, np.ndarray]],
    reflected: np.ndarray,
    z: np.ndarray,
    *,
    limit: int = STEPS,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> Maximum:
    """`maximise_posterior` on any log density of scores, (d,), of which the reflected ones, (d,) of bool, end at zero.

    curvature: z to log density, gradient (d,) and information (d, d).
    """

    def expand(z: np.ndarray) -> Expansion:
        value, gradient, information = curvature(z)
        return Expansion(float(value), gradient, information)

    def ended(step: Step) -> bool:
        if step.gain < 0:
            return step.expected < HOPELESS or step.damping > HIGHEST
        size = np.sqrt(max(float(step.move @ step.at.information @ step.move), 0.0))
        value = step.at.value + step.gain
        return bool(step.gain < close**3 * max(1.0, abs(value) * 1e-3) and size < close)

    start = np.where(reflected, np.abs(z), z)
    floor = np.where(reflected, WALL, -np.inf)
    found = levenberg_marquardt(expand, start, floor, ended, limit=limit, longest=LONGEST, retract=retract)
    return found if np.isfinite(found.value) else replace(found, converged=False)
