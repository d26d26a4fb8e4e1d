"""Levenberg–Marquardt for a trajectory with coefficients that are never negative (Moré 1977), over growing windows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from scipy.optimize import nnls

from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.numerics.levenberg_marquardt import Ended, Schedule, search
from bayesdamp.physics.kernel import Motion
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS, TOLERANCE

SCHEDULE, MOST_DAMPING = Schedule(less=0.2, more=8.0, again=1e-6), 1e8
"""How a step's damping changes, and from where on none is tried (conventional)."""
MOST_STEPS, MOST_TRIALS = 40, 1000
"""That are taken, and that are tried."""
ROUGH, CLOSE = 1e-3, 1e-7
"""Relative fall of the sum of squares from which a window's, and the record's, search has ended."""
NOTHING = 0.1
"""Share of the fall that ends a search which a step must promise to be tried."""
LARGEST = 1e100
"""Tangent beyond which a motion depends chaotically on its start, and sums of squares overflow (conventional)."""
FIRST_CYCLES = 2.0
SEARCHED = 1e-7
"""Error of a step, as a share of the amplitude, while a search is under way, and of all tangents: steps short enough
for forces with a corner, which the motion itself need not show (measured: at 1e-6 a bound is a tenth too low)."""


class SolvesMotion(Protocol):
    """What solves the motion of parameters, (k,): an oscillation, or the decay of an amplitude."""

    @property
    def t(self) -> np.ndarray:
        """Times of the values, s, (n,)."""
        ...

    @property
    def frequency(self) -> float:
        """Of the oscillation, rad/s."""
        ...

    @property
    def restoring(self) -> str:
        """The restoring law."""
        ...

    def solve(
        self, p: np.ndarray, active: np.ndarray, *, tangents: int, stop: int | None, tolerance: float | None
    ) -> Motion | None:
        """Return the motion, with tangents by its parameters; None where it escapes."""
        ...


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
    def values(self) -> np.ndarray:
        """All of the motion's parameters at the scores, (k,)."""
        return self.parameters.values(self.z)

    @property
    def squares(self) -> float:
        """Sum of the squared residuals, in the record's unit squared."""
        return float(self.residual @ self.residual)


def nonnegative(root: np.ndarray, target: np.ndarray, positive: np.ndarray) -> np.ndarray:
    """Return the u, (d,), of least |root u − target|² with u ≥ 0 where `positive`; root (n, d)."""
    basis, triangle = np.linalg.qr(root[:, ~positive])
    part, u = root[:, positive], np.zeros(root.shape[1])
    if positive.any():
        u[positive] = nnls(part - basis @ (basis.T @ part), target - basis @ (basis.T @ target))[0]
    u[~positive] = np.linalg.solve(triangle, basis.T @ (target - part @ u[positive]))
    return u


