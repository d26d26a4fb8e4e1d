"""Independent normal noise."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.inference.noise import IndependentNoise, by_sample

LOG_2PI = math.log(2 * math.pi)


class Gaussian(IndependentNoise):
    """Independent normal residuals, r_i ~ N(0, noise_sd²)."""

    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return log N(r; 0, σ²) in nats for each residual r, (..., n).

        r: residuals in the unit of the record. σ is noise_sd in p, in a shape that broadcasts to r.
        """
        return -0.5 * np.square(r / p["noise_sd"]) - (np.log(p["noise_sd"]) + 0.5 * LOG_2PI)

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density (nats) of all n residuals together, (...): −Σ r²/(2σ²) − n log(√(2π) σ).

        r: residuals in the unit of the record, (..., n). σ is noise_sd in p, a number or an array (...). gaps has no
        effect.
        """
        sd, squares = np.asarray(p["noise_sd"], float), np.einsum("...i,...i", r, r)
        return -0.5 * squares / sd**2 - r.shape[-1] * (np.log(sd) + 0.5 * LOG_2PI)

    def parameter_slopes(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivative of the log density (nats) of residuals r, (n,), by σ, under the key `noise_sd`.

        It is Σ r²/σ³ − n/σ, where σ is noise_sd in p. gaps has no effect.
        """
        sd = p["noise_sd"]  # divided one by one, because powers overflow at extreme values
        return {"noise_sd": float(r @ r) / sd / sd / sd - r.size / sd}

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density (nats) by each residual r, −r/σ², (..., n); σ is noise_sd in p.

        gaps has no effect.
        """
        sd = by_sample(p)["noise_sd"]
        return -r / sd / sd

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw white noise with the sd noise_sd in p, (n,); only the size of gaps, (n − 1,), has an effect."""
        return p["noise_sd"] * rng.standard_normal(gaps.size + 1)


PLUGIN = Gaussian()
