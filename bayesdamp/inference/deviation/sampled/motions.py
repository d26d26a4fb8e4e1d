"""The motions of draws, solved no closer than the record's noise asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.gaussian.linear import Weighed
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.sampled.ridge import Ridge
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import NONE, TOLERANCE

LOOSER = (3e-6, 1e-6, 3e-7)
"""Errors of a step, as shares of the amplitude, that are tried in turn."""
APART = 0.05
"""Standard deviations of the whole record's noise that a motion may be off: no parameter moves by more of its own."""
TRIED = 4
"""Draws that this is looked at."""


@dataclass(frozen=True)
class Motions:
    """What a candidate's solver gives for scores, log g and h, to a tolerance, with the correction to `TOLERANCE` that
    one motion needs: the errors of motions that lie near each other are nearly the same (defect correction; H. J.
    Stetter, Numer. Math. 29, 425 (1978))."""

    solver: Solver
    parameters: Parameters | Ridge
    active: np.ndarray
    tolerance: float = TOLERANCE
    correction: np.ndarray | float = 0.0

    def at(self, row: np.ndarray) -> np.ndarray | None:
        """The motion of a draw, (K,), at the samples, (n,); None where it escapes."""
        d, n = self.parameters.free.size, self.solver.knots.size
        p = self.parameters.values(row[:d])
        if not np.all(np.isfinite(p)):
            return None
        g, h = (np.expm1(row[d : d + n]), row[d + n :]) if row.size > d else (None, None)
        motion = self.solver.solve(p, self.active, g, h, NONE, tolerance=self.tolerance)
        return None if motion is None else motion.y + self.correction


def motions_near(
    solver: Solver, parameters: Parameters | Ridge, active: np.ndarray, weighed: Weighed, sd: float
) -> Motions:
    """Motions to the loosest tolerance that keeps draws of the linear posterior within `APART`. sd: of the noise that
    counts, in the record's unit."""
    usual = Motions(solver, parameters, active)
    middle = weighed.means[int(np.argmax(weighed.log_each))]
    rows = [middle, *weighed.draws(parameters.positive, TRIED, np.random.default_rng(0))[0]]
    wanted = [usual.at(row) for row in rows]
    if any(y is None for y in wanted):
        return usual
    for tolerance in LOOSER:
        looser = replace(usual, tolerance=tolerance)
        errors = [
            np.inf if (found := looser.at(row)) is None else y - found
            for row, y in zip(rows, wanted, strict=True)
        ]
        off = [float(np.linalg.norm(error - errors[0])) / sd for error in errors[1:]]
        if all(value < APART for value in off):
            return replace(looser, correction=errors[0])
    return usual
