"""The posterior of a candidate's parameters alone, the deviations of its laws integrated out: what chains draw from.

Motions are exact in the parameters. Deviations act on them linearly, by their tangents at the mode, so that under each
combination of hyperparameters they add a covariance of low rank to the noise's; the likelihood is the mixture over all
combinations. The linear model of `gaussian.linear` is what this becomes where motions are linear in the parameters too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.least_squares import SEARCHED
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.kernel.solve import ALL, NONE, PARAMETERS
from bayesdamp.types import Refusal

NEGLIGIBLE = 1e-8
"""Posterior probability under the linear model from which a combination of hyperparameters is left out."""


@dataclass(frozen=True)
class Marginal:
    """What the density of scores z, (d,), is made of.

    deviations: relative g and h of the mode, (n,) each, that motions are solved with; basis: (m, 2n), orthonormal, of
    what deviations do to the record's m values; shift: what those of the mode do, (m,); log_prior: of the combinations
    that count, (c,); maps: from standard normal numbers to deviations, (c, 2n, 2n); effects: what these do, in sds of
    the noise along the basis, (c, 2n, 2n); whitening: inverse factors of the covariances along the basis, (c, 2n, 2n),
    and their log determinants' halves, (c,).
    """

    result: Result
    data: Data
    variance: float
    samples: float
    deviations: tuple[np.ndarray, np.ndarray]
    basis: np.ndarray
    shift: np.ndarray
    log_prior: np.ndarray
    maps: np.ndarray
    effects: np.ndarray
    whitening: np.ndarray
    log_scale: np.ndarray

    @property
    def positive(self) -> np.ndarray:
        """Which scores must not be negative, (d,)."""
        return self.result.fit.parameters.positive

    def log_density(self, z: np.ndarray) -> np.ndarray:
        """Log prior and likelihood of scores (n, d): (n,), −∞ outside of the prior and where a motion escapes."""
        return self.log_prior_of(z) + self.log_likelihood(z)

    def log_prior_of(self, z: np.ndarray) -> np.ndarray:
        """Log prior density of scores (n, d)."""
        return self.result.fit.parameters.log_prior(z)

    def log_likelihood(self, z: np.ndarray) -> np.ndarray:
        """Log likelihood of scores (n, d), deviations integrated out: (n,), −∞ where a motion escapes."""
        return np.array(at_once(self._value, z))

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """Slope of the log density at scores z, (d,); nan where the motion escapes."""
        parameters = self.result.fit.parameters
        motion = self._motion(z, PARAMETERS)
        if motion is None:
            return np.full(z.size, np.nan)
        along, across, each = self._parts(motion.y)
        weights = np.exp(each - _log_sum(each))
        white = self.whitening @ along
        pull = np.einsum("c,cji,cj->i", weights, self.whitening, white)
        by_values = (self.basis @ pull + across) / np.sqrt(self.variance)
        return motion.pulled(by_values)[parameters.free] * parameters.slopes(z) - (
            parameters.prior_precision(z) * z
        )

    def with_deviations(self, z: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Scores (n, d) each with a draw of log g and h given them, (n, d + 2n)."""
        drawn = np.empty((len(z), self.maps.shape[1]))
        for row, motion in enumerate(at_once(lambda one: self._motion(one, NONE), z)):
            assert motion is not None  # chains do not stay where a motion escapes
            along, _, each = self._parts(motion.y)
            c = rng.choice(each.size, p=np.exp(each - _log_sum(each)))
            effect = self.effects[c]
            factor = np.linalg.cholesky(np.eye(len(effect)) + effect.T @ effect)
            mean = solve_triangular(factor, effect.T @ along, lower=True)
            v = solve_triangular(factor.T, mean + rng.standard_normal(mean.size))
            drawn[row] = self.maps[c] @ v
        return np.concatenate([z, drawn], axis=1)

    def _motion(self, z: np.ndarray, tangents: int):
        parameters, solver = self.result.fit.parameters, self.result.solver
        tolerance = SEARCHED if tangents else None
        p, active = parameters.values(np.asarray(z)), self.result.fit.active
        return solver.solve(p, active, *self.deviations, tangents, tolerance=tolerance)

    def _parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residual along the basis in sds of the noise, (2n,), and across it, (m,), and the log weight of each
        combination, (c,)."""
        left = (self.data.y - y + self.shift) / np.sqrt(self.variance)
        along = self.basis.T @ left
        each = self.log_prior - self.log_scale - 0.5 * np.sum((self.whitening @ along) ** 2, axis=1)
        return along, left - self.basis @ along, each

    def _value(self, z: np.ndarray) -> float:
        motion = self._motion(z, NONE)
        if motion is None:
            return -np.inf
        _, across, each = self._parts(motion.y)
        return self._sum(across, each)

    def _sum(self, across: np.ndarray, each: np.ndarray) -> float:
        constant = 0.5 * self.samples * np.log(2 * np.pi * self.variance)
        return _log_sum(each) - 0.5 * float(across @ across) - constant


def marginal_of(weighing: Weighing, result: Result) -> Marginal:
    """The marginal of a candidate that was weighed. Raises Refusal where no motion with deviations can be followed."""
    about, parameters, solver = result.about, result.fit.parameters, result.solver
    if about is None or result.weighed is None:
        raise Refusal("no motion near the fit can be followed with deviations from its law")
    n, d = solver.knots.size, parameters.free.size
    g, h = about.u[d : d + n], about.u[d + n :]
    deviations = np.expm1(g), h
    p = parameters.values(about.u[:d])
    moved = solver.solve(p, result.fit.active, *deviations, ALL, tolerance=SEARCHED)
    if moved is None:
        raise Refusal("no motion near the fit can be followed with deviations from its law")
    columns = moved.tangents[:, len(solver.names) :].copy()
    columns[:, :n] *= np.exp(g)
    basis, upper = np.linalg.qr(columns)
    grid = grid_of(n, absorbed=parameters.absorbs)
    kept = result.weighed.probable(NEGLIGIBLE)
    maps = grid.factors[kept]
    effects = upper @ maps / np.sqrt(weighing.variance)
    lower = np.linalg.cholesky(np.eye(2 * n) + effects @ np.swapaxes(effects, 1, 2))
    return Marginal(
        result,
        weighing.data,
        weighing.variance,
        weighing.data.y.size / weighing.inflation,
        deviations,
        basis,
        columns @ np.concatenate([g, h]),
        grid.log_prior[kept],
        maps,
        effects,
        np.linalg.inv(lower),
        np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1),
    )


def _log_sum(logs: np.ndarray) -> float:
    top = float(np.max(logs))
    return top + float(np.log(np.sum(np.exp(logs - top))))
