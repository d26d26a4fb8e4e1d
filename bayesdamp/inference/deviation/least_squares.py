"""Levenberg–Marquardt for a trajectory with coefficients that are never negative (Moré 1977), over growing windows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from bayesdamp.inference.deviation.parameters import Parameters, retracted
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS, TOLERANCE

FIRST_DAMPING, MORE, LESS, MOST_DAMPING = 1e-3, 8.0, 0.2, 1e8
"""Damping of a step: at first, by what it grows where a step fails and shrinks where it succeeds, and where the search
ends (conventional)."""
MOST_STEPS = 40
ROUGH, CLOSE = 1e-3, 1e-7
"""Relative fall of the sum of squares from which a window's, and the record's, search has ended."""
NOTHING = 0.1
"""Share of the fall that ends a search which a step must promise to be tried."""
FIRST_CYCLES = 2.0
SEARCHED = 1e-6
"""Error of a step, as a share of the amplitude, while a search is under way, and of all tangents: a third of
the time (measured)."""


@dataclass(frozen=True)
class Fit:
    """A candidate's best motion under exact laws.

    z: scores, (d,); residual: record minus motion, (n,), in the record's unit; tangents: of the motion by the scores,
    (n, d); evaluations: motions solved on the way.
    """

    parameters: Parameters
    active: np.ndarray
    z: np.ndarray
    residual: np.ndarray
    tangents: np.ndarray
    motion: Motion
    evaluations: int

    @property
    def squares(self) -> float:
        """Sum of the squared residuals, in the record's unit squared."""
        return float(self.residual @ self.residual)


def nonnegative(root: np.ndarray, target: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """The u, (d,), of least |root u − target|² with u ≥ 0 where `positive`, root (n, d): each set of zeros is tried."""
    best, found = np.inf, np.zeros(root.shape[1])
    places = np.flatnonzero(positive)
    for zeros in product((False, True), repeat=places.size):
        free = np.ones(root.shape[1], bool)
        free[places[np.array(zeros, bool)]] = False
        u = np.zeros(root.shape[1])
        u[free] = np.linalg.lstsq(root[:, free], target, rcond=None)[0]
        if np.any(u[places] < 0):
            continue
        left = float(np.sum((root @ u - target) ** 2))
        if left < best:
            best, found = left, u
        if not any(zeros):  # nothing can be better
            break
    return found


def fit(
    solver: Solver,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    *,
    noise: float,
    windows: bool = True,
) -> Fit | None:
    """The best motion from scores z, (d,); None where every way leads to a motion that escapes.

    noise: a lower bound of the noise's sd in the record's unit, for the weight of the priors. windows: whether the
    record is taken in growing windows from its first two cycles, so that no cycle is skipped.
    """
    period = 2 * np.pi / solver.frequency
    stops: list[int] = []
    span = FIRST_CYCLES * period
    while windows and span < 0.7 * solver.t[-1]:
        stop = int(np.searchsorted(solver.t, span))
        if stop >= 3 * z.size:
            stops.append(stop)
        span *= 2
    before = 0
    for stop in stops:
        part = _search(solver, parameters, active, y, z, noise, stop, SEARCHED)
        if part is None:
            return None
        z, before = part.z, before + part.evaluations
    rough = _search(solver, parameters, active, y, z, noise, None, SEARCHED)
    if rough is None:
        return None
    before += rough.evaluations
    found = _search(solver, parameters, active, y, rough.z, noise, None, TOLERANCE)
    return None if found is None else replace(found, evaluations=before + found.evaluations)


def _search(
    solver: Solver,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    noise: float,
    stop: int | None,
    tolerance: float,
) -> Fit | None:
    y = y[:stop]

    def at(z: np.ndarray) -> tuple[np.ndarray, Motion] | None:
        motion = solver.solve(parameters.values(z), active, tangents=NONE, stop=stop, tolerance=tolerance)
        return None if motion is None else (y - motion.y, motion)

    here = at(z)
    if here is None:
        return None
    (r, motion), jacobian = here, np.zeros((y.size, 0))
    damping, count, close = FIRST_DAMPING, 1, CLOSE if tolerance == TOLERANCE else ROUGH
    for _ in range(MOST_STEPS):
        moved = solver.solve(parameters.values(z), active, tangents=PARAMETERS, stop=stop, tolerance=SEARCHED)
        if moved is None:
            return None
        jacobian = parameters.by_scores(moved.tangents, z)
        variance = max(float(r @ r) / r.size, noise**2)
        cost = float(r @ r) + variance * float(z @ z)
        triangle, target = _triangle(jacobian, r)
        plain = np.concatenate([triangle, np.sqrt(variance) * np.eye(z.size)])
        # Of the prior too: where the motion does not change with a score, the prior alone would send it to 0.
        scale = np.linalg.norm(plain, axis=0)
        wanted = np.concatenate([target + triangle @ z, np.zeros(z.size)])
        left = float(r @ r) - float(target @ target)
        fall = 0.0
        while damping < MOST_DAMPING:
            root = np.concatenate([plain, np.diag(np.sqrt(damping) * scale)])
            new = nonnegative(
                root, np.concatenate([wanted, np.sqrt(damping) * scale * z]), parameters.positive
            )
            promised = cost - left - float(np.sum((plain @ new - wanted) ** 2))
            if promised < NOTHING * close * cost:
                break
            new = retracted(parameters, solver.restoring, z, new)
            there, count = at(new), count + 1
            after = np.inf if there is None else float(there[0] @ there[0]) + variance * float(new @ new)
            if there is not None and after < cost:
                fall, z, (r, motion) = (cost - after) / cost, new, there
                damping = max(damping * LESS, 1e-12)
                break
            damping = max(damping, 1e-6) * MORE
        if fall < close:
            break
    return Fit(parameters, active, z, r, jacobian, motion, count)


def _triangle(jacobian: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and Qᵀr of the tangents, (d, d) and (d,)."""
    whole = np.asarray(np.linalg.qr(np.column_stack([jacobian, r]), mode="r"))
    d = jacobian.shape[1]
    return whole[:d, :d], whole[:d, d]
