"""The second half of a record, predicted from its first half."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import near
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.types import Forecast, Refusal

DRAWS = 50
"""Draws of Laplace's approximation, and draws in a batch: they give their part of the width within a tenth."""
TOGETHER = 2_000_000
"""Largest number of residuals in memory."""
INTERVAL = 1.959963984540054
"""Half-width of a central 95 % interval in sds."""


@dataclass(frozen=True)
class Ahead:
    """The prediction of the second half of a record, at each of its m samples.

    Attributes
    ----------
    error : ndarray, shape (m,)
        The record minus its predictive mean.
    sd : ndarray, shape (m,)
        The predictive sd, noise included.
    """

    error: np.ndarray
    sd: np.ndarray

    @property
    def rms(self) -> float:
        """Root mean square error, in the unit of the record."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def expected(self) -> float:
        """Root mean predictive variance, in the unit of the record."""
        return float(np.sqrt(np.mean(self.sd**2)))

    @property
    def coverage(self) -> float:
        """Share of the samples inside their 95 % interval."""
        return float(np.mean(np.abs(self.error) < INTERVAL * self.sd))


def carried_on(likelihood: Likelihood, draws: np.ndarray, half: int) -> Ahead:
    """Predict the samples after the first `half` ones from draws of the scores given these.

    The variance of the noise is the mean square of the residuals of the first half, whatever the noise model. The
    interval ignores that neighbouring samples may have correlated errors.

    Parameters
    ----------
    likelihood : Likelihood
        Of the whole record.
    draws : ndarray, shape (m, d)
        Of the scores given the first half.
    half : int
        Number of samples in the first half.

    Raises
    ------
    Refusal
        Where no draw has a finite motion over the second half.
    """
    n = likelihood.y.size
    count, total, square, first = 0, np.zeros(n - half), np.zeros(n - half), 0.0
    for batch in np.array_split(draws, max(1, len(draws) // DRAWS, len(draws) * n // TOGETHER)):
        r = likelihood.residuals(batch)
        r = r[np.all(np.isfinite(r), axis=1)]
        count += len(r)
        total += r[:, half:].sum(axis=0)
        square += (r[:, half:] ** 2).sum(axis=0)
        first += float((r[:, :half] ** 2).sum())
    if not count:
        raise Refusal("no motion that fits the first half goes on through the second")
    error = total / count
    return Ahead(error, np.sqrt(np.maximum(square / count - error**2, 0.0) + first / (count * half)))


def forecast(
    whole: Likelihood, first: Likelihood, z: np.ndarray, factor: np.ndarray, log_predictive: float, seed: int
) -> Forecast | None:
    """Forecast the second half of a record from the first by Laplace's approximation; None where that fails.

    Parameters
    ----------
    whole, first : Likelihood
        Of the whole record, and of its first half with the shared scale fixed at 1.
    z : ndarray, shape (d,)
        The mode on the first half.
    factor : ndarray, shape (d, d)
        Cholesky factor of the covariance there.
    log_predictive : float
        Log density of the second half given the first, in nats.
    seed : int
        Of the draws.
    """
    if not (np.isfinite(log_predictive) and np.all(np.isfinite(factor))):
        return None
    try:
        draws = near(first, z, factor).draw(np.random.default_rng(seed), DRAWS)
        ahead = carried_on(whole, draws, first.y.size)
    except (np.linalg.LinAlgError, Refusal):  # too stiff to draw from, or no draw has a finite motion
        return None
    return Forecast(ahead.rms, ahead.expected, ahead.coverage, log_predictive)