def fit(
    solver: SolvesMotion,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    *,
    noise: float,
    windows: bool = True,
    integrated: bool = True,
) -> Fit | None:
    """The best motion from scores z, (d,); None where every way leads to a motion that escapes.

    noise: a lower bound of the noise's sd in the record's unit, for the weight of the priors. windows: whether the
    record is taken in growing windows from its first two cycles, so that no cycle is skipped. integrated: whether
    motions are integrated, so that a search with long steps goes first.
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
    if not integrated:
        return _search(solver, parameters, active, y, z, noise, None, TOLERANCE)
    rough = _search(solver, parameters, active, y, z, noise, None, SEARCHED)
    if rough is None:
        return None
    before += rough.evaluations
    found = _search(solver, parameters, active, y, rough.z, noise, None, TOLERANCE)
    return None if found is None else replace(found, evaluations=before + found.evaluations)


@dataclass(frozen=True)
class _Window:
    """What is searched: a part of a record, y (n,), by motions that are solved to a tolerance. close: the share by
    which a step must lower the squares for the search to go on."""

    solver: SolvesMotion
    parameters: Parameters
    active: np.ndarray
    y: np.ndarray
    noise: float
    tolerance: float

    @property
    def close(self) -> float:
        """Where the search ends, by how well motions are solved."""
        return CLOSE if self.tolerance == TOLERANCE else ROUGH

    def at(self, z: np.ndarray) -> tuple[np.ndarray, Motion] | None:
        """Residuals and motion at scores; None where it escapes."""
        motion = self._motion(z, NONE, self.tolerance)
        return None if motion is None else (self.y - motion.y, motion)

    def tangents(self, z: np.ndarray) -> np.ndarray | None:
        """Of the motion by the scores, (n, d); None where it escapes, or does not depend on them smoothly."""
        moved = self._motion(z, PARAMETERS, SEARCHED)
        found = None if moved is None else self.parameters.by_scores(moved.tangents, z)
        return None if found is None or not np.abs(found).max() < LARGEST else found

    def _motion(self, z: np.ndarray, tangents: int, tolerance: float) -> Motion | None:
        values = self.parameters.values(z)
        return self.solver.solve(
            values, self.active, tangents=tangents, stop=self.y.size, tolerance=tolerance
        )


@dataclass(frozen=True)
class _Trial:
    """Scores that were tried, with residuals and motion there. gain: the share of the squares that it takes away."""

    z: np.ndarray
    there: tuple[np.ndarray, Motion] | None
    gain: float


@dataclass(frozen=True)
class _Linear:
    """The squares of residuals and of scores, linearised at scores z: |plain u − wanted|² + left. scale: of each score;
    variance: of the noise; number: of points up to this one."""

    window: _Window
    z: np.ndarray
    here: tuple[np.ndarray, Motion]
    jacobian: np.ndarray
    plain: np.ndarray
    wanted: np.ndarray
    left: float
    scale: np.ndarray
    variance: float
    number: int

    @classmethod
    def of(cls, window: _Window, z: np.ndarray, here: tuple[np.ndarray, Motion], number: int) -> Self | None:
        """None where the motion escapes."""
        jacobian = window.tangents(z)
        if jacobian is None:
            return None
        r = here[0]
        variance = max(float(r @ r) / r.size, window.noise**2)
        triangle, target = _triangle(jacobian, r)
        plain = np.concatenate([triangle, np.sqrt(variance) * np.eye(z.size)])
        # Of the prior too: where the motion does not change with a score, the prior alone would send it to 0.
        scale = np.linalg.norm(plain, axis=0)
        wanted = np.concatenate([target + triangle @ z, np.zeros(z.size)])
        left = float(r @ r) - float(target @ target)
        return cls(window, z, here, jacobian, plain, wanted, left, scale, variance, number)

    def cost(self, z: np.ndarray, r: np.ndarray) -> float:
        """The squares at scores with these residuals, by the noise that is thought of here."""
        return float(r @ r) + self.variance * float(z @ z)

    def tried(self, damping: float) -> _Trial | None:
        """The step of a damping; None where it promises too little, or damping is too much."""
        if damping >= MOST_DAMPING:
            return None
        parameters, cost = self.window.parameters, self.cost(self.z, self.here[0])
        root = np.concatenate([self.plain, np.diag(np.sqrt(damping) * self.scale)])
        aim = np.concatenate([self.wanted, np.sqrt(damping) * self.scale * self.z])
        new = nonnegative(root, aim, parameters.positive)
        promised = cost - self.left - float(np.sum((self.plain @ new - self.wanted) ** 2))
        if promised < NOTHING * self.window.close * cost:
            return None
        new = parameters.retracted(self.window.solver.restoring, self.z, new)
        there = self.window.at(new)
        after = np.inf if there is None else self.cost(new, there[0])
        return _Trial(new, there, (cost - after) / cost if after < cost else -np.inf)

    def beyond(self, trial: _Trial) -> Self | None:
        """Linearised where a step leads."""
        assert trial.there is not None  # it gained
        return self.of(self.window, trial.z, trial.there, self.number + 1)


def _search(
    solver: SolvesMotion,
    parameters: Parameters,
    active: np.ndarray,
    y: np.ndarray,
    z: np.ndarray,
    noise: float,
    stop: int | None,
    tolerance: float,
) -> Fit | None:
    window = _Window(solver, parameters, active, y[:stop], noise, tolerance)
    here = window.at(z)
    first = None if here is None else _Linear.of(window, z, here, 1)
    if first is None:
        return None
    count = 1

    def ended(near: _Linear, trial: _Trial, damping: float) -> bool:
        nonlocal count
        count += 1
        return trial.gain >= 0 and (trial.gain < window.close or near.number == MOST_STEPS)

    found: Ended[_Linear, _Trial] = search(first, ended, limit=MOST_TRIALS, schedule=SCHEDULE)
    if found.near is None:
        return None
    z, (r, motion) = found.near.z, found.near.here
    if found.taken is not None and found.taken.there is not None:
        z, (r, motion) = found.taken.z, found.taken.there
    return Fit(parameters, active, z, r, found.near.jacobian, motion, count)


def _triangle(jacobian: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and Qᵀr of the tangents, (d, d) and (d,)."""
    whole = np.asarray(np.linalg.qr(np.column_stack([jacobian, r]), mode="r"))
    d = jacobian.shape[1]
    return whole[:d, :d], whole[:d, d]
