"""Priors of a parameter, as in a study file.

Every prior is a monotone map of a standard normal score z (a half-normal is a reflected one, x = scale·|z|), so that
any model's prior in the scores is N(0, 1) in each direction, with a normalised density.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
import scipy.special as host
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError, model_validator

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from jax import Array

Scalar: TypeAlias = "float | Array"
_HOST = SimpleNamespace(exp=np.exp, log=np.log, ndtr=host.ndtr)
_NUMBER = SimpleNamespace(
    exp=lambda z: math.exp(min(z, 709.0)), log=math.log, ndtr=lambda z: 0.5 * math.erfc(-z / math.sqrt(2.0))
)
"""The same for a single number, several times faster; exponentials stay finite."""


def _is_traced(value: object) -> bool:
    """Return whether a value is an array of JAX, as in NumPyro's models; loads nothing."""
    return "jax" in sys.modules and isinstance(value, sys.modules["jax"].Array)


def _functions(z: Any) -> SimpleNamespace:
    """Return the functions exp, log and ndtr for values of this type."""
    if isinstance(z, float):
        return _NUMBER
    if not _is_traced(z):
        return _HOST
    from jax import numpy as jnp
    from jax.scipy.special import ndtr

    return SimpleNamespace(exp=jnp.exp, log=jnp.log, ndtr=ndtr)


@cache
def _field_names(kind: type[BaseModel]) -> tuple[str, ...]:
    """Return the names of the numbers of a kind of prior."""
    return tuple(name for name, field in kind.model_fields.items() if name != "prior" and not field.exclude)


