"""Means over windows of samples, taken of a motion as they are taken of a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True)
class Windows:
    """Two points and weights in each window of samples.

    The weighted sum of a motion's values at the two points is its mean over the samples: exactly for a cubic
    polynomial (the Gauss rule of two points for the samples' own times), and within 1e-8 of the amplitude for an
    oscillation with windows of an eightieth of a cycle.

    Attributes
    ----------
    times : ndarray, shape (n, 2)
        The points, rising, in s.
    weights : ndarray, shape (n, 2)
        Their weights, of sum 1 in each window.

    References
    ----------
    G. H. Golub and J. H. Welsch, Calculation of Gauss quadrature rules, Math. Comp. 23, 221 (1969).
    """

    times: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, t: np.ndarray) -> Self:
        """Return the points and weights of windows from the times of their samples.

        Parameters
        ----------
        t : ndarray, shape (n, m)
            The times of the m samples in each of n windows, in s.
        """
        middle = t.mean(axis=1)
        off = t - middle[:, None]
        sd = np.sqrt(np.mean(off**2, axis=1))
        scale = np.where(sd > 0, sd, 1.0)
        skewness = np.mean((off / scale[:, None]) ** 3, axis=1)
        root = np.sqrt(skewness**2 + 4)
        low, high = 0.5 * (skewness - root), 0.5 * (skewness + root)
        times = middle[:, None] + sd[:, None] * np.column_stack([low, high])
        return cls(times, np.column_stack([high, -low]) / root[:, None])

    def first(self, count: int | None) -> Windows:
        """Return the first windows, all of them for None."""
        return self if count is None else Windows(self.times[:count], self.weights[:count])


@dataclass(frozen=True)
class Points:
    """Times at which a motion is read, and how its values there become those that are wanted.

    Attributes
    ----------
    t : ndarray, shape (n,) or, with weights, (2n,)
        Rising, in s.
    weights : ndarray, shape (n, 2), or None
        The weights of neighbouring points; None where the values at the points are wanted themselves.
    """

    t: np.ndarray
    weights: np.ndarray | None = None

    @classmethod
    def of(cls, t: np.ndarray, windows: Windows | None) -> Self:
        """Return the points for values at times t, shape (n,), or for the means over windows."""
        # Writable copies: Numba would compile again for an array that is read-only.
        if windows is None:
            return cls(np.array(t, float))
        return cls(windows.times.flatten(), windows.weights)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the wanted values, shape (n, ...), from those at the points."""
        if self.weights is None:
            return values
        first, second = self.weights.T.reshape(2, -1, *(1,) * (values.ndim - 1))
        return first * values[::2] + second * values[1::2]

    def spread(self, weights: np.ndarray) -> np.ndarray:
        """Return weights of the points from weights of the wanted values, shape (n,): the transpose of `mean`."""
        return weights if self.weights is None else (weights[:, None] * self.weights).ravel()
