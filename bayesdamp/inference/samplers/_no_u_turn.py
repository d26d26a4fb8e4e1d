"""One transition of the no-U-turn sampler between walls (M. D. Hoffman and A. Gelman, JMLR 15, 2014), with multinomial
choice among the points of a trajectory (M. Betancourt, arXiv:1701.02434, 2017, appendix A.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.coordinates.whitening import Whitening
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood, Line

DOUBLINGS = 7
"""A trajectory has at most 2⁷ steps."""
DIVERGED = 1000.0
"""Rise of the energy that ends a trajectory (conventional)."""
BOUNCES = 4
"""Bounces in one step, for each wall; a step that would take more ends outside, where it is refused."""


@dataclass(frozen=True)
class Whitened:
    """A log density in whitened coordinates u, (d,), and the force that moves proposals.

    Attributes
    ----------
    likelihood : Likelihood
        Whose posterior it is.
    at : Whitening
        Maps coordinates to scores.
    line : Line or None
        The motion's straight line that the force is taken from; None for the exact gradient.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        walls @ u + offsets ≥ 0 inside.
    """

    likelihood: Likelihood
    at: Whitening
    line: Line | None
    walls: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, mode: Mode, at: Whitening, exact: bool) -> Whitened:
        """Return the posterior of a mode's target; exact: whether the force is its gradient."""
        likelihood = mode.likelihood
        line = None if exact else likelihood.line(at.shear.scores(at.centre))
        reflected = likelihood.target.reflected
        return cls(likelihood, at, line, at.factor[reflected], at.centre[reflected])

    def height(self, u: np.ndarray) -> float:
        """Return the log density; −∞ where the motion escapes."""
        return self.likelihood.log_posterior(self.at.scores(u))

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return the force, (d,)."""
        at, shear = self.at, self.at.shear
        away = at.factor @ u
        if self.line is None:
            straight = at.centre + away
            pull = self.likelihood.gradient(shear.scores(straight))[1] @ shear.slope(straight)
        else:
            # A straight line stays one: straightened, the ridge is where it has it.
            level = shear.level(at.centre) + away
            along = self.likelihood.gradient_along(self.line, shear.noise.sheared(level))
            pull = along @ shear.noise.slope(level) - at.lacking @ away
        return pull @ at.factor


@dataclass(frozen=True)
class Point:
    """A point of a trajectory: position, momentum and force, (d,) each, and the log density."""

    u: np.ndarray
    p: np.ndarray
    slope: np.ndarray
    height: float

    @property
    def joint(self) -> float:
        """Log density of position and momentum."""
        return self.height - 0.5 * float(self.p @ self.p)


@dataclass
class _Tree:
    """A part of a trajectory: its ends in time, the point that is chosen of it, the log of the sum of its densities,
    the sum of its momenta, and whether it goes on."""

    first: Point
    last: Point
    chosen: Point
    weight: float
    momentum: np.ndarray
    goes_on: bool


class Chain:
    """A Markov chain in a space, with steps of a length."""

    def __init__(self, space: Whitened, step: float, rng: np.random.Generator) -> None:
        self.space, self.step, self.rng = space, step, rng

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Return positions (count, d), heights, divergences, steps and acceptance, (count,) each, from a start u, (d,),
        of this height on."""
        left = (
            np.empty((count, u.size)),
            np.empty(count),
            np.empty(count, bool),
            np.empty(count, int),
            np.empty(count),
        )
        at = Point(u, np.zeros(u.size), self.space.slope(u), height)
        for i in range(count):
            at, *rest = self.transition(at)
            for into, value in zip(left, (at.u, at.height, *rest), strict=True):
                into[i] = value
        return left

    def transition(self, at: Point) -> tuple[Point, bool, int, float]:
        """Return the next point, whether the trajectory diverged, its steps, and the mean acceptance."""
        at = Point(at.u, self.rng.standard_normal(at.u.size), at.slope, at.height)
        self._begun, self._steps, self._accepted, self._diverged = at.joint, 0, 0.0, False
        tree = _Tree(at, at, at, at.joint, at.p.copy(), True)
        for doubling in range(DOUBLINGS):
            ahead = bool(self.rng.random() < 0.5)
            new = self._built(tree.last if ahead else tree.first, 1 if ahead else -1, doubling)
            if not new.goes_on:
                break
            if np.log(self.rng.random()) < new.weight - tree.weight:
                tree.chosen = new.chosen
            tree = self._joined(tree, new, ahead, tree.chosen)
            if not tree.goes_on:
                break
        return tree.chosen, self._diverged, self._steps, self._accepted / max(self._steps, 1)

    def _built(self, end: Point, way: int, depth: int) -> _Tree:
        """Return 2^depth further points beyond an end of the trajectory; fewer where it does not go on."""
        if depth == 0:
            point = self._stepped(end, way)
            joint = point.joint if np.isfinite(point.height) else -np.inf
            self._steps += 1
            self._accepted += float(np.exp(min(0.0, joint - self._begun)))
            diverged = not joint > self._begun - DIVERGED
            self._diverged = self._diverged or diverged
            return _Tree(point, point, point, joint, point.p, not diverged)
        near = self._built(end, way, depth - 1)
        if not near.goes_on:
            return near
        far = self._built(near.last if way > 0 else near.first, way, depth - 1)
        if not far.goes_on:
            return far
        share = far.weight - np.logaddexp(near.weight, far.weight)
        chosen = far.chosen if np.log(self.rng.random()) < share else near.chosen
        return self._joined(near, far, way > 0, chosen)

    @staticmethod
    def _joined(tree: _Tree, new: _Tree, ahead: bool, chosen: Point) -> _Tree:
        """Return both parts as one; it goes on unless it, or the half of it about the join, turns round."""
        one, two = (tree, new) if ahead else (new, tree)
        momentum = one.momentum + two.momentum
        goes_on = (
            _apart(one.first, two.last, momentum)
            and _apart(one.first, two.first, one.momentum + two.first.p)
            and _apart(one.last, two.last, two.momentum + one.last.p)
        )
        return _Tree(
            one.first, two.last, chosen, float(np.logaddexp(one.weight, two.weight)), momentum, goes_on
        )

    def _stepped(self, at: Point, way: int) -> Point:
        """Return the point a leapfrog step ahead or back. The force need not be the density's gradient: each kick is a
        shear of the momenta, whatever it is."""
        size = way * self.step
        u, p = drift(at.u, at.p + 0.5 * size * at.slope, size, self.space.walls, self.space.offsets)
        if not np.all(np.isfinite(u)):
            return Point(u, p, at.slope, -np.inf)
        height = self.space.height(u)
        slope = self.space.slope(u) if np.isfinite(height) else at.slope
        return Point(u, p + 0.5 * size * slope, slope, height)


