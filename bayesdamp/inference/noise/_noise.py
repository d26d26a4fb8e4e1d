"""Base classes of the noise models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal

DIFFERENCE = 1e-5
"""Step of central differences, relative to the noise's scale: close to the cube root of the rounding error, at which
rounding and truncation are equally large."""


class NoiseModel(ABC):
    """Distribution of the residuals, which are the record minus the motion.

    The methods have these arguments, where (...) stands for any leading axes, such as draws:

    r: residuals in the unit of the record, shape (..., n); the last axis is time.
    gaps: times between samples in s, shape (n - 1,).
    p: values of the parameters and constants by name, each a number or an array that broadcasts to the shape (...).
    """

    name: str
    parameters: tuple[str, ...]
    constants: tuple[str, ...] = ()
    """Numbers that are read from the record, such as its recording step; they are not inferred."""
    tied: tuple[str, str] | None = None
    """Two parameters of which the data determine a combination much better than the second one."""
    heavy_tailed: bool = False
    """Whether the model allows for outliers, so that they are not reported as a misfit."""

    def read(self, signal: Signal) -> dict[str, float]:
        """Return the constants. Raises Refusal where the model does not apply to the record."""
        return {}

    @abstractmethod
    def priors(self, features: Features) -> dict[str, Prior]:
        """Return default priors. They depend on the record's features alone: all dampings have the same ones."""

    @abstractmethod
    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate the parameters from residuals, (n,), as the start of a search."""

    @abstractmethod
    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of the residuals in nats, shape (...)."""

    @abstractmethod
    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log likelihood by each residual, shape (..., n)."""

    def parameter_slopes(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the log likelihood of residuals (n,) by the parameters, by central differences."""
        slopes = {}
        for name in self.parameters:
            step = DIFFERENCE * abs(p[name])
            above, below = (self.log_likelihood(r, gaps, {**p, name: p[name] + s}) for s in (step, -step))
            slopes[name] = float(above - below) / (2 * step)
        return slopes

    @abstractmethod
    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return R v, shape (..., n), where RᵀR is the Fisher information about a shift of the record by v."""

    @abstractmethod
    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return scores, shape (..., n), that are independent and standard normal if the model holds."""

    @abstractmethod
    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of each residual given all others, shape (..., n).

        Leave-one-out cross-validation uses it.
        """

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw the noise of one record, shape (n,). Raises Refusal where the model cannot be drawn from."""
        raise Refusal(f"noise {self.name!r} cannot be drawn from")


class IndependentNoise(NoiseModel):
    """Noise whose residuals are independent and have a common scale `noise_sd`. `log_density` defines it.

    The other methods have defaults. Override `slope` where the derivative is known, which is faster, and
    `information_root` and `whiten` where the noise is far from normal.
    """

    parameters = ("noise_sd",)

    @abstractmethod
    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the log density of each residual in nats, shape (..., n); the values in p broadcast to r."""

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return a lognormal prior for the scale, with the record's roughness as its median and sigma 1."""
        return {"noise_sd": LogNormal(median=features.roughness, sigma=1.0)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate the scale by the root mean square of the residuals."""
        return {"noise_sd": float(np.sqrt(np.mean(r**2)))}

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Sum the log densities."""
        return np.sum(self.log_likelihoods(r, gaps, p), axis=-1)

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log densities: the other residuals do not matter."""
        return self.log_density(r, by_sample(p))

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Differentiate the log density by central differences."""
        p = by_sample(p)
        above, below = r + DIFFERENCE * p["noise_sd"], r - DIFFERENCE * p["noise_sd"]
        return (self.log_density(above, p) - self.log_density(below, p)) / (above - below)

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by the scale, as for normal noise."""
        return v / by_sample(p)["noise_sd"]

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by the scale, as for normal noise."""
        return r / by_sample(p)["noise_sd"]


def by_sample(p: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Add a last axis of length 1 to each parameter, so that it broadcasts against residuals."""
    return {name: np.asarray(value, float)[..., None] for name, value in p.items()}
