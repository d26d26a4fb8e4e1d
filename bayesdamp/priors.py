"""Define the prior distributions of parameters.

Each prior is defined by a transformation x(z) of a standard normal variable z. If z ~ N(0, 1), then the parameter x has
this prior; for a half-normal prior, x = scale · |z|. The value z is called the (normal) score of the parameter value x.
Samplers work with the scores, in which every independent prior is N(0, 1).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, ValidationError, model_validator

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from jax import Array

Scalar: TypeAlias = "float | Array"
_ARRAY = SimpleNamespace(exp=np.exp, log=np.log, ndtr=lambda z: scipy.special.ndtr(z))
"""The functions exp, log and Φ (`ndtr`, the standard normal distribution function) for NumPy arrays."""
_NUMBER = SimpleNamespace(
    exp=lambda z: math.exp(min(z, 709.0)), log=math.log, ndtr=lambda z: 0.5 * math.erfc(-z / math.sqrt(2.0))
)
"""The functions exp, log and Φ (`ndtr`) for a single float, several times faster than those of NumPy. exp limits its
argument to 709, so that it does not overflow."""


def _is_traced(value: object) -> bool:
    """Return whether a value is a JAX array, as in NumPyro models, without importing JAX."""
    return "jax" in sys.modules and isinstance(value, sys.modules["jax"].Array)


def _functions(z: Any) -> SimpleNamespace:
    """Return the functions exp, log and Φ (`ndtr`) for the type of z: float, NumPy array or JAX array."""
    if isinstance(z, float):
        return _NUMBER
    if not _is_traced(z):
        return _ARRAY
    from jax import numpy as jnp
    from jax.scipy.special import ndtr

    return SimpleNamespace(exp=jnp.exp, log=jnp.log, ndtr=ndtr)


@cache
def _field_names(kind: type[BaseModel]) -> tuple[str, ...]:
    """Return the names of the numbers (mean, sd, ...) that define a prior of this class.

    They are in the order of the arguments of `transform`.
    """
    return tuple(name for name, field in kind.model_fields.items() if name != "prior" and not field.exclude)


class _Prior(BaseModel):
    """Base class of priors. Each is a transformation of a standard normal score z to the parameter.

    reflected: whether the parameter depends only on |z|, as for half-normal priors; samplers then keep z ≥ 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    reflected: bool = Field(default=False, exclude=True, init=False, repr=False)

    def _begin(self, **numbers: float) -> None:
        """Validate the numbers of a prior that is created in Python, and set its fields.

        Raises InputError with a message of one line. Tables of study files are validated directly by pydantic.
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
        # With this mark, pydantic validates tables itself instead of calling our __init__.
        cls.__init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]
        super().__init_subclass__(**options)

    transform: ClassVar[Callable[..., Any]]
    """Function (z, *numbers) that returns the parameter value at the standard normal score z. numbers: those that
    define the prior, such as mean and sd. z may be a float, a NumPy array or a JAX array."""
    derivative: ClassVar[Callable[..., Any]]
    """Function (z, *numbers) that returns the derivative of the parameter value by its standard normal score z. The
    arguments are those of `transform`."""

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the numbers that define this prior, in the order of the arguments of `transform`."""
        return tuple(getattr(self, name) for name in _field_names(type(self)))

    def value(self, z: ArrayLike) -> np.ndarray:
        """Return the parameter value at the standard normal score z (any shape); z ~ N(0, 1) gives this prior."""
        return self.transform(np.asarray(z, float), *self.numbers)

    def rate(self, z: ArrayLike) -> np.ndarray:
        """Return the derivative of the parameter value by its standard normal score, at z (any shape)."""
        z = np.asarray(z, float)
        return np.broadcast_to(self.derivative(z, *self.numbers), z.shape)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score z of the parameter value x (any shape).

        It is the inverse of `value`; for half-normal priors the score z ≥ 0 is returned.
        """
        raise NotImplementedError

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the normalised log density of the prior at values x of the parameter (any shape).

        It is −∞ outside the support.
        """
        raise NotImplementedError

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return the derivative of `log_density` by the parameter, at values x inside the support (any shape)."""
        raise NotImplementedError

    def describe(self) -> str:
        """Return the prior as text for tables, such as "normal(mean 0, sd 1)"."""
        body = self.model_dump(exclude={"prior"})
        return f"{self.prior}({', '.join(f'{k} {v:.4g}' for k, v in body.items())})"  # type: ignore[attr-defined]


_HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


def _density(z: Any) -> Any:
    """Return the standard normal density at z."""
    return _functions(z).exp(-0.5 * z**2 - _HALF_LOG_2PI)


class Normal(_Prior):
    """Normal distribution with mean and standard deviation."""

    prior: Literal["normal"] = "normal"
    mean: float = Field(description="a number")
    sd: PositiveFloat = Field(description="a number above 0")

    def __init__(self, mean: float, sd: float) -> None:
        self._begin(mean=mean, sd=sd)

    @staticmethod
    def transform(z: Any, mean: Scalar, sd: Scalar) -> Any:
        """Return the parameter value mean + sd · z at the standard normal score z."""
        return mean + sd * z

    @staticmethod
    def derivative(z: Any, mean: Scalar, sd: Scalar) -> Any:
        """Return sd, the derivative of the parameter by its standard normal score; `z` and `mean` have no effect."""
        return sd

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score (x − mean)/sd of the parameter value x."""
        return np.asarray((np.asarray(x, float) - self.mean) / self.sd)

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the log density of the prior, log N(x; mean, sd²), at the parameter value x."""
        return -0.5 * self.score(x) ** 2 - _HALF_LOG_2PI - math.log(self.sd)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return −(x − mean)/sd², the derivative of the log density by the parameter x."""
        return -self.score(x) / self.sd


