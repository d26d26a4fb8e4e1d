"""Normal noise, rounded to the recording step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jax import Array
from jax import numpy as jnp
from jax.scipy.special import log_ndtr

from bayesdamp.inference.noise._noise import NoiseModel
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal


class Quantised(NoiseModel):
    """r_i is normal noise of noise_sd, independent, rounded to a multiple of noise_step.

    The likelihood of a value is the probability of the step around it; divided by the step it is a density, so that
    it stands on one scale with those of the other models.
    """

    name = "quantised"
    parameters = ("noise_sd",)
    constants = ("noise_step",)

    def read(self, signal: Signal) -> dict[str, float]:
        """The recording step of the signal. Raises Refusal where it shows none."""
        if not signal.step > 0:
            raise Refusal("the record shows no recording step: quantised noise is gaussian noise there")
        return {"noise_step": signal.step}

    def priors(self, features: Features) -> dict[str, Prior]:
        """The sd before rounding, lognormal about the record's roughness."""
        return {"noise_sd": LogNormal(median=features.roughness, sigma=1.0)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """The root mean square of the residuals, rounding among them."""
        return {"noise_sd": float(np.sqrt(np.mean(r**2)))}

    def log_likelihood(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Σ log [Φ((step/2 − r)/σ) − Φ((−step/2 − r)/σ)]/step: the chance of each rounded value."""
        sd, step = p["noise_sd"], p["noise_step"]
        # By symmetry in the lower tail, where differences of probabilities keep their digits.
        near, far = (0.5 * step - jnp.abs(r)) / sd, (-0.5 * step - jnp.abs(r)) / sd
        top, bottom = log_ndtr(near), log_ndtr(far)
        return jnp.sum(top + jnp.log(-jnp.expm1(bottom - top))) - r.size * jnp.log(step)

    def whiten(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """r over √(σ² + step²/12) (Sheppard 1898)."""
        return r / self._scatter(p)

    def information_root(self, v: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        # What rounding leaves of the information where the noise spreads over the steps (Sheppard's correction).
        """Slopes over the same scatter."""
        return v / self._scatter(p)

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        # What rounding to a lattice adds to a motion that lies anywhere between its points.
        """Normal noise, rounded at a place that is uniform within the step."""
        n, step = gaps.size + 1, p["noise_step"]
        where, normal = rng.uniform(-0.5, 0.5, n) * step, p["noise_sd"] * rng.standard_normal(n)
        return step * np.round((where + normal) / step) - where

    @staticmethod
    def _scatter(p: Mapping[str, Array]) -> Array:
        return jnp.sqrt(p["noise_sd"] ** 2 + p["noise_step"] ** 2 / 12)


PLUGIN = Quantised()