class _Prior(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    reflected: bool = Field(default=False, exclude=True, init=False, repr=False)

    def _begin(self, **numbers: float) -> None:
        """Make a prior in Python. Raises InputError with one line.

        The reader of study files validates tables in another way.
        """
        try:
            super().__init__(**numbers)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            what = ".".join(str(part) for part in first["loc"])
            shown = f"{what} is {first['input']!r}: " if what else ""
            right = first.get("ctx", {}).get("error") or first["msg"].lower()
            raise InputError(f"{type(self).__name__}: {shown}{right}") from None

    def __init_subclass__(cls, **options: Any) -> None:
        # So that pydantic continues to validate tables by itself, strictly where a model demands that.
        cls.__init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]
        super().__init_subclass__(**options)

    transform: ClassVar[Callable[..., Any]]
    """(z, *numbers): the parameter at the normal score z (any shape) for a prior with these numbers, traced for arrays
    of JAX."""
    derivative: ClassVar[Callable[..., Any]]
    """(z, *numbers): the derivative of `transform` by z."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the numbers of this prior, in the order of `transform`."""
        return tuple(getattr(self, name) for name in _field_names(type(self)))

    def value(self, z: ArrayLike) -> np.ndarray:
        """Return the parameter at the normal score z (any shape)."""
        return self.transform(np.asarray(z, float), *self.numbers)

    def rate(self, z: ArrayLike) -> np.ndarray:
        """Return the derivative of `value` by the score z (any shape)."""
        z = np.asarray(z, float)
        return np.broadcast_to(self.derivative(z, *self.numbers), z.shape)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return a normal score of the value x, the non-negative one where the prior is reflected."""
        raise NotImplementedError

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the normalised log density at x, −∞ outside the support."""
        raise NotImplementedError

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return the derivative of `log_density` at x inside the support."""
        raise NotImplementedError

    def describe(self) -> str:
        """Return it in words, for tables."""
        body = self.model_dump(exclude={"prior"})
        return f"{self.prior}({', '.join(f'{k} {v:.4g}' for k, v in body.items())})"  # type: ignore[attr-defined]


_HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


def _density(z: Any) -> Any:
    """Return φ(z), the standard normal density."""
    return _functions(z).exp(-0.5 * z**2 - _HALF_LOG_2PI)


class Normal(_Prior):
    """Normal with mean and sd."""

    prior: Literal["normal"] = "normal"
    mean: float = Field(description="a number")
    sd: PositiveFloat = Field(description="a number above 0")

    def __init__(self, mean: float, sd: float) -> None:
        self._begin(mean=mean, sd=sd)

    @staticmethod
    def transform(z: Any, mean: Scalar, sd: Scalar) -> Any:
        """mean + sd z."""
        return mean + sd * z

    @staticmethod
    def derivative(z: Any, mean: Scalar, sd: Scalar) -> Any:
        """sd."""
        return sd

    def score(self, x: ArrayLike) -> np.ndarray:
        """(x − mean)/sd."""
        return np.asarray((np.asarray(x, float) - self.mean) / self.sd)

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """log N(x; mean, sd²)."""
        return -0.5 * self.score(x) ** 2 - _HALF_LOG_2PI - math.log(self.sd)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """−(x − mean)/sd²."""
        return -self.score(x) / self.sd


class HalfNormal(_Prior):
    """|Normal(0, scale)|: it includes zero without a boundary in the score."""

    prior: Literal["halfnormal"] = "halfnormal"
    scale: PositiveFloat = Field(description="a number above 0")
    reflected: bool = Field(default=True, exclude=True, init=False, repr=False)

    def __init__(self, scale: float) -> None:
        self._begin(scale=scale)

    @staticmethod
    def transform(z: Any, scale: Scalar) -> Any:
        """scale · |z|: reflected at zero."""
        return scale * abs(z)

    @staticmethod
    def derivative(z: Any, scale: Scalar) -> Any:
        """scale · sign z."""
        return scale * np.sign(z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """|x|/scale."""
        with np.errstate(divide="ignore", invalid="ignore"):  # a coefficient that is absent has a scale of 0
            return np.asarray(np.abs(x) / self.scale)

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """log 2 N(x; 0, scale²) at x ≥ 0, −∞ below."""
        x = np.asarray(x, float)
        inside = -0.5 * (x / self.scale) ** 2 - _HALF_LOG_2PI - math.log(self.scale) + math.log(2)
        return np.where(x >= 0, inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """−x/scale²."""
        return -np.asarray(x, float) / self.scale**2


class SharedHalfNormal(_Prior):
    """Half-normal of an equivalent damping ratio, whose scale is unknown and the same for all terms of a model.

    The scale is one of `SHARED_SCALES`, all equally probable, so that the evidence does not depend on how small the
    damping is. As the terms share it, their joint density is not a product: it is `shared_log_density`.

    Parameters
    ----------
    per_ratio
        The coefficient at an equivalent damping ratio of 1, in the coefficient's own unit.
    """

    prior: Literal["shared_halfnormal"] = "shared_halfnormal"
    per_ratio: PositiveFloat
    reflected: bool = Field(default=True, exclude=True, init=False, repr=False)

    def __init__(self, per_ratio: float) -> None:
        self._begin(per_ratio=per_ratio)

    @staticmethod
    def transform(z: Any, per_ratio: Scalar) -> Any:
        """Return the coefficient at a score z, the damping ratio in units of `SCORE_RATIO`, reflected at zero."""
        return SCORE_RATIO * per_ratio * abs(z)

    @staticmethod
    def derivative(z: Any, per_ratio: Scalar) -> Any:
        """Return the coefficient at a score of 1, with the sign of z."""
        return SCORE_RATIO * per_ratio * np.sign(z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the damping ratio of the coefficient x in units of `SCORE_RATIO`."""
        with np.errstate(divide="ignore", invalid="ignore"):  # a coefficient that is absent has `per_ratio` 0
            return np.asarray(np.abs(x) / (SCORE_RATIO * self.per_ratio))

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the marginal log density of a single coefficient x; −∞ below 0."""
        x = np.asarray(x, float)
        inside = shared_log_density(self.score(x) ** 2, 1) - math.log(SCORE_RATIO * self.per_ratio)
        return np.where(x >= 0, inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return the derivative of `log_density` at x ≥ 0."""
        z = self.score(x)
        return -shared_precision(z**2, 1) * z / (SCORE_RATIO * self.per_ratio)

    def describe(self) -> str:
        """Return it in words, for tables."""
        return (
            f"half-normal on the damping ratio, its scale shared by the terms and unknown between "
            f"{LEAST_SCALE:g} and {MOST_SCALE:g}"
        )


SCORE_RATIO = 0.1
"""Equivalent damping ratio at a score of 1: a unit of computation, on which no result depends (conventional)."""
LEAST_SCALE, MOST_SCALE = 1e-8, 0.3
"""Scales of the damping ratio between which the prior is uniform in the logarithm: Q from 1.7 to 5e7
(conventional)."""
SHARED_SCALES = LEAST_SCALE * (MOST_SCALE / LEAST_SCALE) ** ((np.arange(25) + 0.5) / 25)
"""Scales that are summed over, equally probable: the middles of 25 cells, each scale about twice the one before. The
sum follows the integral to 0.02 nats for three terms and far better for fewer (the Fourier transform of the integrand,
a gamma function, bounds the error of the midpoint rule)."""
SHARED_SIGMAS = SHARED_SCALES / SCORE_RATIO
"""The same scales as scores."""


