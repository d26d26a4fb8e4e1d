"""The posterior mode, from seeds, and the shape of the posterior there."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from bayesdamp.inference.compiled import compiled
from bayesdamp.inference.residuals import log_density, residual, residuals
from bayesdamp.inference.retraction import Retract, retraction, straight_on
from bayesdamp.inference.target import Context, Layout, Target
from bayesdamp.physics.integrate import MeshPlan, Plan, anchored, finer
from bayesdamp.types import Refusal

BUDGET = 0.01
"""Largest change of the log likelihood (nats) that finer steps of the solver may make within NEAR sds of the mode;
farther down than there it may grow with the depth."""
NEAR = 3.0
"""Posterior sds from the mode."""
COARSEST = 0.05
"""Error of the solver's steps at the mode, in units of the noise, with which one begins: plans are set right there, and
around it only a share of this remains."""
FINER = 5
"""Parts of a step on which its error is measured and set right; a method of order six leaves 6e-5 of it."""
ANCHORS = 4
"""Plans that one seed's climb may take."""
MOST_LEFT = 1.5
"""What a mode may leave of a record, in standard deviations of that; a motion out of step leaves √2, and more
is left where slow noise stands in for another zero."""
IN_STEP = 0.3
"""What a trajectory that keeps step leaves at most, in the same unit, or a little more than the noise."""
FEWEST = 8
"""Samples that a window must have."""
SAME = 1e-4
"""Scores within which what grew from two seeds is one start."""
GROWN = ", over growing windows"
"""What the name of such a seed ends with."""
CLOSE = 1e-3
"""Posterior sds from which on a step ends a climb, if what it gains, in nats, is less than its cube."""
ROUGHLY = 0.1
"""The same where a mode is only compared with another: of a part of a record, of a window that grows."""
WALL = 1e-9
"""Where a folded score stops in place of zero, at which it has no slope."""


@dataclass(frozen=True)
class Climb:
    """One seed's way to a mode: where it started and ended (scores, log posterior), and what it cost.

    seed: its name; same: names of the seeds that start at the same place and were not climbed again.
    origin, z: scores at the start and the end, (d,). volume: log of the square root of the determinant of the inverse
    information at the end, by which modes are weighed.
    """

    seed: str
    same: tuple[str, ...]
    start: float
    end: float
    evaluations: int
    origin: np.ndarray
    z: np.ndarray
    volume: float
    converged: bool


@dataclass(frozen=True)
class Mode:
    """A posterior mode in scores.

    z: shape (d,); information: Gauss–Newton Hessian of −log posterior there, (d, d); factor: its inverse's
    Cholesky factor, (d, d), which whitens; step_error, likelihood_error: what finer steps of the solver change
    within three sds of the mode, in the unit of the record and in nats.
    """

    z: np.ndarray
    log_posterior: float
    information: np.ndarray
    factor: np.ndarray
    context: Context
    climbs: tuple[Climb, ...]
    step_error: float
    likelihood_error: float
    tolerance: float

    def sd(self) -> np.ndarray:
        """Laplace standard deviations of the scores, shape (d,)."""
        return np.sqrt(np.sum(self.factor**2, axis=1))


