"""Normal distributions of one to three coefficients that cannot be negative: probability, draws."""

from __future__ import annotations

import numpy as np
from scipy.special import log_ndtr, ndtr, ndtri

NODES = 20
"""Of the Gauss-Legendre rule: probabilities to 1e-6, to some per cent where they are below 1e-10."""
SWEEPS = 40
_LEAST = 1e-280


def log_orthant(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """ln P(all coordinates > 0), shape (b,), of normals with mean (b, d) and covariance (b, d, d), d from 0 to 3."""
    d = mean.shape[1]
    if d == 0:
        return np.zeros(mean.shape[0])
    sd = np.sqrt(np.einsum("bii->bi", covariance))
    if d == 1:
        return log_ndtr(mean[:, 0] / sd[:, 0])
    # One coordinate after the other, from what it is given those before; the least likely positive one first.
    order = np.argsort(np.mean(mean / sd, axis=0))
    mean, covariance = mean[:, order], covariance[:, order][:, :, order]
    triangle = np.linalg.cholesky(covariance)
    u, w = np.polynomial.legendre.leggauss(NODES)
    u, w = 0.5 * (u + 1.0), 0.5 * w
    first = ndtr(mean[:, 0] / triangle[:, 0, 0])
    tail = np.maximum(first, _LEAST)[:, None]
    z1 = -ndtri(np.maximum(tail * u, _LEAST))  # a standard normal above -mean/sd
    if d == 2:
        inner = ndtr((mean[:, 1:] + triangle[:, 1, :1] * z1) / triangle[:, 1, 1:2])
        return log_ndtr(mean[:, 0] / triangle[:, 0, 0]) + np.log(np.maximum(inner @ w, _LEAST))
    second = ndtr((mean[:, 1:2] + triangle[:, 1, :1] * z1) / triangle[:, 1, 1:2])
    z2 = -ndtri(np.maximum(second[:, :, None] * u, _LEAST))
    third = (
        mean[:, 2, None, None]
        + triangle[:, 2, 0, None, None] * z1[:, :, None]
        + triangle[:, 2, 1, None, None] * z2
    )
    inner = ndtr(third / triangle[:, 2, 2, None, None]) @ w
    return log_ndtr(mean[:, 0] / triangle[:, 0, 0]) + np.log(np.maximum((second * inner) @ w, _LEAST))


def draw_orthant(
    mean: np.ndarray, covariance: np.ndarray, start: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """One draw with no negative coordinate from each normal, shape (b, d), by Gibbs sampling (Geweke 1991).

    mean (b, d), covariance (b, d, d), start (b, d): where the chains begin.
    """
    precision = np.linalg.inv(covariance)
    x = np.maximum(start, 0.0)
    d = mean.shape[1]
    diagonal = np.einsum("bii->bi", precision)
    sd = 1.0 / np.sqrt(diagonal)
    for _ in range(1 if d == 1 else SWEEPS):
        for i in range(d):
            pull = np.einsum("bj,bj->b", precision[:, i], x - mean) - diagonal[:, i] * (x[:, i] - mean[:, i])
            centre = mean[:, i] - pull / diagonal[:, i]
            above = ndtr(centre / sd[:, i])
            uniform = rng.random(x.shape[0])
            z = -ndtri(np.maximum(uniform * above, _LEAST))
            x[:, i] = np.maximum(centre + sd[:, i] * z, 0.0)
    return x
