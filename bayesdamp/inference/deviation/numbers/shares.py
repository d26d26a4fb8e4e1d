"""Shares of the energy that was lost, by term, from draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayesdamp.inference.deviation.numbers.draws import Drawn
from bayesdamp.inference.deviation.weighing import Result, Weighing

POINTS = 4000
"""Times over a motion at which the power is taken."""


def power_of(weighing: Weighing, result: Result, further: np.ndarray) -> np.ndarray:
    """Mean power of each term per unit of its coefficient over the record's own motion, (d, m), for rows of further
    parameters, (d, e)."""
    from bayesdamp.physics.kernel.dense import at_times

    solver, motion = weighing.solvers[result.candidate.restoring], result.motion
    at = np.linspace(motion.times[0], motion.times[-1], POINTS)
    x, v = (at_times(motion.times, motion.states, at, order) for order in (0, 1))
    return solver.works(x, v, v / POINTS, further, result.fit.active)


def shares_of(weighing: Weighing, drawn: Sequence[Drawn]) -> np.ndarray:
    """Share of the dissipated energy by term, (draws, m)."""
    found = []
    for d in drawn:
        each = d.coefficients * _works(weighing, d)
        found.append(each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(found)


def _works(weighing: Weighing, d: Drawn) -> np.ndarray:
    """Mean power per unit of each coefficient, (n, m) or (1, m)."""
    rows, place = np.unique(d.further, axis=0, return_inverse=True)
    found = power_of(weighing, d.result, rows)
    return found[place.ravel()] if len(rows) > 1 else found