def climb(
    layout: Layout,
    context: Context,
    z: np.ndarray,
    *,
    limit: int = 60,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> tuple[np.ndarray, float, np.ndarray, int, bool]:
    """Levenberg–Marquardt on the log posterior: z, its value, the information, evaluations, converged."""
    curvature = compiled(layout).curvature

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        value, gradient, information = map(np.asarray, curvature(context, z))
        return value, gradient, information

    return maximise(at, np.asarray(layout.folded), z, limit=limit, retract=retract, close=close)


def maximise(
    curvature: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    folded: np.ndarray,
    z: np.ndarray,
    *,
    limit: int = 60,
    retract: Retract = straight_on,
    close: float = CLOSE,
) -> tuple[np.ndarray, float, np.ndarray, int, bool]:
    """`climb` on any log density of scores, (d,), of which the folded ones, (d,) of bool, end at zero.

    curvature: z to log density, gradient (d,) and information (d, d). retract: where steps end. close: as `CLOSE`.
    """
    z = np.where(folded, np.maximum(np.abs(z), WALL), z)
    value, gradient, information = curvature(z)
    damping, evaluations = 1e-3, 1
    for _ in range(limit):
        if not np.isfinite(value) or not np.all(np.isfinite(information)):
            return z, -np.inf, np.eye(z.size), evaluations, False
        # A folded score ends at zero: where the slope holds it there, the others move without it.
        free = np.flatnonzero(~(folded & (z <= WALL) & (gradient <= 0)))
        inner = information[np.ix_(free, free)]
        move = np.zeros_like(z)
        move[free] = np.linalg.solve(inner + damping * np.diag(np.diag(inner)), gradient[free])
        move *= min(1.0, 3.0 / max(np.abs(move).max(), 1e-300))
        ahead = retract(z, move)
        trial = np.where(folded, np.maximum(ahead, WALL), ahead)
        expected = float(move @ gradient)  # of a step that no wall cuts short: that may point downwards
        move = trial - z
        new = curvature(trial)
        evaluations += 1
        gain = float(new[0] - value) if np.isfinite(new[0]) else -np.inf
        if gain >= 0:
            step = np.sqrt(max(float(move @ information @ move), 0.0))
            z, (value, gradient, information) = trial, new
            damping = max(damping / 5, 1e-12)
            if gain < close**3 * max(1.0, abs(float(value)) * 1e-3) and step < close:
                return z, float(value), information, evaluations, True
        else:
            if expected < 1e-7 or damping > 1e12:
                return z, float(value), information, evaluations, True
            damping = max(damping, 1e-9) * 6
    return z, float(value), information, evaluations, False


def _with_noise(target: Target, z: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Scores (d,) with the noise parameters read from the residuals (n,) there."""
    layout = target.layout
    if not np.all(np.isfinite(r)):
        return z
    start = target.scores(layout.noise.start(r, np.diff(target.signal.t)))
    return np.asarray(
        [start[i] if n in layout.noise.parameters else z[i] for i, n in enumerate(target.names)]
    )


def find_mode(
    target: Target,
    seeds: Mapping[str, Mapping[str, float]],
    *,
    noise_level: float,
    period: float | None = None,
    thrifty: bool = False,
) -> Mode:
    """The highest mode that the seeds reach.

    seeds: name of a seed to parameter values in natural units. noise_level: the record's roughness, which
    sets how well trajectories are first computed. period: the oscillation's, s; with one, where no seed leads to a
    motion that keeps step with the record, the search goes on over a window that grows from two cycles. thrifty:
    seeds are climbed from only until one leads to such a motion: those that keep step already, then the others over
    growing windows, then these as they are.
    Raises Refusal where no seed reaches a finite posterior with a curvature, or the noise takes the motion's place in
    all that do.
    """
    # A first guess; `_settle` measures what the steps do to the likelihood and shortens them where they must be.
    tolerance = COARSEST * noise_level
    if target.exact_friction:  # its plans cannot be anchored
        tolerance = 0.5 * noise_level / np.sqrt(target.signal.t.size)
    size = float(np.std(target.signal.y))
    in_step = max(IN_STEP * size, 1.5 * noise_level)
    climbs: list[Climb] = []
    ends: list[tuple[float, np.ndarray]] = []
    displaced = False
    begun = [_begun(target, names, z, tolerance) for names, z in _distinct(target, seeds)]
    keeps, grown = False, _grown(target, begun, tolerance, period)
    stages: list[Iterable[_Begun]] = [begun, grown]
    if thrifty:
        near = sorted((b for b in begun if b.left < in_step), key=lambda b: -b.value)
        stages = [near, grown, [b for b in begun if not b.left < in_step]]
    for stage in stages:
        if keeps:  # and nothing of the next stage is computed
            break
        for names, z0, context, start, _ in stage:
            z, value, information, count, done = _ascend(target, context, z0, tolerance)
            volume = -0.5 * float(np.linalg.slogdet(information)[1])
            climbs.append(Climb(names[0], tuple(names[1:]), start, value, count, z0, z, volume, done))
            if not np.isfinite(value):
                continue
            left = _left(target, z, tolerance)
            if left > MOST_LEFT * size:
                displaced = True
                continue
            ends.append((value, z))
            keeps = keeps or left < in_step
            if thrifty and keeps:
                break
    if not ends and displaced:
        raise Refusal(
            "set aside: noise takes the motion's place: the likeliest trajectory is farther from the record than its "
            "mean is"
        )
    said = Refusal("no seed leads to a trajectory with a finite likelihood")
    for _, z in sorted(ends, key=lambda end: -end[0]):
        try:
            return _settle(target, z, tolerance, tuple(climbs))
        except Refusal as refusal:
            said = refusal
    raise said


class _Begun(NamedTuple):
    """A seed's names, its scores (d,) with the noise that they leave, a plan there, the log posterior and the root mean
    square of what is left of the record."""

    names: list[str]
    z: np.ndarray
    context: Context
    value: float
    left: float


def _begun(
    target: Target, names: list[str], z: np.ndarray, tolerance: float, stepped: bool = False
) -> _Begun:
    context = target.context(_plans(target, z, tolerance, stepped)[0])
    r = residual(target, context.plan, z)
    z = _with_noise(target, z, r)
    value = float(compiled(target.layout).curvature(context, z)[0])
    return _Begun(names, z, context, value, _size(r))


def _grown(
    target: Target, begun: Sequence[_Begun], tolerance: float, period: float | None
) -> Iterator[_Begun]:
    """Each seed taken along a window that grows from two cycles to the whole record: a frequency that is a little off
    loses step over many cycles, and a likelihood knows no way back from there."""
    if period is None:
        return
    t, y = target.signal.t, target.signal.y
    found: list[np.ndarray] = []
    for one in begun:
        z, window = one.z, 2.0 * period
        while window < t[-1]:
            keep = int(np.searchsorted(t, window))
            window *= 2
            if keep < FEWEST:  # a gap
                continue
            part = replace(target, signal=replace(target.signal, t=t[:keep], y=y[:keep]))
            # In steps: these share programs, whatever the number of samples.
            there = _begun(part, one.names, z, tolerance, stepped=True)
            z, value, *_ = climb(part.layout, there.context, there.z, retract=retraction(part), close=ROUGHLY)
            if not np.isfinite(value):
                break
        else:
            if not any(np.max(np.abs(z - other)) < SAME for other in found):
                found.append(z)
                yield _begun(target, [f"{name}{GROWN}" for name in one.names], z, tolerance)


def _left(target: Target, z: np.ndarray, tolerance: float) -> float:
    """Root mean square of what the trajectory at scores z, (d,), leaves of the record."""
    return _size(residual(target, target.plan(z, tolerance)[0], z))


def _size(r: np.ndarray) -> float:
    return float(np.sqrt(np.mean(r**2)))


def _ascend(
    target: Target, context: Context, z: np.ndarray, tolerance: float
) -> tuple[np.ndarray, float, np.ndarray, int, bool]:
    """`climb`, and again with a plan made where it ended while that is far from where it began: so are all modes
    compared on plans that are right at them. The scores, their log posterior, information, evaluations, converged."""
    evaluations, attempts, retract = 0, 0, retraction(target)
    while True:
        attempts += 1
        before = z
        z, value, information, count, done = climb(target.layout, context, before, retract=retract)
        evaluations += count
        near = (z - before) @ information @ (z - before) < NEAR**2
        if near or not np.isfinite(value) or attempts == ANCHORS:
            return z, value, information, evaluations, done
        context = target.context(_plans(target, z, tolerance)[0])


def _distinct(
    target: Target, seeds: Mapping[str, Mapping[str, float]]
) -> Sequence[tuple[list[str], np.ndarray]]:
    """Seeds as scores, (d,), each with the names of those that start there: refined estimates that agree are
    climbed once."""
    found: list[tuple[list[str], np.ndarray]] = []
    for name, values in seeds.items():
        z = target.scores(values)
        there = next((names for names, other in found if np.max(np.abs(z - other)) <= 1e-6), None)
        if there is None:
            found.append(([name], z))
        else:
            there.append(name)
    return found


def _settle(target: Target, z: np.ndarray, tolerance: float, climbs: tuple[Climb, ...]) -> Mode:
    """Plan the solver at the mode until finer steps change the likelihood by less than the budget."""
    attempts = 0
    while True:
        attempts += 1
        plan, finer, error = _plans(target, z, tolerance)
        context = target.context(plan)
        z, value, information, _, _ = climb(target.layout, context, z)
        if not np.isfinite(value):
            raise Refusal("the posterior is not finite at its mode")
        factor = whitening(information)
        moved, change = _step_errors(target, plan, finer, z, factor)
        if change < BUDGET or attempts == 6:
            break
        tolerance = min(tolerance, error) * np.clip(BUDGET / change, 1e-3, 0.5) * 0.5
    return Mode(z, value, information, factor, context, climbs, moved, change, tolerance)


def _plans(
    target: Target, z: np.ndarray, tolerance: float, stepped: bool = False
) -> tuple[Plan, Plan, float]:
    """A plan within `tolerance` at z, set right there by a much finer one; that one; the error it was set right by."""
    plan, error = target.plan(z, tolerance, stepped)
    osc, signal, values = target.oscillator, target.signal, target.all_values(z)
    fine = finer(osc, plan, values, FINER, signal.t, signal.quantity)
    return anchored(osc, plan, fine, values), fine, error


def mesh_of(target: Target, mode: Mode) -> MeshPlan:
    """A mode's plan where that is in steps; else one at the mode that is. Not of exact friction."""
    plan = mode.context.plan
    if not isinstance(plan, MeshPlan):
        plan, _ = target.plan(mode.z, mode.tolerance, stepped=True)
    assert isinstance(plan, MeshPlan)
    return plan


def _step_errors(
    target: Target, plan: Plan, finer: Plan, z: np.ndarray, factor: np.ndarray
) -> tuple[float, float]:
    """What finer steps change (unit of the record, nats) at z and three sds from it in each whitened direction."""
    top: float | None = None
    moved = change = 0.0
    around = z + np.concatenate([np.zeros((1, z.size)), NEAR * factor.T, -NEAR * factor.T])
    both = zip(residuals(target, plan, around), residuals(target, finer, around), strict=True)
    for at, (coarse, fine) in zip(around, both, strict=True):
        lower, upper = log_density(target, coarse, at), log_density(target, fine, at)
        top = upper - 0.5 * float(at @ at) if top is None else top
        if not (np.isfinite(lower) or np.isfinite(upper)):
            continue
        depth = top - (upper - 0.5 * float(at @ at))
        change = max(change, abs(lower - upper) * min(1.0, 0.5 * NEAR**2 / max(depth, 1e-300)))
        moved = max(moved, float(np.max(np.abs(coarse - fine))))
    return moved, change


def mode_near(layout: Layout, context: Context, mode: Mode, z: np.ndarray) -> Mode:
    """The mode of another posterior close by, such as one of a part of the record: from scores z, (d,), on the same
    steps. Raises Refusal where it is not finite."""
    z, value, information, _, _ = climb(layout, context, z)
    if not np.isfinite(value):
        raise Refusal("the posterior is not finite at its mode")
    factor = whitening(information)
    return replace(mode, z=z, log_posterior=value, information=information, factor=factor, context=context)


def whitening(information: np.ndarray) -> np.ndarray:
    """Cholesky factor of the inverse of the information, (d, d). Raises Refusal where that is not positive.

    Factored before it is inverted: an inverse of stiff and loose directions may have lost its positivity to rounding.
    """
    try:
        if not np.all(np.isfinite(information)):
            raise np.linalg.LinAlgError
        turned = np.linalg.cholesky(0.5 * (information + information.T)[::-1, ::-1])
    except np.linalg.LinAlgError:
        raise Refusal("the posterior has no curvature at its mode") from None
    return solve_triangular(turned[::-1, ::-1], np.eye(len(information)), trans=1, lower=False)


def restore_mode(
    target: Target,
    z: np.ndarray,
    log_posterior: float,
    information: np.ndarray,
    tolerance: float,
    climbs: tuple[Climb, ...] = (),
) -> Mode:
    """A mode from what was stored of it: the plan of the solver is made anew at z."""
    context = target.context(_plans(target, z, tolerance)[0])
    factor = whitening(information)
    return Mode(z, log_posterior, information, factor, context, climbs, np.nan, np.nan, tolerance)