class _Reflected(_Prior):
    """Base class of half-normal priors, x = scale · |z| with a standard normal score z.

    The only number of such a prior is its scale, the parameter value at z = 1.
    """

    reflected: bool = Field(default=True, exclude=True, init=False, repr=False)

    @staticmethod
    def transform(z: Any, scale: Scalar) -> Any:
        """Return the parameter value scale · |z| at the standard normal score z."""
        return scale * abs(z)

    @staticmethod
    def derivative(z: Any, scale: Scalar) -> Any:
        """Return scale · sign z, the derivative of the parameter by its standard normal score z."""
        return scale * np.sign(z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score |x|/scale of the parameter value x."""
        return np.asarray(np.abs(x) / self.numbers[0])


class HalfNormal(_Reflected):
    """Half-normal distribution: the parameter is |N(0, scale²)|.

    It is scale · |z| with a standard normal score z; scores of both signs are valid and give the same parameter.
    """

    prior: Literal["halfnormal"] = "halfnormal"
    scale: PositiveFloat = Field(description="a number above 0")

    def __init__(self, scale: float) -> None:
        self._begin(scale=scale)

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the log density of the prior at the parameter value x: log(2 N(x; 0, scale²)) for x ≥ 0, else −∞."""
        x = np.asarray(x, float)
        inside = -0.5 * (x / self.scale) ** 2 - _HALF_LOG_2PI - math.log(self.scale) + math.log(2)
        return np.where(x >= 0, inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return −x/scale², the derivative of the log density by the parameter x."""
        return -np.asarray(x, float) / self.scale**2


class SharedHalfNormal(_Reflected):
    """Half-normal prior of a damping coefficient, with an unknown scale that all damping terms of a model share.

    It is the default prior of all damping coefficients; a user cannot specify it. It applies to the equivalent damping
    ratio of the coefficient. Its scale is one of `SHARED_SCALES`, all equally probable, so that the evidence does not
    depend on how small the damping is. Because of the common scale, the joint prior density of the terms is not a
    product; it is given by `shared_log_density`. The method `slope` is not defined (see `joint_slope`).

    Parameters
    ----------
    per_ratio
        Coefficient that gives an equivalent damping ratio of 1, in the unit of the coefficient.
    """

    prior: Literal["shared_halfnormal"] = "shared_halfnormal"
    per_ratio: PositiveFloat

    def __init__(self, per_ratio: float) -> None:
        self._begin(per_ratio=per_ratio)

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the only number of this prior: the coefficient that gives the damping ratio `SCORE_RATIO`."""
        return (SCORE_RATIO * self.per_ratio,)

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the marginal log density of one coefficient x, averaged over the possible values of the shared scale.

        It is −∞ for x < 0.
        """
        x = np.asarray(x, float)
        inside = shared_log_density(self.score(x) ** 2, 1) - math.log(self.numbers[0])
        return np.where(x >= 0, inside, -np.inf)

    def describe(self) -> str:
        """Return the prior in words, for tables; it is the same text for every coefficient."""
        return (
            f"half-normal on the damping ratio, its scale shared by the terms and unknown between "
            f"{LEAST_SCALE:g} and {MOST_SCALE:g}"
        )


SCORE_RATIO = 0.1
"""Equivalent damping ratio of a coefficient with a `SharedHalfNormal` prior whose standard normal score is 1. It is
only the unit of these scores; no result depends on it (conventional)."""
LEAST_SCALE, MOST_SCALE = 1e-8, 0.3
"""Smallest and largest value of the unknown scale of `SharedHalfNormal` priors, which is a damping ratio (Q from 5e7 to
1.7). The prior of the scale is uniform in its logarithm between these (conventional)."""
SHARED_SCALES = LEAST_SCALE * (MOST_SCALE / LEAST_SCALE) ** ((np.arange(25) + 0.5) / 25)
"""Possible values of the unknown scale of `SharedHalfNormal` priors, all equally probable: the middles of 25 intervals
in the logarithm, each about twice the one before. We sum over them; the sum differs from the integral by at most 0.02
nats for three terms and far less for fewer (the error of the midpoint rule is bounded by the Fourier transform of the
integrand, a gamma function)."""
SHARED_SIGMAS = SHARED_SCALES / SCORE_RATIO
"""The values of `SHARED_SCALES` as standard deviations σ of the coefficients' scores: divided by `SCORE_RATIO`."""


def shared_log_density(squares: Any, count: Any, scales: Any = SHARED_SIGMAS) -> Any:
    """Return the joint log prior density of the scores z ≥ 0 of `count` coefficients with a common, unknown scale.

    Given the scale σ, each score is half-normal, |N(0, σ²)|; the density is averaged over the values of σ in `scales`.

    Parameters
    ----------
    squares
        Sum of the squared scores, any shape; may be a JAX array.
    count
        Number of coefficients.
    scales
        Possible values of σ, all equally probable, (s,).

    Returns
    -------
    ndarray or JAX array
        The log density in nats, in the shape of `squares`.
    """
    return _over_scales(squares, count, scales)[0]


def shared_precision(squares: Any, count: Any, scales: Any = SHARED_SIGMAS) -> Any:
    """Return the posterior mean of 1/σ² for the common, unknown scale σ of coefficients, given their scores z.

    Given σ, each score is half-normal, |N(0, σ²)|. The derivative of `shared_log_density` by a score is minus the score
    times this mean. squares: sum of the squared scores, any shape, also that of the result. count: number of
    coefficients. scales: possible values of σ, all equally probable, (s,).
    """
    return _over_scales(squares, count, scales)[1]


def _over_scales(squares: Any, count: Any, scales: Any) -> tuple[Any, Any]:
    """Return the joint log prior density of scores with a common, unknown scale σ, and the posterior mean of 1/σ².

    The scores are those of a model's damping coefficients; given σ, each is half-normal, |N(0, σ²)|. These are the
    results of `shared_log_density` and `shared_precision`. squares: sum of the squared scores, any shape, also that of
    both results. count: number of scores. scales: possible values of σ, all equally probable, (s,).
    """
    np_: Any = sys.modules["jax"].numpy if _is_traced(squares) else np
    scales = np_.asarray(scales)
    each = -0.5 * np_.asarray(squares)[..., None] / scales**2 - count * np_.log(scales)
    top = each.max(axis=-1, keepdims=True)
    weight = np_.exp(each - top)
    total = weight.sum(axis=-1)
    constant = count * (math.log(2.0) - _HALF_LOG_2PI) - math.log(scales.size)
    return np_.log(total) + top[..., 0] + constant, (weight / scales**2).sum(axis=-1) / total


def log_prior_of(z: np.ndarray, shared: np.ndarray, scales: ArrayLike = SHARED_SIGMAS) -> np.ndarray:
    """Return the log prior density, shape (...), of standard normal scores z, (..., d).

    Scores may be negative: a half-normal prior counts here as a normal one over both signs. If scores are restricted to
    values ≥ 0, the density is larger by a factor of 2 for each of them. shared: mask (d,) of the scores with a common,
    unknown scale, one of `scales`; the others are N(0, 1).
    """
    plain = z[..., ~shared]
    value = -0.5 * np.sum(plain**2, axis=-1) - plain.shape[-1] * _HALF_LOG_2PI
    if shared.any():
        count = int(shared.sum())
        value = value + shared_log_density(np.sum(z[..., shared] ** 2, axis=-1), count, scales)
        value = value - count * math.log(2.0)
    return value


def joint_log_density(
    priors: Sequence[Prior], x: np.ndarray, scales: ArrayLike = SHARED_SIGMAS
) -> np.ndarray:
    """Return the joint log prior density, shape (...), of parameters x, (..., d), in nats.

    It is −∞ outside the support, and where a parameter is nan or infinite. The priors are independent, except for
    coefficients with `SharedHalfNormal` priors, which share an unknown scale. scales: possible values of this scale, as
    standard deviations of the coefficients' standard normal scores, all equally probable, (s,).
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
            total = total + np.where(inside & (safe >= 0), -math.log(prior.numbers[0]), -np.inf)
        else:
            total = total + np.where(inside, prior.log_density(safe), -np.inf)
    if shared:
        total = total + shared_log_density(squares, len(shared), scales)
    return np.where(np.isnan(total), -np.inf, total)


def joint_slope(priors: Sequence[Prior], x: np.ndarray, scales: ArrayLike = SHARED_SIGMAS) -> np.ndarray:
    """Return the gradient, (d,), of `joint_log_density` by the parameters at one point x, (d,), inside the support.

    scales: possible values of the common, unknown scale of coefficients with `SharedHalfNormal` priors, as standard
    deviations of their standard normal scores.
    """
    scores = {i: float(p.score(x[i])) for i, p in enumerate(priors) if isinstance(p, SharedHalfNormal)}
    precision = shared_precision(sum(z * z for z in scores.values()), len(scores), scales) if scores else 1.0
    slopes = [
        -precision * scores[i] / prior.numbers[0] if i in scores else float(prior.slope(x[i]))
        for i, prior in enumerate(priors)
    ]
    return np.array(slopes)


class LogNormal(_Prior):
    """Lognormal distribution: log x is normal with the mean log(median) and the standard deviation sigma."""

    prior: Literal["lognormal"] = "lognormal"
    median: PositiveFloat = Field(description="a number above 0")
    sigma: PositiveFloat = Field(description="a number above 0")

    def __init__(self, median: float, sigma: float) -> None:
        self._begin(median=median, sigma=sigma)

    @staticmethod
    def transform(z: Any, median: Scalar, sigma: Scalar) -> Any:
        """Return the parameter value median · exp(sigma z) at the standard normal score z."""
        return median * _functions(z).exp(sigma * z)

    @staticmethod
    def derivative(z: Any, median: Scalar, sigma: Scalar) -> Any:
        """Return sigma · median · exp(sigma z), the derivative of the parameter by its standard normal score z."""
        return sigma * median * _functions(z).exp(sigma * z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score log(x/median)/sigma of the parameter value x; −∞ at 0, nan below."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(np.asarray(x, float) / self.median) / self.sigma

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the log density of the prior at x: log N(log x; log median, sigma²) − log x for x > 0, else −∞."""
        x = np.asarray(x, float)
        safe = np.where(x > 0, x, self.median)
        inside = -0.5 * self.score(safe) ** 2 - _HALF_LOG_2PI - math.log(self.sigma) - np.log(safe)
        return np.where(x > 0, inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return −(1 + z/sigma)/x, the derivative of the log density by the parameter x.

        z is the standard normal score of x.
        """
        return -(1.0 + self.score(x) / self.sigma) / np.asarray(x, float)


class _Between(_Prior):
    """Base class of the priors of a parameter between the bounds low and high."""

    low: float = Field(description="a number")
    high: float = Field(description="a number")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        """Raise ValueError unless low is below high."""
        if not self.low < self.high:
            raise ValueError(f"low ({self.low:g}) must be below high ({self.high:g})")
        return self


class Uniform(_Between):
    """Uniform distribution between low and high."""

    prior: Literal["uniform"] = "uniform"

    def __init__(self, low: float, high: float) -> None:
        self._begin(low=low, high=high)

    @staticmethod
    def transform(z: Any, low: Scalar, high: Scalar) -> Any:
        """Return the parameter value low + (high − low) Φ(z) at the standard normal score z.

        Φ is the standard normal distribution function.
        """
        return low + (high - low) * _functions(z).ndtr(z)

    @staticmethod
    def derivative(z: Any, low: Scalar, high: Scalar) -> Any:
        """Return (high − low) φ(z), the derivative of the parameter by its standard normal score z.

        φ is the standard normal density.
        """
        return (high - low) * _density(z)

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score Φ⁻¹((x − low)/(high − low)) of the parameter value x.

        Φ⁻¹ is the inverse of the standard normal distribution function. Its argument is clipped, so that the score is
        finite also at the bounds and outside them.
        """
        share = (np.asarray(x, float) - self.low) / (self.high - self.low)
        return scipy.special.ndtri(np.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the log density of the prior at the parameter value x: −log(high − low) inside the bounds, else −∞."""
        x = np.asarray(x, float)
        return np.where((x >= self.low) & (x <= self.high), -math.log(self.high - self.low), -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return 0, the derivative of the log density by the parameter x, in the shape of x."""
        return np.zeros_like(np.asarray(x, float))


class LogUniform(_Between):
    """Log-uniform distribution: log x is uniform between log(low) and log(high)."""

    prior: Literal["loguniform"] = "loguniform"
    low: PositiveFloat = Field(description="a number above 0")
    high: PositiveFloat = Field(description="a number above 0")

    def __init__(self, low: float, high: float) -> None:
        self._begin(low=low, high=high)

    @staticmethod
    def transform(z: Any, low: Scalar, high: Scalar) -> Any:
        """Return the parameter value low · (high/low)^Φ(z) at the standard normal score z.

        Φ is the standard normal distribution function.
        """
        f = _functions(z)
        return low * f.exp(f.log(high / low) * f.ndtr(z))

    @staticmethod
    def derivative(z: Any, low: Scalar, high: Scalar) -> Any:
        """Return log(high/low) φ(z) x(z), the derivative of the parameter x(z) by its standard normal score z.

        φ is the standard normal density.
        """
        f = _functions(z)
        return f.log(high / low) * _density(z) * low * f.exp(f.log(high / low) * f.ndtr(z))

    def score(self, x: ArrayLike) -> np.ndarray:
        """Return the standard normal score Φ⁻¹(log(x/low)/log(high/low)) of the parameter value x.

        Φ⁻¹ is the inverse of the standard normal distribution function. Its argument is clipped, so that the score is
        finite also at the bounds and outside them; it is nan at x < 0.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.log(np.asarray(x, float) / self.low) / math.log(self.high / self.low)
        return scipy.special.ndtri(np.clip(share, 1e-300, 1 - 1e-16))

    def log_density(self, x: ArrayLike) -> np.ndarray:
        """Return the log density of the prior at x: −log x − log log(high/low) between the bounds, else −∞."""
        x = np.asarray(x, float)
        safe = np.where(x > 0, x, self.low)
        inside = -np.log(safe) - math.log(math.log(self.high / self.low))
        return np.where((x >= self.low) & (x <= self.high), inside, -np.inf)

    def slope(self, x: ArrayLike) -> np.ndarray:
        """Return −1/x, the derivative of the log density by the parameter x."""
        return -1.0 / np.asarray(x, float)


GivenPrior = Annotated[Normal | HalfNormal | LogNormal | Uniform | LogUniform, Field(discriminator="prior")]
"""Priors that a user may specify."""
Prior = Normal | HalfNormal | SharedHalfNormal | LogNormal | Uniform | LogUniform
"""All priors that a model may have."""


FURTHER_TERM = 0.125
"""Factor by which each damping term beyond the first reduces the prior probability of a damping model. Measured on 82
simulated records with a damping ratio of 0.01 (3/7 of them with one term, 3/7 with two, 1/7 with three): compared with
half-normal priors of the fixed scale 0.1, the answer states one damping without reservation on nearly as many records,
and it is right on as many of them."""
OTHER_FORMS_ODDS, OTHER_FORMS_COUNT = 0.1, 9
"""A rival is a sum of damping terms with a form of damping that is not among the compared ones. `OTHER_FORMS_ODDS`:
prior odds of all rivals together, relative to a model with a single term (conventional). `OTHER_FORMS_COUNT`: number of
rivals in a full comparison of oscillations (`add_rivals`). Each rival has the same share of these odds, however many
are compared."""


def odds(damping: Sequence[str], other: bool = False, count: int = OTHER_FORMS_COUNT) -> float:
    """Return the prior odds of a damping model relative to a compared model with a single term.

    Parameters
    ----------
    damping
        Names of the damping terms of the model.
    other
        Whether the model is a rival: a sum of damping terms with a form of damping that is not among the compared ones.
    count
        Number of rivals that share the odds of other forms.
    """
    return FURTHER_TERM ** (len(damping) - 1) * (OTHER_FORMS_ODDS / count if other else 1.0)
