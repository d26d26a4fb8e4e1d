"""Independent heavy-tailed noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jax import Array
from jax import numpy as jnp
from jax.scipy.special import betainc, gammaln, ndtri

from bayesdamp.inference.noise._noise import NoiseModel
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features


class StudentT(NoiseModel):
    """r_i / noise_sd ~ Student's t with noise_dof degrees of freedom, independent; noise_sd is the scale."""

    name = "student_t"
    parameters = ("noise_sd", "noise_dof")
    heavy_tailed = True

    def priors(self, features: Features) -> dict[str, Prior]:
        """The scale lognormal about the record's roughness, degrees of freedom lognormal about 6."""
        return {
            "noise_sd": LogNormal(median=features.roughness, sigma=1.0),
            "noise_dof": LogNormal(median=6.0, sigma=0.8),
        }

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """The scale from the median absolute residual, and six degrees of freedom."""
        return {"noise_sd": float(1.4826 * np.median(np.abs(r)) + 1e-300), "noise_dof": 6.0}

    def log_likelihood(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Σ log of Student's density of scale σ and ν degrees of freedom."""
        sd, dof = p["noise_sd"], p["noise_dof"]
        constant = gammaln(0.5 * (dof + 1)) - gammaln(0.5 * dof) - 0.5 * jnp.log(dof * jnp.pi) - jnp.log(sd)
        return r.size * constant - 0.5 * (dof + 1) * jnp.sum(jnp.log1p((r / sd) ** 2 / dof))

    def whiten(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Normal scores of the residuals by their cumulative probabilities."""
        t, dof = r / p["noise_sd"], p["noise_dof"]
        tail = 0.5 * betainc(0.5 * dof, 0.5, dof / (dof + t**2))
        return -jnp.sign(t) * ndtri(jnp.clip(tail, 1e-300, 0.5))

    def information_root(self, v: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Slopes over σ times √((ν + 1)/(ν + 3)), Student's Fisher information."""
        dof = p["noise_dof"]
        return v / p["noise_sd"] * jnp.sqrt((dof + 1) / (dof + 3))

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Student's t of ν degrees of freedom, times σ."""
        return p["noise_sd"] * rng.standard_t(p["noise_dof"], gaps.size + 1)


PLUGIN = StudentT()
