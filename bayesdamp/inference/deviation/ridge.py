"""Coordinates that follow the curved ridge of the posterior along a damping term's own parameter.

For example, a record determines the energy loss of Stribeck friction far better than its static excess and velocity
separately, so that the posterior lies along a curve. Draws of a linear model follow the tangent instead; after
reweighting only those near the mode remain, and intervals are half as wide as they should be (measured).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.linear import LinearModel, LinearPosterior
from bayesdamp.inference.deviation.model_comparison import CandidateResult
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.physics.kernel.solve import PARAMETERS
from bayesdamp.priors import log_prior_of

REACH, APART = 3.6, 0.6
"""Range of the leading score in which the ridge is computed, and distance of its nodes, in posterior sds."""
DEEP = 12.0
"""Nats below the mode at which the ridge ends."""
CLEAR = 4.0
"""Posterior sds from zero below which a coefficient does not follow the ridge, but stays cut off at zero."""
FEWEST = 3
"""Least number of nodes of a ridge."""
STEPS, SETTLED = 8, 1e-3
"""Largest number of Gauss–Newton steps to a node, and the gain in nats below which they end."""
SHARES = (1.0, 0.5, 0.2)
"""Fractions of a step that are tried in turn."""
TOLERANCE = 1e-6
"""Error of an integration step for the motions of the ridge, as a fraction of the amplitude."""


@dataclass(frozen=True)
class Ridge:
    """Coordinates u, (d,), whose linear posterior has its ridge where the scores z of `base` have a curved one.

    The leading score is the same in u and z. Given this score, the other scores of the ridge are mapped from their
    normal distribution in the linear model to Laplace's approximation of their conditional posterior: from mode to
    mode, and by the same number of sds (compare H. Rue, S. Martino and N. Chopin, J. R. Stat. Soc. B 71, 319, 2009).

    Attributes
    ----------
    base : Parameters
        Parameters as functions of the scores z.
    lead : int
        Index of the leading score: the own parameter that the record determines least.
    moved, fixed : ndarray of int, shapes (m,) and (d − m,)
        Indices of the scores that follow the ridge, and of the others, the leading one among these.
    mode, tangent : ndarray, shape (d,)
        Mode of the linear model, and derivative of its ridge by the leading score.
    across : ndarray, shape (m, d − m)
        Derivatives of the conditional mode of the moved scores by the fixed ones.
    root : ndarray, shape (m, m)
        Lower factor of the moved scores' covariance in the linear model.
    nodes : tuple of ndarray
        Leading scores (k,), modes of the moved scores there (k, m), lower factors of their covariances (k, m, m).
    """

    base: Parameters
    lead: int
    moved: np.ndarray
    fixed: np.ndarray
    mode: np.ndarray
    tangent: np.ndarray
    across: np.ndarray
    root: np.ndarray
    nodes: tuple[np.ndarray, np.ndarray, np.ndarray]

    @property
    def free(self) -> np.ndarray:
        """Return the indices of the inferred parameters among the kernel's, (d,)."""
        return self.base.free

    @cached_property
    def positive(self) -> np.ndarray:
        """Return which of u must not be negative, (d,); for moved scores only z must not."""
        positive = self.base.positive.copy()
        positive[self.moved] = False
        return positive

    @cached_property
    def _curves(self):
        at, centres, roots = self.nodes
        # The diagonals of interpolated roots stay positive.
        return scipy.interpolate.CubicSpline(at, centres), scipy.interpolate.PchipInterpolator(at, roots)

    def _at(self, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return conditional modes (..., m) and lower factors of covariances (..., m, m) at leading scores (...)."""
        centre, root = self._curves
        inside = np.clip(a, self.nodes[0][0], self.nodes[0][-1])
        return centre(inside) + self.tangent[self.moved] * (a - inside)[..., None], root(inside)

    def base_scores(self, u: np.ndarray) -> np.ndarray:
        """Convert coordinates u to scores z of `base`, both (..., d)."""
        off = u - self.mode
        centre, root = self._at(u[..., self.lead])
        beside = (off - self.tangent * off[..., self.lead, None])[..., self.fixed] @ self.across.T
        left = off[..., self.moved] - off[..., self.fixed] @ self.across.T
        left = np.linalg.solve(self.root, left[..., None])
        z = u.copy()
        z[..., self.moved] = centre + beside + (root @ left)[..., 0]
        return z

    def values(self, u: np.ndarray) -> np.ndarray:
        """Return the kernel's parameters at u, (..., d): (..., k)."""
        return self.base.values(self.base_scores(u))

    def plain(self, u: np.ndarray) -> np.ndarray:
        """Return the standard normal scores at coordinates u, both (d,)."""
        return self.base.plain(self.base_scores(u))

    def log_prior_ratio(self, u: np.ndarray) -> np.ndarray:
        """Return log prior density at u, (..., d), minus that in the linear model, (...); −∞ outside the prior."""
        z = self.base_scores(u)
        root = self._at(u[..., self.lead])[1]
        ratio = np.diagonal(root, axis1=-2, axis2=-1) / np.diagonal(self.root)
        linear = log_prior_of(u, self.positive, self.base.shared)
        log_ratio = (
            self.base.log_prior_ratio(z) + np.sum(np.log(ratio), axis=-1) + self.base.log_prior(z) - linear
        )
        return np.where(np.all(z[..., self.base.positive] >= 0, axis=-1), log_ratio, -np.inf)


def ridge_of(
    result: CandidateResult, base: Parameters, model: LinearModel, posterior: LinearPosterior
) -> Ridge | None:
    """Compute the ridge along the own parameter of the damping terms that the record determines least.

    Return None where the terms have no own parameters, where the mode of one is at zero, or where fewer than `FEWEST`
    nodes have a motion.
    """
    d = base.free.size
    own = np.array([name in result.solver.inferred for name in base.free_names])
    sds = np.sqrt(posterior.weights @ np.sum(posterior.factors[:, :d] ** 2, axis=2))
    mode = posterior.means[int(np.argmax(posterior.log_each)), :d].copy()
    leading = np.flatnonzero(own & ~base.positive)
    if leading.size == 0 or np.any(mode[own & base.positive] <= 0):
        return None
    lead = int(leading[np.argmax(sds[leading])])
    stays = base.positive & ~own & (mode < CLEAR * sds)
    stays[lead] = True
    moved, fixed = np.flatnonzero(~stays), np.flatnonzero(stays)
    square = model.root[:, :d].T @ model.root[:, :d] / result.variance + np.diag(base.prior_precision(mode))
    covariance = np.linalg.inv(square)
    tangent = covariance[lead] / covariance[lead, lead]
    inner = square[np.ix_(moved, moved)]
    across = -np.linalg.solve(inner, square[np.ix_(moved, fixed)])
    search = _Search(result, base, moved)

    def start(a: float) -> np.ndarray:
        z = mode + tangent * (a - mode[lead])
        z[base.positive] = np.maximum(z[base.positive], 0.0)
        return z

    first = search.node(start(float(mode[lead])))
    if first is None:
        return None
    nodes = [first]
    for side in (1.0, -1.0):
        at, off = first, np.zeros(moved.size)
        for k in range(1, round(REACH / APART) + 1):
            z = start(float(mode[lead] + side * k * APART * sds[lead]))
            z[moved] = at.z[moved] + off if k > 1 else z[moved]
            new = search.node(z)
            if new is None or new.depth > first.depth + DEEP:
                break
            off, at = new.z[moved] - at.z[moved], new
            nodes.append(new)
    if len(nodes) < FEWEST:
        return None
    nodes.sort(key=lambda n: n.z[lead])
    leads, centres = np.array([n.z[lead] for n in nodes]), np.array([n.z[moved] for n in nodes])
    curve = leads, centres, np.array([n.root for n in nodes])
    root = np.linalg.cholesky(np.linalg.inv(inner))
    return Ridge(base, lead, moved, fixed, mode, tangent, across, root, curve)


@dataclass(frozen=True)
class _Node:
    """A conditional mode: scores z (d,), lower factor of the moved scores' covariance (m, m), depth: −log density."""

    z: np.ndarray
    root: np.ndarray
    depth: float


@dataclass(frozen=True)
class _Search:
    """Search for the mode of the scores `moved`, with the other scores and the deviations fixed."""

    result: CandidateResult
    base: Parameters
    moved: np.ndarray

    def node(self, z: np.ndarray) -> _Node | None:
        """Find the mode, starting at z, (d,); None where the motion at the start escapes."""
        at = self._at(z)
        if at is None:
            return None
        for _ in range(STEPS):
            depth, slope, square = at
            step = np.linalg.solve(square, slope)
            for share in SHARES:
                new = z.copy()
                new[self.moved] += share * step
                trial = self._at(new)
                if trial is not None and trial[0] <= depth:
                    break
            else:
                break
            z, at = new, trial
            if depth - trial[0] < SETTLED:
                break
        return _Node(z, np.linalg.cholesky(np.linalg.inv(at[2])), at[0])

    def _at(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray] | None:
        """Return −log posterior density (up to a constant), minus its gradient, (m,), and its Gauss–Newton Hessian."""
        p, result, variance = self.base.values(z), self.result, self.result.variance
        if not np.all(np.isfinite(p)):
            return None
        motion = result.solver.solve(
            p, result.fit.active, *result.deviations, PARAMETERS, tolerance=TOLERANCE
        )
        if motion is None:
            return None
        left = result.data.y - motion.y
        columns = self.base.by_scores(motion.tangents, z)[:, self.moved]
        precision = self.base.prior_precision(z)[self.moved]
        depth = 0.5 * float(left @ left) / variance - float(self.base.log_prior(np.abs(z)))
        slope = columns.T @ left / variance - precision * z[self.moved]
        return depth, slope, columns.T @ columns / variance + np.diag(precision)
