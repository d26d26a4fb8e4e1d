"""A sum's likelihood of its rates alone, and its evidence when their prior's scale is unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.gaussian.linear import Normals, Weighed, with_priors
from bayesdamp.priors import SCORE_RATIO

IMPROBABLE = 0.1
"""Probability of a law that holds exactly below which what counts among all may lack a part of it."""


@dataclass(frozen=True)
class Marginal:
    """Likelihood of the rates under each of c combinations of hyperparameters, all else integrated out.

    With δ the rates less those of the fit, (d,), in 1/s, the likelihood is exp(log + δᵀ slope − δᵀ information δ / 2).
    Given δ, the deviation at the knots is normal with mean `mean` + `gain` δ and covariance `covariance`.

    Attributes
    ----------
    log
        Nats, with the prior probability of the combination, (c,).
    slope
        In s, (c, d).
    information
        In s², (c, d, d).
    mean
        Of the deviation, (c, KNOTS).
    gain
        In s, (c, KNOTS, d).
    covariance
        Of the deviation, (c, KNOTS, KNOTS).
    tau
        Size of the deviation, (c,).
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    mean: np.ndarray
    gain: np.ndarray
    covariance: np.ndarray
    tau: np.ndarray

    def normals(self, fit: np.ndarray, unit: float) -> Normals:
        """Return the posteriors of the rates in a unit, with priors N(0, 1) of either sign. fit: rates in 1/s, (d,)."""
        turned = self.information @ fit
        lower = np.linalg.cholesky(unit**2 * self.information + np.eye(fit.size))
        inverse = np.linalg.inv(lower)
        half = (inverse @ (unit * (self.slope + turned))[:, :, None])[:, :, 0]
        log = self.log - (self.slope + 0.5 * turned) @ fit + 0.5 * np.sum(half**2, axis=1)
        log -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        factors = np.swapaxes(inverse, 1, 2)
        return Normals(log, (factors @ half[:, :, None])[:, :, 0], factors)


def weigh_scales(marginal: Marginal, fit: np.ndarray, omega: float) -> Weighed:
    """Integrate the rates out under half-normal priors that share one unknown scale.

    Means and factors are in 1/s, before rates are cut off at 0. Of laws that hold exactly there is an answer of their
    own, however improbable they are: where they are, what counts of them alone is kept too.

    Parameters
    ----------
    marginal
        The likelihood.
    fit
        Rates of the fit in 1/s, (d,).
    omega
        Rate in 1/s at a damping ratio of 1.
    """
    unit = SCORE_RATIO * omega
    normals, every = marginal.normals(fit, unit), np.ones(fit.size, bool)
    found = with_priors(normals, every, every)
    log, means, factors, combos = found.log_each, found.means, found.factors, found.combos
    inexact = marginal.tau[combos] > 0.0
    if found.weights[~inexact].sum() < IMPROBABLE:
        exact = np.flatnonzero(marginal.tau == 0.0)
        alone = with_priors(
            Normals(normals.log[exact], normals.means[exact], normals.factors[exact]), every, every
        )
        combos = np.concatenate([exact[alone.combos], combos[inexact]])
        order = np.argsort(combos, kind="stable")
        combos = combos[order]
        log, means, factors = (
            np.concatenate([one, other[inexact]])[order]
            for one, other in ((alone.log_each, log), (alone.means, means), (alone.factors, factors))
        )
    return Weighed(log, float(np.logaddexp.reduce(log)), unit * means, unit * factors, combos)
