"""Normal noise with exponentially decaying correlation."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.inference.noise import NoiseModel, by_sample
from bayesdamp.inference.noise.gaussian import LOG_2PI
from bayesdamp.priors import LogNormal, LogUniform, Prior
from bayesdamp.records.oscillation.features import Features

FASTEST, SLOWEST = 5e-4, 2.0
"""Smallest and largest correlation time in its prior, in periods of the oscillation. Noise that is correlated over more
than two periods acts like an offset of the sensor, so that a wrong restoring law can fit the record."""


class CorrelatedNoise(NoiseModel):
    """Stationary normal noise with the covariance noise_sd² exp(−|t_i − t_j| / noise_time).

    For samples at equal distances Δt this is the process AR(1) with ρ = exp(−Δt / noise_time). It is also valid for
    uneven times, and for interruptions of the record.
    """

    parameters = ("noise_sd", "noise_time")
    tied = ("noise_sd", "noise_time")
    """Two parameters of which the record may determine only a combination well. If the noise is slow compared with the
    sampling, it determines noise_sd²/noise_time. If the noise is fast, it determines noise_sd, and only an upper limit
    of noise_time."""

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return a lognormal prior for noise_sd, and a log-uniform one for noise_time (s), by name.

        The median of noise_sd is the roughness of the record, the sd of its noise over short windows; its sigma is 1.
        noise_time is between `FASTEST` and `SLOWEST` periods of the oscillation.
        """
        return {
            "noise_sd": LogNormal(median=features.roughness, sigma=1.0),
            "noise_time": LogUniform(low=FASTEST * features.period, high=SLOWEST * features.period),
        }

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate noise_sd and noise_time (s), by name, from residuals r, (n,).

        noise_sd is their root mean square. noise_time follows from the correlation of neighbouring residuals (limited
        to 0.01 to 0.9999) and the median of gaps, the times between the samples in s, (n - 1,).
        """
        rho = float(np.clip(np.sum(r[1:] * r[:-1]) / np.sum(r**2), 0.01, 0.9999))
        sd, time = np.sqrt(np.mean(r**2)), -np.median(gaps) / np.log(rho)
        return {"noise_sd": float(sd), "noise_time": float(time)}

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the innovations r_i − ρ r_{i−1}, (..., n), each divided by its sd σ √(1 − ρ²); the first is r_0/σ.

        ρ = exp(−Δt / noise_time) is the correlation of neighbours, and σ is noise_sd. gaps: times Δt between the
        samples in s, (n - 1,). p: noise_sd and noise_time (s) by name.
        """
        p = by_sample(p)
        return _innovations(r, *_decay(gaps, p)) / p["noise_sd"]

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of residuals r, (...): Σ log N(r_i − ρ r_{i−1}; 0, σ²(1 − ρ²)) + log N(r_0; 0, σ²).

        ρ = exp(−Δt / noise_time) is the correlation of neighbours, and σ is noise_sd. r: in the unit of the record,
        (..., n). gaps: times Δt between the samples in s, (n - 1,). p: noise_sd and noise_time (s) by name. The result
        is in nats.
        """
        p = by_sample(p)
        lost, fresh = _decay(gaps, p)
        square = np.sum(np.square(_innovations(r, lost, fresh)), axis=-1)
        sd = p["noise_sd"][..., 0]
        log_scale = r.shape[-1] * (np.log(sd) + 0.5 * LOG_2PI) + np.sum(np.log(fresh), axis=-1)
        return -0.5 * square / sd**2 - log_scale

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density by each residual, −K⁻¹ r, (..., n), with the covariance matrix K.

        K_ij = noise_sd² exp(−|t_i − t_j| / noise_time), with the times between samples in gaps, (n - 1,), in s. p:
        noise_sd and noise_time (s) by name.
        """
        p = by_sample(p)
        lost, fresh = _decay(gaps, p)
        slopes = -_innovations(r, lost, fresh)
        slopes[..., 1:] /= fresh
        slopes[..., :-1] -= (1 - lost) * slopes[..., 1:]
        return slopes / p["noise_sd"] ** 2

    def parameter_slopes(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the log density (nats) of residuals, (n,), by noise_sd and noise_time, by name.

        They are from closed forms. gaps: times between the samples in s, (n - 1,). p: noise_sd and noise_time (s) by
        name.
        """
        sd, time = p["noise_sd"], p["noise_time"]
        lost, fresh = _decay(gaps, {"noise_time": np.asarray(time)})
        innovations = _innovations(r, lost, fresh)
        steps, rho = innovations[1:] / sd, 1 - lost
        # The derivative of each log density by ρ; and dρ/dtime = ρ Δt/time².
        by_rho = (steps * r[:-1] / sd + rho * (1 - steps**2) / fresh) / fresh
        return {
            "noise_sd": float(innovations @ innovations / sd**2 - r.size) / sd,
            "noise_time": float(by_rho @ (rho * gaps)) / time**2,
        }

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return a shift v of the record, (..., n), whitened.

        The sum of squares of the result is the Fisher information about the shift, because whitening is linear and the
        noise normal. v: change of each sample in the unit of the record. gaps: times between the samples in s, (n -
        1,). p: noise_sd and noise_time (s) by name.
        """
        return self.whiten(v, gaps, p)

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of each residual given all others, (..., n), from the precision matrix K⁻¹.

        Given all others, r_i is normal with mean r_i − (K⁻¹ r)_i / K⁻¹_ii and variance 1/K⁻¹_ii (Bürkner, Gabry and
        Vehtari, Comput. Stat. 36, 2021). K is the covariance matrix. gaps: times between the samples in s, (n - 1,). p:
        noise_sd and noise_time (s) by name.
        """
        sd = by_sample(p)["noise_sd"]
        lost, fresh = _decay(gaps, by_sample(p))
        ratio = np.square((1 - lost) / fresh)
        precision = np.ones((*ratio.shape[:-1], r.shape[-1]))
        precision[..., 1:] += ratio
        precision[..., :-1] += ratio
        score = self.slope(r, gaps, p) * sd / np.sqrt(precision)
        return -0.5 * score**2 - np.log(sd) + 0.5 * np.log(precision) - 0.5 * LOG_2PI

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw the noise at the times of the samples, (n,): a stationary Ornstein–Uhlenbeck process.

        gaps: times between the samples in s, (n - 1,). p: noise_sd and noise_time (s) by name; noise_sd is the sd of
        each value.
        """
        lost, fresh = _decay(gaps, by_sample(p))
        r = rng.standard_normal(gaps.size + 1)
        for i in range(gaps.size):
            r[i + 1] = (1 - lost[i]) * r[i] + fresh[i] * r[i + 1]
        return p["noise_sd"] * r


def _decay(gaps: np.ndarray, p: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return 1 − ρ and √(1 − ρ²) for each time step, (..., n − 1), without loss of digits if ρ is close to 1.

    ρ = exp(−Δt / noise_time) is the correlation of two neighbouring residuals. gaps: the time steps Δt in s, (n − 1,).
    p: parameters from `by_sample`; only `noise_time`, in s, is used.
    """
    lost = -np.expm1(-gaps / p["noise_time"])
    return lost, np.sqrt(lost * (2 - lost))


def _innovations(r: np.ndarray, lost: np.ndarray, fresh: np.ndarray) -> np.ndarray:
    """Return the first residual, then (r_{i+1} − ρ r_i)/√(1 − ρ²): independent N(0, σ²) values, shape (..., n).

    lost, fresh: 1 − ρ and √(1 − ρ²) from `_decay`, (..., n − 1), with the correlation ρ of neighbours. The differences
    of neighbours are computed first, to lose no digits for slow noise.
    """
    steps = (r[..., 1:] - r[..., :-1] + lost * r[..., :-1]) / fresh
    innovations = np.empty((*steps.shape[:-1], r.shape[-1]))
    innovations[..., :1], innovations[..., 1:] = r[..., :1], steps
    return innovations


PLUGIN = CorrelatedNoise()
