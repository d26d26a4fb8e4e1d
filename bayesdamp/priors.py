"""Priors of one parameter, as a study file writes them.

Every prior is a monotone map of a standard normal score z (a half-normal is the folded one, x = scale·|z|),
so that any model's prior in the scores is N(0, 1) in each direction and its density is normalised without
further ado.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, ClassVar, Literal

import jax.numpy as jnp
from jax import Array
from jax.scipy.special import ndtr, ndtri
from jax.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, model_validator

Scalar = float | Array


class _Prior(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    folded: bool = Field(default=False, exclude=True, init=False, repr=False)

    transform: ClassVar[Callable[..., Array]]
    """(z, *numbers): the parameter at the normal score z (any shape) for a prior with these numbers."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """What distinguishes this prior from others of its kind, in the order of `transform`."""
        return tuple(v for k, v in self.model_dump().items() if k != "prior")

    def value(self, z: ArrayLike) -> Array:
        """The parameter at the normal score z (any shape)."""
        return self.transform(z, *self.numbers)

    def score(self, x: ArrayLike) -> Array:
        """A normal score of the value x, the non-negative one where the prior is folded."""
        raise NotImplementedError

    def log_density(self, x: ArrayLike) -> Array:
        """Normalised log density at x, −∞ outside the support."""
        raise NotImplementedError

    def describe(self) -> str:
        """In words, for tables."""
        body = self.model_dump(exclude={"prior"})
        return f"{self.prior}({', '.join(f'{k} {v:.4g}' for k, v in body.items())})"  # type: ignore[attr-defined]


_HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


class Normal(_Prior):
    """Normal with mean and sd."""

    prior: Literal["normal"] = "normal"
    mean: float
    sd: PositiveFloat

    @staticmethod
    def transform(z: ArrayLike, mean: Scalar, sd: Scalar) -> Array:
        return mean + sd * jnp.asarray(z)

    def score(self, x: ArrayLike) -> Array:
        return (jnp.asarray(x) - self.mean) / self.sd

    def log_density(self, x: ArrayLike) -> Array:
        return -0.5 * self.score(x) ** 2 - _HALF_LOG_2PI - math.log(self.sd)


class HalfNormal(_Prior):
    """|Normal(0, scale)|: touches zero without a boundary in the score."""

    prior: Literal["halfnormal"] = "halfnormal"
    scale: PositiveFloat
    folded: bool = Field(default=True, exclude=True, init=False, repr=False)

    @staticmethod
    def transform(z: ArrayLike, scale: Scalar) -> Array:
        return scale * jnp.abs(jnp.asarray(z))

    def score(self, x: ArrayLike) -> Array:
        return jnp.abs(jnp.asarray(x)) / self.scale

    def log_density(self, x: ArrayLike) -> Array:
        x = jnp.asarray(x)
        inside = -0.5 * (x / self.scale) ** 2 - _HALF_LOG_2PI - math.log(self.scale) + math.log(2)
        return jnp.where(x >= 0, inside, -jnp.inf)


class LogNormal(_Prior):
    """exp Normal(log median, sigma)."""

    prior: Literal["lognormal"] = "lognormal"
    median: PositiveFloat
    sigma: PositiveFloat

    @staticmethod
    def transform(z: ArrayLike, median: Scalar, sigma: Scalar) -> Array:
        return median * jnp.exp(sigma * jnp.asarray(z))

    def score(self, x: ArrayLike) -> Array:
        return jnp.log(jnp.asarray(x) / self.median) / self.sigma

    def log_density(self, x: ArrayLike) -> Array:
        x = jnp.asarray(x)
        safe = jnp.where(x > 0, x, self.median)
        inside = -0.5 * self.score(safe) ** 2 - _HALF_LOG_2PI - math.log(self.sigma) - jnp.log(safe)
        return jnp.where(x > 0, inside, -jnp.inf)


class Uniform(_Prior):
    """Uniform between low and high."""

    prior: Literal["uniform"] = "uniform"
    low: float
    high: float

    @model_validator(mode="after")
    def _ordered(self) -> Uniform:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be below high ({self.high:g})")
        return self

    @staticmethod
    def transform(z: ArrayLike, low: Scalar, high: Scalar) -> Array:
        return low + (high - low) * ndtr(jnp.asarray(z))

    def score(self, x: ArrayLike) -> Array:
        share = (jnp.asarray(x) - self.low) / (self.high - self.low)
        return ndtri(jnp.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> Array:
        x = jnp.asarray(x)
        return jnp.where((x >= self.low) & (x <= self.high), -math.log(self.high - self.low), -jnp.inf)


class LogUniform(_Prior):
    """Uniform in the logarithm between low and high."""

    prior: Literal["loguniform"] = "loguniform"
    low: PositiveFloat
    high: PositiveFloat

    @model_validator(mode="after")
    def _ordered(self) -> LogUniform:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be below high ({self.high:g})")
        return self

    @staticmethod
    def transform(z: ArrayLike, low: Scalar, high: Scalar) -> Array:
        return low * jnp.exp(jnp.log(high / low) * ndtr(jnp.asarray(z)))

    def score(self, x: ArrayLike) -> Array:
        share = jnp.log(jnp.asarray(x) / self.low) / math.log(self.high / self.low)
        return ndtri(jnp.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> Array:
        x = jnp.asarray(x)
        safe = jnp.where(x > 0, x, self.low)
        inside = -jnp.log(safe) - math.log(math.log(self.high / self.low))
        return jnp.where((x >= self.low) & (x <= self.high), inside, -jnp.inf)


Prior = Annotated[Normal | HalfNormal | LogNormal | Uniform | LogUniform, Field(discriminator="prior")]
