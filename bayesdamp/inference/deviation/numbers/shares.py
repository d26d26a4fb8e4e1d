"""Shares of the energy that was lost, by term, from draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayesdamp.inference.deviation.numbers.draws import Drawn
from bayesdamp.inference.deviation.weighing import Weighing

POINTS = 4000
"""Times over a motion at which the power is taken."""


def shares_of(weighing: Weighing, drawn: Sequence[Drawn]) -> np.ndarray:
    """Share of the dissipated energy by term, (draws, m)."""
    found = []
    for d in drawn:
        each = d.coefficients * _works(weighing, d)
        found.append(each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(found)


def _works(weighing: Weighing, d: Drawn) -> np.ndarray:
    """Mean power per unit of each coefficient over the record's own motion, (n, m) or (1, m)."""
    from bayesdamp.physics.kernel.dense import at_times

    solver, motion = weighing.solvers[d.result.candidate.restoring], d.result.motion
    at = np.linspace(motion.times[0], motion.times[-1], POINTS)
    x, v = (at_times(motion.times, motion.states, at, order) for order in (0, 1))
    return d.by_further(lambda rows: solver.works(x, v, v / POINTS, rows, d.result.fit.active))
