"""Scores along the ridge of a damping term's own parameters.

A record tells a friction's loss far better than how its static excess and its Stribeck velocity share in it, so that
their posterior lies along a curve. Draws of a linear model leave that curve along its tangent, and weights then keep
those near the mode alone: intervals would be half as wide as the posterior (measured).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.inference.deviation.gaussian.linear import Linear, Weighed
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.kernel.solve import PARAMETERS
from bayesdamp.priors import log_prior_of

REACH, APART = 3.6, 0.6
"""Posterior sds of the leading score up to which the ridge is followed, and by which its nodes lie apart."""
DEEP = 12.0
"""Nats below the mode beyond which it is followed no further."""
CLEAR = 4.0
"""Posterior sds from zero below which a coefficient is not moved along the ridge, but stays cut off at zero."""
FEWEST = 3
"""Nodes."""
STEPS, SETTLED = 8, 1e-3
"""Gauss–Newton steps to a node at most, and nats that a step must have gained for another to follow."""
SHARES = (1.0, 0.5, 0.2)
"""Of a step, tried in turn."""
TOLERANCE = 1e-6
"""Error of a step of the motions that the ridge is sought with, as a share of the amplitude."""


@dataclass(frozen=True)
class Ridge:
    """Scores u of a linear model and those z of `base` that they stand for, both (d,): about the ridge z have the
    density that u have about its tangent. The leading score is the same in both; what is moved is its mode given that
    score, and as many of its sds there from it (Laplace's approximation at each value of the leading score, as H. Rue,
    S. Martino and N. Chopin integrate, J. R. Stat. Soc. B 71, 319, 2009).

    lead, moved (m,), kept (d − m,): places of the leading score, of what is moved, of what is not, the leading one
    among these. mode, tangent (d,): of the linear model, and of its ridge by the leading score. across: of what is
    moved by what is kept, (m, d − m). nodes: leading scores (k,), modes of what is moved there (k, m), lower factors of
    its covariances (k, m, m); root: that of the linear model, (m, m).
    """

    base: Parameters
    lead: int
    moved: np.ndarray
    kept: np.ndarray
    mode: np.ndarray
    tangent: np.ndarray
    across: np.ndarray
    root: np.ndarray
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray]

    @property
    def free(self) -> np.ndarray:
        """Places of what is inferred among the kernel's parameters, (d,)."""
        return self.base.free

    @cached_property
    def positive(self) -> np.ndarray:
        """Which of u must not be negative, (d,): of what is moved that is asked of z alone."""
        found = self.base.positive.copy()
        found[self.moved] = False
        return found

    @cached_property
    def _curves(self):
        from scipy.interpolate import CubicSpline, PchipInterpolator

        at, centres, roots = self.nodes
        return CubicSpline(at, centres), PchipInterpolator(at, roots)  # whose diagonals stay positive

    def _at(self, a: float) -> tuple[np.ndarray, np.ndarray]:
        """Mode and factor of what is moved at a leading score."""
        centre, root = self._curves
        inside = float(np.clip(a, self.nodes[0][0], self.nodes[0][-1]))
        return centre(inside) + self.tangent[self.moved] * (a - inside), root(inside)

    def base_scores(self, u: np.ndarray) -> np.ndarray:
        """The scores of `base` that u stands for, both (d,)."""
        off = u - self.mode
        centre, root = self._at(float(u[self.lead]))
        beside = self.across @ (off - self.tangent * off[self.lead])[self.kept]
        left = np.linalg.solve(self.root, off[self.moved] - self.across @ off[self.kept])
        z = u.copy()
        z[self.moved] = centre + beside + root @ left
        return z

    def values(self, u: np.ndarray) -> np.ndarray:
        """The kernel's parameters at u, (..., d): shape (..., k)."""
        if u.ndim > 1:
            return np.array([self.values(row) for row in u])
        return self.base.values(self.base_scores(u))

    def plain(self, u: np.ndarray) -> np.ndarray:
        """Standard normal scores of u, both (d,)."""
        return self.base.plain(self.base_scores(u))

    def log_prior_ratio(self, u: np.ndarray) -> float:
        """Log of the prior's density at u, (d,), over that of the linear model; −∞ where it has none."""
        z = self.base_scores(u)
        if np.any(z[self.base.positive] < 0):
            return -np.inf
        root = self._at(float(u[self.lead]))[1]
        stretched = float(np.sum(np.log(np.diagonal(root) / np.diagonal(self.root))))
        linear = log_prior_of(u, self.positive, self.base.shared)
        return self.base.log_prior_ratio(z) + stretched + float(self.base.log_prior(z) - linear)


