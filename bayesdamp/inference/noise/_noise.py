"""What a noise model is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.numerics.lazily import jax
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal

if TYPE_CHECKING:
    from jax import Array


@dataclass(frozen=True)
class Tied:
    """The parameter `one` over `other` to a power is what the data tell."""

    one: str
    other: str
    power: float


class NoiseModel(ABC):
    """How residuals (record minus trajectory) are distributed.

    r: residuals in the unit of the record, shape (n,); gaps: times between samples in s, shape (n − 1,).
    """

    name: str
    parameters: tuple[str, ...]
    constants: tuple[str, ...] = ()
    """Numbers that the record itself gives, such as its recording step; they are not inferred."""
    tied: Tied | None = None
    """What the data tell of two parameters where they tell little of each."""
    heavy_tailed: bool = False
    """Whether far outliers hardly move what is inferred, so that they are no misfit."""

    def read(self, signal: Signal) -> dict[str, float]:
        """The constants. Raises Refusal where the record is not one for this model."""
        return {}

    @abstractmethod
    def priors(self, features: Features) -> dict[str, Prior]:
        """Default priors, from the record's features alone: the same for every damping."""

    @abstractmethod
    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Parameters read from residuals, to start a search at."""

    @abstractmethod
    def log_likelihood(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Log density of the residuals in nats, shape ()."""

    @abstractmethod
    def whiten(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Residuals as independent standard scores, shape (n,): what is left to see once the model holds."""

    @abstractmethod
    def information_root(self, v: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """R v with RᵀR the Fisher information about a shift of the record by v, shape (n,)."""

    def log_likelihoods(self, r: Array, gaps: Array, p: Mapping[str, Array]) -> Array:
        """Log density of each residual given all others, shape (n,): what leave-one-out cross-validation weighs.

        As for independent residuals; noise whose samples depend on one another has its own.
        """
        return jax.vmap(lambda one: self.log_likelihood(one[None], gaps[:0], p))(r)

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Noise of one record, shape (n,). Raises Refusal where the model does not say how it is drawn."""
        raise Refusal(f"noise {self.name!r} does not say how it is drawn")


class NormalNoise(NoiseModel):
    """Noise whose log likelihood is linear in a few sums of squares of residuals, so that a record can be condensed.

    sums: their names: "squares" Σ r_i², "differences" Σ (r_{i+1} − r_i)², "ends" r_1² + r_n². uniform_clock:
    whether they suffice on a uniform clock only.
    """

    sums: tuple[str, ...]
    uniform_clock: bool

    @abstractmethod
    def log_likelihood_of_sums(
        self, sums: Mapping[str, Array], count: Array, gap: Array, p: Mapping[str, Array]
    ) -> Array:
        """`log_likelihood` of count residuals with these sums of squares, gap (s) apart on average, shape ()."""
