"""The likelihood of a record with the deviations from the laws integrated out.

The deviations are g (log damping) and h (relative frequency), with values at knots in time; their hyperparameters are
sizes (prior sds) and correlation lengths. The motion is an exact function of the parameters. The deviations change it
linearly, by their derivatives at the mode. For each combination of hyperparameters they therefore add a covariance of
low rank to that of the noise, and the likelihood is the mixture over all combinations. Without knots it is the
likelihood of exact laws with white noise of known variance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.inference.noise import NoiseModel
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal


@dataclass(frozen=True, eq=False)
class Deviation(NoiseModel):
    """The distribution of record minus motion: white noise of known variance plus the effect of deviations.

    The motion is that of `motions`, in which the deviations are fixed. The hyperparameters of the deviations are their
    prior sds and correlation lengths. The class takes the place of a noise model; its methods ignore their arguments
    `gaps`, `p` and `features`.

    Attributes
    ----------
    motions : Trajectories
        Solver of the motions, with the deviations g and h fixed at the mode.
    variance : float
        Variance of the noise, in the record's unit squared.
    samples : float
        Effective number of independent values in the record.
    basis : ndarray, shape (m, k)
        Orthonormal basis of the changes of the record's m values that deviations at the knots can cause, to first
        order. k is the number of values of g and h together.
    shift : ndarray, shape (m,)
        Change of the motion that the deviations at the mode cause, to first order, in the record's unit. It is added to
        residuals, which are then relative to a motion without deviations.
    log_prior : ndarray, shape (c,)
        Log prior probabilities of the combinations of hyperparameters.
    maps : ndarray, shape (c, k, k)
        Factors that map standard normal numbers to g and h at the knots, for each combination.
    effects : ndarray, shape (c, k, k)
        Changes along the basis that unit values of these standard normal numbers cause, in standard deviations of the
        noise.
    probabilities : ndarray, shape (c,)
        Posterior probabilities of the combinations near the mode, with which the Fisher information is averaged.
    """

    motions: Trajectories
    variance: float
    samples: float
    basis: np.ndarray
    shift: np.ndarray
    log_prior: np.ndarray
    maps: np.ndarray
    effects: np.ndarray
    probabilities: np.ndarray
    name = "gaussian"
    parameters = ()

    @cached_property
    def _whitening(self) -> tuple[np.ndarray, np.ndarray]:
        """The inverse Cholesky factors of the residuals' covariances along `basis`, and the log normalisations.

        There is one of each for each of the c combinations of hyperparameters (prior sds and correlation lengths of the
        deviations). The factors are stacked, (c k, k). A normalisation is the prior probability of the combination
        divided by the square root of the determinant of its covariance, (c,).
        """
        k = self.effects.shape[1]
        lower = np.linalg.cholesky(np.eye(k) + self.effects @ np.swapaxes(self.effects, 1, 2))
        log_scale = np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        return np.linalg.inv(lower).reshape(len(lower) * k, k), self.log_prior - log_scale

    def _parts(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Split r + `shift`, (m,), into parts along `basis` and orthogonal to it, in standard deviations of the noise.

        r: residuals. Return the part along the basis, (k,), the orthogonal part, (m,), the first one whitened for each
        of the c combinations of prior sds and correlation lengths of the deviations, (c, k), and the log of each
        combination's prior probability times density, up to a constant, (c,).
        """
        scaled = (r + self.shift) / np.sqrt(self.variance)
        along = scaled @ self.basis
        whitening, log_mass = self._whitening
        white = (whitening @ along).reshape(len(log_mass), along.size)
        each = log_mass - 0.5 * np.einsum("ci,ci->c", white, white)
        return along, scaled - self.basis @ along, white, each

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of residuals r, (m,), in nats, with the deviations integrated out.

        The normalisation of the white noise counts `samples` values instead of m. gaps and p have no effect.
        """
        _, across, _, each = self._parts(r)
        constant = 0.5 * self.samples * np.log(2 * np.pi * self.variance)
        return np.asarray(np.logaddexp.reduce(each) - 0.5 * float(across @ across) - constant)

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density by each residual in r, (m,). gaps and p have no effect."""
        _, across, white, each = self._parts(r)
        by_basis = (np.exp(each - np.logaddexp.reduce(each))[:, None] * white).ravel() @ self._whitening[0]
        return -(self.basis @ by_basis + across) / np.sqrt(self.variance)

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return R v, (..., m + c k), for shifts v of the record, (..., m).

        RᵀR is the Fisher information about a shift, averaged over the c combinations of hyperparameters (sizes and
        correlation lengths) with `probabilities`; k is the number of values of the deviations at their knots in time.
        gaps and p have no effect.
        """
        v = v / np.sqrt(self.variance)
        along = v @ self.basis
        white = along @ self._whitening[0].T * np.repeat(np.sqrt(self.probabilities), along.shape[-1])
        return np.concatenate([v - along @ self.basis.T, white], axis=-1)

    def combination_given(self, r: np.ndarray, rng: np.random.Generator) -> int:
        """Draw the index of a combination of hyperparameters from its posterior given residuals r, (m,).

        Hyperparameters are the prior sds and correlation lengths of the deviations. The index is along the first axis
        of `maps`.
        """
        return _draw_index(self._parts(r)[-1], rng)

    def under(self, combination: int) -> Deviation:
        """Return the distribution given one combination of prior sds and correlation lengths, by index (see `maps`)."""
        own = slice(combination, combination + 1)
        return replace(
            self,
            log_prior=self.log_prior[own],
            maps=self.maps[own],
            effects=self.effects[own],
            probabilities=np.ones(1),
        )

    def draw_given(self, r: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw the deviations, g and then h at the knots, (k,), from their posterior given residuals r, (m,).

        g is the deviation of the log damping, h the relative one of the frequency. A combination of hyperparameters is
        drawn first, from its posterior given r.
        """
        along, _, _, each = self._parts(r)
        c = _draw_index(each, rng)
        inverse, effect = self._conditional[c], self.effects[c]
        return self.maps[c] @ (inverse.T @ (inverse @ (effect.T @ along) + rng.standard_normal(along.size)))

    @cached_property
    def _conditional(self) -> np.ndarray:
        """Inverse Cholesky factors, (c, k, k), of the information about the deviations given the parameters.

        There is one for each combination of hyperparameters. The deviations are measured by the standard normal numbers
        that `maps` converts to g and h.
        """
        information = np.swapaxes(self.effects, 1, 2) @ self.effects + np.eye(self.effects.shape[1])
        return np.linalg.inv(np.linalg.cholesky(information))

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return no priors: this model has no parameters."""
        return {}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Return no values: this model has no parameters."""
        return {}

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return whitened residuals, (m,): r + `shift`, whitened by the covariance of noise and deviations.

        The covariance is that under the combination of hyperparameters (prior sds and correlation lengths of
        deviations) that is most probable given r. gaps and p have no effect.
        """
        _, across, white, each = self._parts(r)
        return across + self.basis @ white[int(np.argmax(each))]

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Raise Refusal: residuals are independent only given the deviations, so none has a density of its own."""
        raise Refusal(
            "with deviations from the laws the errors of samples are correlated, so that no sample has a density of "
            'its own; use deviation "none"'
        )


def _draw_index(log_weights: np.ndarray, rng: np.random.Generator) -> int:
    """Draw an index with probabilities proportional to exp(log_weights)."""
    return int(rng.choice(log_weights.size, p=np.exp(log_weights - np.logaddexp.reduce(log_weights))))