def shared_log_density(squares: Any, count: Any, scales: Any = SHARED_SIGMAS) -> Any:
    """Return the log density of the scores of `count` coefficients that share a scale, each ≥ 0.

    Parameters
    ----------
    squares
        Sum of the squared scores, any shape. For arrays of JAX the result is traced.
    count
        Number of the coefficients; traced too where it depends on traced numbers.
    scales
        Scales in scores, (s,), all equally probable.
    """
    return _over_scales(squares, count, scales)[0]


def shared_precision(squares: Any, count: Any, scales: Any = SHARED_SIGMAS) -> Any:
    """Return the mean of 1/σ² over the scales, given the sum of squares. Arguments as for `shared_log_density`.

    The slope of the log density by a score is minus the score times this.
    """
    return _over_scales(squares, count, scales)[1]


def _over_scales(squares: Any, count: Any, scales: Any) -> tuple[Any, Any]:
    """Return `shared_log_density` and `shared_precision`."""
    np_: Any = sys.modules["jax"].numpy if _is_traced(squares) else np
    scales = np_.asarray(scales)
    each = -0.5 * np_.asarray(squares)[..., None] / scales**2 - count * np_.log(scales)
    top = each.max(axis=-1, keepdims=True)
    weight = np_.exp(each - top)
    total = weight.sum(axis=-1)
    constant = count * (math.log(2.0) - _HALF_LOG_2PI) - math.log(scales.size)
    precision = (weight / scales**2).sum(axis=-1) / total
    return np_.log(total) + top[..., 0] + constant, precision


def log_prior_of(
    z: np.ndarray, positive: np.ndarray, shared: np.ndarray, scales: ArrayLike = SHARED_SIGMAS
) -> np.ndarray:
    """Return the log prior density of scores z, (..., d), shape (...).

    They are standard normal, or have a common unknown scale where `shared`, (d,). They are folded where `positive`,
    (d,), and the density is −∞ where one of these is negative.
    """
    plain = z[..., ~shared]
    value = -0.5 * np.sum(plain**2, axis=-1) - plain.shape[-1] * _HALF_LOG_2PI
    if shared.any():
        count = int(shared.sum())
        value = value + shared_log_density(np.sum(z[..., shared] ** 2, axis=-1), count, scales)
        value = value - count * math.log(2.0)
    value = value + int(positive.sum()) * math.log(2.0)
    return np.where(np.all(z[..., positive] >= 0, axis=-1), value, -np.inf)


def joint_log_density(
    priors: Sequence[Prior], x: np.ndarray, scales: ArrayLike = SHARED_SIGMAS
) -> np.ndarray:
    """Return the normalised log density of parameters x, (..., d), shape (...); −∞ outside the support.

    The priors are independent except for those that share an unknown scale, one of `scales` (in scores).
    """
    shared = [i for i, p in enumerate(priors) if isinstance(p, SharedHalfNormal)]
    total = np.zeros(x.shape[:-1])
    squares = np.zeros(x.shape[:-1])
    for i, prior in enumerate(priors):
        column = x[..., i]
        inside = np.isfinite(column)
        safe = np.where(inside, column, 1.0)
        if isinstance(prior, SharedHalfNormal):
            squares = squares + prior.score(safe) ** 2
            total = total + np.where(inside & (safe >= 0), -math.log(SCORE_RATIO * prior.per_ratio), -np.inf)
        else:
            total = total + np.where(inside, prior.log_density(safe), -np.inf)
    if shared:
        total = total + shared_log_density(squares, len(shared), scales)
    return np.where(np.isnan(total), -np.inf, total)


def joint_slope(priors: Sequence[Prior], x: np.ndarray, scales: ArrayLike = SHARED_SIGMAS) -> np.ndarray:
    """Return the gradient of `joint_log_density` at x, (d,), inside the support."""
    scores = {i: float(p.score(x[i])) for i, p in enumerate(priors) if isinstance(p, SharedHalfNormal)}
    precision = shared_precision(sum(z * z for z in scores.values()), len(scores), scales) if scores else 1.0
    return np.array(
        [
            -precision * scores[i] / (SCORE_RATIO * prior.per_ratio)
            if isinstance(prior, SharedHalfNormal)
            else float(prior.slope(x[i]))
            for i, prior in enumerate(priors)
        ]
    )


