"""Shares of the energy that was lost, by term, from draws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayesdamp.inference.deviation.numbers.curves import acting
from bayesdamp.inference.deviation.numbers.draws import Drawn
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.damping import TERMS

POINTS, FEW = 4000, 500
"""Times over a motion at which the power is taken; where that is done draw by draw."""


def work_of(
    weighing: Weighing, result: Result, row: np.ndarray | None = None, points: int = POINTS
) -> np.ndarray:
    """Work of each term per unit of its coefficient over the record's own motion, (m,). row: further parameters."""
    solver, motion = weighing.solvers[result.candidate.restoring], result.motion
    at = np.linspace(motion.times[0], motion.times[-1], points)
    x, v = (np.interp(at, motion.times, motion.states[:, i]) for i in (0, 1))
    known, found = acting(weighing, result, row), np.zeros(len(solver.terms))
    for i, name in enumerate(solver.terms):
        term = TERMS.get(name)
        if all(n in known for n in term.further):
            force = term.at(known)
            found[i] = np.mean(
                [abs(force(float(a), float(s), solver.epsilon) * float(s)) for a, s in zip(x, v, strict=True)]
            )
    return found


def shares_of(weighing: Weighing, drawn: Sequence[Drawn]) -> np.ndarray:
    """Share of the dissipated energy by term, (draws, m)."""
    found = []
    for d in drawn:
        each = d.coefficients * _works(weighing, d)
        found.append(each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(found)


def _works(weighing: Weighing, d: Drawn) -> np.ndarray:
    """Work per unit of each coefficient, (n, m) or (1, m)."""
    solver = weighing.solvers[d.result.candidate.restoring]
    if not set(solver.inferred) & set(d.result.fit.parameters.free_names):
        return work_of(weighing, d.result)[None, :]
    rows, place = np.unique(d.further, axis=0, return_inverse=True)
    return np.array([work_of(weighing, d.result, row, FEW) for row in rows])[place.ravel()]
