"""Correlated normal noise with an exponential kernel."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jax import Array
from jax import numpy as jnp

from bayesdamp.inference.noise._noise import NormalNoise, Tied
from bayesdamp.inference.noise.gaussian import LOG_2PI
from bayesdamp.priors import LogNormal, LogUniform, Prior
from bayesdamp.records.oscillation.features import Features

FASTEST, SLOWEST = 5e-4, 2.0
"""Periods between which the correlation time is. What lasts longer than two is no noise about a motion but another zero
for it, and lets a law that cannot have the record's own fit all the same."""


class Correlated(NormalNoise):
    """cov(r_i, r_j) = noise_sd² exp(−|t_i − t_j| / noise_time), the first sample stationary.

    AR(1) with ρ = exp(−Δt / noise_time) on a uniform clock, and right under jitter and gaps.
    """

    name = "correlated"
    parameters = ("noise_sd", "noise_time")
    tied = Tied("noise_sd", "noise_time", 0.5)
    """Of noise that is slow beside the clock: noise_sd²/noise_time, by its differences from sample to sample."""
    sums = ("squares", "differences", "ends")
    uniform_clock = True

    def priors(self, features: Features) -> dict[str, Prior]:
        """The sd lognormal about the record's roughness; the time log-uniform between the sampling and the record."""
        return {
            "noise_sd": LogNormal(median=features.roughness, sigma=1.0),
            "noise_time": LogUniform(low=FASTEST * features.period, high=SLOWEST * features.period),
        }

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """The sd of the residuals, and the time from their correlation at one lag."""
        rho = float(np.clip(np.sum(r[1:] * r[:-1]) / np.sum(r**2), 0.01, 0.9999))
        return {
            "noise_sd": float(np.sqrt(np.mean(r**2))),
            "noise_time": float(-np.median(gaps) / np.log(rho)),
        }

    def whiten(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Innovations of the exponential kernel over their sds (Ornstein and Uhlenbeck 1930)."""
        sd, exponent = p["noise_sd"], -gaps / p["noise_time"]
        # 1 − ρ² by expm1: ρ is close to 1 where the clock is fast.
        steps = (r[1:] - jnp.exp(exponent) * r[:-1]) / jnp.sqrt(-jnp.expm1(2 * exponent))
        return jnp.concatenate([r[:1], steps]) / sd

    def log_likelihood(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Σ log N(innovation; 0, σ²(1 − ρ²)), ρ = exp(−Δt/τ): exact for an exponential kernel."""
        innovations = jnp.log(-jnp.expm1(-2 * gaps / p["noise_time"]))
        log_scale = r.size * (jnp.log(p["noise_sd"]) + 0.5 * LOG_2PI) + 0.5 * jnp.sum(innovations)
        return -0.5 * jnp.sum(self.whiten(r, gaps, p) ** 2) - log_scale

    def log_likelihood_of_sums(
        self, sums: Mapping[str, Array], count: Array, gap: Array, p: Mapping[str, Array]
    ) -> Array:
        # r_1² + Σ (r_{i+1} − ρ r_i)²/(1 − ρ²), ordered by 1 − ρ so that no two large terms are subtracted.
        """The same from sums over samples of one gap."""
        sd, exponent = p["noise_sd"], -gap / p["noise_time"]
        rho, lost = jnp.exp(exponent), -jnp.expm1(exponent)
        square = (rho / lost * sums["differences"] + lost * sums["squares"] + rho * sums["ends"]) / (1 + rho)
        innovations = (count - 1) * jnp.log(-jnp.expm1(2 * exponent))
        return -0.5 * square / sd**2 - count * (jnp.log(sd) + 0.5 * LOG_2PI) - 0.5 * innovations

    def information_root(self, v: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Whitening of the slopes: the noise is Gaussian, and whitening linear."""
        return self.whiten(v, gaps, p)

    def log_likelihoods(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """From the precision matrix K⁻¹ of the record, which is tridiagonal: given all others, r_i is normal with mean
        r_i − (K⁻¹ r)_i / K⁻¹_ii and variance 1/K⁻¹_ii (Bürkner, Gabry and Vehtari, Comput. Stat. 36, 2021)."""
        rho, lost = jnp.exp(-gaps / p["noise_time"]), -jnp.expm1(-2 * gaps / p["noise_time"])
        nought = jnp.zeros(1)
        own = 1.0 + jnp.concatenate([nought, rho**2 / lost]) + jnp.concatenate([rho**2 / lost, nought])
        ahead = jnp.concatenate([rho / lost * r[1:], nought]) + jnp.concatenate([nought, rho / lost * r[:-1]])
        score = (own * r - ahead) / jnp.sqrt(own) / p["noise_sd"]
        return -0.5 * score**2 - jnp.log(p["noise_sd"]) + 0.5 * jnp.log(own) - 0.5 * LOG_2PI

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """A stationary Ornstein–Uhlenbeck process at the samples."""
        exponent, r = -gaps / p["noise_time"], rng.standard_normal(gaps.size + 1)
        rho, fresh = np.exp(exponent), np.sqrt(-np.expm1(2 * exponent))
        for i in range(gaps.size):
            r[i + 1] = rho[i] * r[i] + fresh[i] * r[i + 1]
        return p["noise_sd"] * r


PLUGIN = Correlated()
