"""The second half of a record as draws from what the first half says carry it on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import near
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.types import Forecast, Refusal

DRAWS = 50
"""Of Laplace's approximation, and at a time: what they add to the interval's width is good to a tenth of itself."""
TOGETHER = 2_000_000
"""Residuals that are held at a time."""
INTERVAL = 1.959963984540054
"""Half-width of a central 95 % interval in sds."""


@dataclass(frozen=True)
class Ahead:
    """The second half of a record.

    error, sd: the record minus its predictive mean, and the predictive sd, noise included, at each sample, shape (m,).
    """

    error: np.ndarray
    sd: np.ndarray

    @property
    def rms(self) -> float:
        """Of the error, in the unit of the record."""
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
    """Return what draws of the scores, (m, d), from the first `half` samples say of those after them.

    likelihood: of the whole record. Of noise, the interval has the mean square of the residuals of the first half,
    whatever its law: it does not use that neighbouring samples may err together. Raises Refusal where no draw goes on.
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
    whole: Likelihood,
    first: Likelihood,
    z: np.ndarray,
    factor: np.ndarray,
    log_predictive: float,
    seed: int,
) -> Forecast | None:
    """What the first half of a record says of the rest, by Laplace's approximation; None where it says nothing.

    first: of the first half, its scale held at 1; z: the mode there, (d,); factor @ factor.T: its covariance.
    """
    if not (np.isfinite(log_predictive) and np.all(np.isfinite(factor))):
        return None
    try:
        draws = near(first, z, factor).draw(np.random.default_rng(seed), DRAWS)
        ahead = carried_on(whole, draws, first.y.size)
    except (np.linalg.LinAlgError, Refusal):  # too stiff to be drawn from, or no draw goes on
        return None
    return Forecast(ahead.rms, ahead.expected, ahead.coverage, log_predictive)