class LogNormal(_Prior):
    """exp Normal(log median, sigma)."""

    prior: Literal["lognormal"] = "lognormal"
    median: PositiveFloat = Field(description="a number above 0")
    sigma: PositiveFloat = Field(description="a number above 0")

    def __init__(self, median: float, sigma: float) -> None:
        self._begin(median=median, sigma=sigma)

    @staticmethod
    def transform(z: Any, median: Scalar, sigma: Scalar) -> Any:
        """median · exp(sigma z)."""
        return median * _functions(z).exp(sigma * z)

    @staticmethod
    def derivative(z: Any, median: Scalar, sigma: Scalar) -> Any:
        """sigma times the value."""
        return sigma * median * _functions(z).exp(sigma * z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """log(x/median)/sigma."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(np.asarray(x, float) / self.median) / self.sigma

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """log N(log x; log median, sigma²) − log x at x > 0, −∞ below."""
        x = np.asarray(x, float)
        safe = np.where(x > 0, x, self.median)
        inside = -0.5 * self.score(safe) ** 2 - _HALF_LOG_2PI - math.log(self.sigma) - np.log(safe)
        return np.where(x > 0, inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """−(1 + score/sigma)/x."""
        return -(1.0 + self.score(x) / self.sigma) / np.asarray(x, float)


class _Between(_Prior):
    low: float = Field(description="a number")
    high: float = Field(description="a number")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be below high ({self.high:g})")
        return self


class Uniform(_Between):
    """Uniform between low and high."""

    prior: Literal["uniform"] = "uniform"

    def __init__(self, low: float, high: float) -> None:
        self._begin(low=low, high=high)

    @staticmethod
    def transform(z: Any, low: Scalar, high: Scalar) -> Any:
        """low + (high − low) Φ(z)."""
        return low + (high - low) * _functions(z).ndtr(z)

    @staticmethod
    def derivative(z: Any, low: Scalar, high: Scalar) -> Any:
        """(high − low) φ(z)."""
        return (high - low) * _density(z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Φ⁻¹((x − low)/(high − low))."""
        share = (np.asarray(x, float) - self.low) / (self.high - self.low)
        return host.ndtri(np.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """−log(high − low) within, −∞ outside."""
        x = np.asarray(x, float)
        return np.where((x >= self.low) & (x <= self.high), -math.log(self.high - self.low), -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """0 within."""
        return np.zeros_like(np.asarray(x, float))


class LogUniform(_Between):
    """Uniform in the logarithm between low and high."""

    prior: Literal["loguniform"] = "loguniform"
    low: PositiveFloat = Field(description="a number above 0")
    high: PositiveFloat = Field(description="a number above 0")

    def __init__(self, low: float, high: float) -> None:
        self._begin(low=low, high=high)

    @staticmethod
    def transform(z: Any, low: Scalar, high: Scalar) -> Any:
        """low · (high/low)^Φ(z)."""
        f = _functions(z)
        return low * f.exp(f.log(high / low) * f.ndtr(z))

    @staticmethod
    def derivative(z: Any, low: Scalar, high: Scalar) -> Any:
        """log(high/low) φ(z) times the value."""
        f = _functions(z)
        return f.log(high / low) * _density(z) * low * f.exp(f.log(high / low) * f.ndtr(z))

    def score(self, x: ArrayLike) -> np.ndarray:
        """Φ⁻¹(log(x/low)/log(high/low))."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.log(np.asarray(x, float) / self.low) / math.log(self.high / self.low)
        return host.ndtri(np.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """−log x − log log(high/low) within, −∞ outside."""
        x = np.asarray(x, float)
        safe = np.where(x > 0, x, self.low)
        inside = -np.log(safe) - math.log(math.log(self.high / self.low))
        return np.where((x >= self.low) & (x <= self.high), inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """−1/x within."""
        return -1.0 / np.asarray(x, float)


GivenPrior = Annotated[Normal | HalfNormal | LogNormal | Uniform | LogUniform, Field(discriminator="prior")]
"""The priors that a user may specify."""
Prior = Normal | HalfNormal | SharedHalfNormal | LogNormal | Uniform | LogUniform
"""The priors that a model may have."""


FURTHER_TERM = 0.125
"""Factor of a model's prior probability for each term beyond the first. Measured on 82 simulated records with a damping
ratio of 0.01 (three sevenths of them single terms, three sums of two, one of three): with it nearly as many are
decided, and as many correctly, as under half-normal priors with a fixed scale of 0.1."""
OTHERS = 0.1
"""Prior weight of all other forms of damping together, relative to a single term."""


def odds(damping: Sequence[str], others: int = 0) -> float:
    """Return the prior odds of a damping against a single term.

    Parameters
    ----------
    damping
        Its terms.
    others
        Number of the other forms of damping, where it is one of these; 0 for a sum that is compared.
    """
    return FURTHER_TERM ** (len(damping) - 1) * (OTHERS / others if others else 1.0)
