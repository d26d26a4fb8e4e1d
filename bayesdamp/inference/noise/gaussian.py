"""Independent normal noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.inference.noise._noise import NormalNoise
from bayesdamp.numerics.lazily import jnp
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features

if TYPE_CHECKING:
    from jax import Array

LOG_2PI = math.log(2 * math.pi)


class Gaussian(NormalNoise):
    """r_i ~ N(0, noise_sd²), independent."""

    name = "gaussian"
    parameters = ("noise_sd",)
    sums = ("squares",)
    uniform_clock = False

    def priors(self, features: Features) -> dict[str, Prior]:
        """The sd lognormal about the record's roughness, sigma 1."""
        return {"noise_sd": LogNormal(median=features.roughness, sigma=1.0)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """The root mean square of the residuals."""
        return {"noise_sd": float(np.sqrt(np.mean(r**2)))}

    def log_likelihood(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Σ log N(r; 0, σ²)."""
        sd = p["noise_sd"]
        return -0.5 * jnp.sum((r / sd) ** 2) - r.size * (jnp.log(sd) + 0.5 * LOG_2PI)

    def log_likelihood_of_sums(
        self, sums: Mapping[str, Array], count: Array, gap: Array, p: Mapping[str, Array]
    ) -> Array:
        """The same from the sum of squares."""
        sd = p["noise_sd"]
        return -0.5 * sums["squares"] / sd**2 - count * (jnp.log(sd) + 0.5 * LOG_2PI)

    def whiten(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """r/σ."""
        return r / p["noise_sd"]

    def information_root(self, v: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Slopes over σ."""
        return v / p["noise_sd"]

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """White noise of sd σ."""
        return p["noise_sd"] * rng.standard_normal(gaps.size + 1)


PLUGIN = Gaussian()
