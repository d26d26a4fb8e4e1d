"""One pass of an unscented Kalman filter over a record: angle, velocity, and parameters that do not change."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target

HALF_NORMAL = (math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi))
"""Mean and sd of a reflected score under its prior."""


@dataclass(frozen=True)
class Online:
    """What the filter held after each sample: means and sds of the k moving scores, (n, k), and the last
    covariance, (k, k)."""

    means: np.ndarray
    sds: np.ndarray
    covariance: np.ndarray


def filter_online(target: Target, mode: Mode) -> Online:
    """One pass from the priors, each sample used once and in its turn.

    The state is (scores, θ, θ̇) with no process noise; its sigma points, 2(k + 2) at √(k + 2) sds with equal weights
    (Julier and Uhlmann's with κ = 0), are drawn anew after each sample and moved to the next by the kernel.
    A reflected score starts with mean and
    sd of a half-normal: about zero the filter would see no slope. A scale that coefficients share is held at 1, a
    damping ratio of 0.1. From the mode comes the sd of the noise.
    """
    index, signal = target.moving, target.signal
    k, order = index.size, ("angle", "velocity", "acceleration").index(signal.quantity)
    reflected = target.reflected[index]
    mean = np.where(reflected, HALF_NORMAL[0], 0.0)
    sd = np.where(reflected, HALF_NORMAL[1], 1.0)
    noise, z, motions = target.all_values(mode.z)["noise_sd"], mode.z.copy(), mode.likelihood.motions

    def values(u: np.ndarray) -> dict[str, float]:
        z[index] = u  # the noise's own scores are held at the mode
        return target.all_values(z)

    def moved(x: np.ndarray, gap: float) -> tuple[np.ndarray, float]:
        p = {**values(x[:k]), "theta0": float(x[k]), "omega0": float(x[k + 1])}
        state = motions.after(p, gap)
        return np.concatenate([x[:k], state[:2]]), float(state[order])

    away = math.sqrt(k) * np.diag(sd)
    started = [(u, values(u)) for u in np.concatenate([mean + away, mean - away])]
    points = np.array([[*u, p["theta0"], p["omega0"]] for u, p in started])
    mean = points.mean(axis=0)
    covariance = (points - mean).T @ (points - mean) / (2 * k)
    means, sds = np.empty((signal.t.size, k)), np.empty((signal.t.size, k))
    for i, (y, gap) in enumerate(zip(signal.y.tolist(), np.r_[0.0, np.diff(signal.t)].tolist(), strict=True)):
        pairs = [moved(x, gap) for x in _spread(mean, covariance)]
        points, seen = np.array([x for x, _ in pairs]), np.array([v for _, v in pairs])
        mean, expected = points.mean(axis=0), float(seen.mean())
        about, off = points - mean, seen - expected
        variance = float(np.mean(off**2)) + noise**2
        gain = about.T @ off / off.size / variance
        mean = mean + gain * (y - expected)
        covariance = about.T @ about / off.size - variance * np.outer(gain, gain)
        covariance = 0.5 * (covariance + covariance.T)
        means[i], sds[i] = mean[:k], np.sqrt(np.maximum(np.diag(covariance)[:k], 0.0))
        if not np.all(np.isfinite(covariance)):
            means[i:], sds[i:] = np.nan, np.nan
            break
    return Online(means, sds, covariance[:k, :k])


def _spread(mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return sigma points, (2d, d), of a normal distribution with this mean, (d,), and covariance, (d, d).

    By eigenvectors of the correlations: at first θ and θ̇ follow from the scores, and no Cholesky factor exists.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    lengths, axes = np.linalg.eigh(covariance / sd[:, None] / sd)
    away = math.sqrt(mean.size) * sd[:, None] * axes * np.sqrt(np.maximum(lengths, 0.0))
    return np.concatenate([mean + away.T, mean - away.T])