def ridge_of(
    weighing: Weighing, result: Result, approximate: bool, base: Parameters, model: Linear, weighed: Weighed
) -> Ridge | None:
    """The ridge along that parameter of the damping terms which the record tells least; None where they have none of
    their own, where one is best at zero, and where no motion stays in phase along it."""
    d = base.free.size
    own = np.array([name in result.solver.inferred for name in base.free_names])
    sds = np.sqrt(weighed.weights @ np.sum(weighed.factors[:, :d] ** 2, axis=2))
    mode = weighed.means[int(np.argmax(weighed.log_each)), :d].copy()
    leading = np.flatnonzero(own & ~base.positive)
    if leading.size == 0 or np.any(mode[own & base.positive] <= 0):
        return None
    lead = int(leading[np.argmax(sds[leading])])
    stays = base.positive & ~own & (mode < CLEAR * sds)
    stays[lead] = True
    moved, kept = np.flatnonzero(~stays), np.flatnonzero(stays)
    variance = weighing.variance if approximate else result.exact_variance
    square = model.root[:, :d].T @ model.root[:, :d] / variance + np.diag(base.prior_precision(mode))
    covariance = np.linalg.inv(square)
    tangent = covariance[lead] / covariance[lead, lead]
    inner = square[np.ix_(moved, moved)]
    across = -np.linalg.solve(inner, square[np.ix_(moved, kept)])
    search = _Search(weighing, result, approximate, base, variance, moved)

    def begun(a: float) -> np.ndarray:
        z = mode + tangent * (a - mode[lead])
        z[base.positive] = np.maximum(z[base.positive], 0.0)
        return z

    first = search.node(begun(float(mode[lead])))
    if first is None:
        return None
    nodes = [first]
    for side in (1.0, -1.0):
        at, off = first, np.zeros(moved.size)
        for k in range(1, round(REACH / APART) + 1):
            z = begun(float(mode[lead] + side * k * APART * sds[lead]))
            z[moved] = at.z[moved] + off if k > 1 else z[moved]
            new = search.node(z)
            if new is None or new.depth > first.depth + DEEP:
                break
            off, at = new.z[moved] - at.z[moved], new
            nodes.append(new)
    if len(nodes) < FEWEST:
        return None
    nodes.sort(key=lambda n: n.z[lead])
    along = (
        np.array([n.z[lead] for n in nodes]),
        np.array([n.z[moved] for n in nodes]),
        np.array([n.root for n in nodes]),
    )
    root = np.linalg.cholesky(np.linalg.inv(inner))
    return Ridge(base, lead, moved, kept, mode, tangent, across, root, along)


@dataclass(frozen=True)
class _Node:
    """z, (d,), at the mode of what is moved, the lower factor of its covariance, (m, m), how many nats deep it is."""

    z: np.ndarray
    root: np.ndarray
    depth: float


@dataclass(frozen=True)
class _Search:
    """The mode of the scores at `moved`, the others and the deviations from the laws held."""

    weighing: Weighing
    result: Result
    approximate: bool
    base: Parameters
    variance: float
    moved: np.ndarray

    def node(self, z: np.ndarray) -> _Node | None:
        """The mode from z, (d,), on; None where motions escape."""
        found = self._at(z)
        if found is None:
            return None
        for _ in range(STEPS):
            depth, slope, square = found
            step = np.linalg.solve(square, slope)
            for share in SHARES:
                new = z.copy()
                new[self.moved] += share * step
                there = self._at(new)
                if there is not None and there[0] <= depth:
                    break
            else:
                break
            z, found = new, there
            if depth - there[0] < SETTLED:
                break
        return _Node(z, np.linalg.cholesky(np.linalg.inv(found[2])), found[0])

    def _at(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray] | None:
        """Nats below a perfect fit, their slope downwards, (m,), and curvature, (m, m)."""
        p = self.base.values(z)
        if not np.all(np.isfinite(p)):
            return None
        deviations = self.result.deviations if self.approximate else (None, None)
        motion = self.result.solver.solve(
            p, self.result.fit.active, *deviations, PARAMETERS, tolerance=TOLERANCE
        )
        if motion is None:
            return None
        left = self.weighing.data.y - motion.y
        columns = self.base.by_scores(motion.tangents, z)[:, self.moved]
        precision = self.base.prior_precision(z)[self.moved]
        depth = 0.5 * float(left @ left) / self.variance - float(self.base.log_prior(np.abs(z)))
        slope = columns.T @ left / self.variance - precision * z[self.moved]
        return depth, slope, columns.T @ columns / self.variance + np.diag(precision)