def _apart(first: Point, last: Point, momentum: np.ndarray) -> bool:
    """Whether both ends still move away from each other."""
    return float(first.p @ momentum) > 0 and float(last.p @ momentum) > 0


def drift(
    u: np.ndarray, p: np.ndarray, time: float, walls: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position (d,) and momentum (d,) after `time` of straight flight within walls @ u + offsets ≥ 0.

    At a wall the momentum is mirrored: time can be run backwards and volume is kept, so that a leapfrog step made of it
    is as good as one without walls (Afshar and Domke, NeurIPS 28, 2015). time may be negative. The position is not a
    number after more than `BOUNCES` bounces for each wall.

    Parameters
    ----------
    walls, offsets
        Shapes (k, d) and (k,).
    """
    towards = 1.0 if time >= 0 else -1.0
    v, left = towards * p, abs(time)
    for _ in range(BOUNCES * len(walls) + 1):
        closing = -(walls @ v)
        reach = np.where(
            closing > 0, np.maximum(walls @ u + offsets, 0.0) / np.where(closing > 0, closing, 1.0), np.inf
        )
        first = int(np.argmin(reach)) if reach.size else 0
        if not reach.size or reach[first] >= left:
            return u + left * v, towards * v
        u = u + reach[first] * v
        left -= float(reach[first])
        normal = walls[first] / np.linalg.norm(walls[first])
        v = v - 2.0 * (normal @ v) * normal
    return np.full_like(u, np.nan), towards * v
