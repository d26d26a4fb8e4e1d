"""What is asked of a model or of a comparison, checked before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp.inference.deviation.sample_noise import GAUSSIAN
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import TERMS, all_sums, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.priors import GivenPrior, Normal, Prior, Uniform
from bayesdamp.types import InputError

_TEXT = "is text; give numbers, such as numpy.asarray(values, float) makes of it"
_DATES = "holds dates or spans of time; give seconds: (t - t[0]) / numpy.timedelta64(1, 's')"
_NO_NUMBERS = {
    "b": "holds true and false, which measure nothing; give the recorded numbers",
    "c": "holds complex numbers; give their real part, or another real quantity",
    "M": _DATES,
    "m": _DATES,
    "S": _TEXT,
    "U": _TEXT,
}
"""What is said of an array by its kind of elements, where NumPy would make numbers of them."""


def numbers_of(given: ArrayLike, what: str, where: str) -> NDArray[np.float64]:
    """An array of its own with the numbers that are given. what: its name; where: that of the signal.

    Raises InputError for elements that are no real numbers, and for masked ones.
    """
    try:
        found = np.asanyarray(given)
        kinds = {np.asarray(one).dtype.kind for one in found.flat} if found.dtype.kind == "O" else ()
        refused = next(
            (_NO_NUMBERS[kind] for kind in (found.dtype.kind, *kinds) if kind in _NO_NUMBERS), None
        )
        numbers = np.array(found, float) if refused is None else np.empty(0)
    except (TypeError, ValueError):
        refused, found, numbers = "must be an array of numbers", np.empty(0), np.empty(0)
    if refused is not None:
        raise InputError(f"{what} {refused}", where)
    masked = np.ma.getmaskarray(found) if isinstance(found, np.ma.MaskedArray) else np.zeros(0, bool)
    if masked.any():
        raise InputError(
            f"{what} has {np.count_nonzero(masked)} masked values; leave these samples out of t and y", where
        )
    return numbers


KINDS = get_args(get_args(GivenPrior)[0])
"""The classes of priors."""
POSITIVE = ("noise_sd", "noise_time", "noise_dof")
"""Parameters that are above zero; friction's epsilon may be zero, the sign itself."""
EPSILON = "epsilon"
LARGEST_SENSOR = 0.5


def coefficients_of(terms: Sequence[str]) -> dict[str, str]:
    """Coefficient to term."""
    return {TERMS.get(t).parameter: t for t in terms}


def by_parameter(priors: Mapping[str, Prior], coefficients: Mapping[str, str]) -> dict[str, Prior]:
    """Priors by damping term or parameter, by parameter alone. coefficients: to their terms."""
    own = {term: name for name, term in coefficients.items()}
    return {own.get(name, name): prior for name, prior in priors.items()}


def checked_known(
    who: str, known: object, coefficients: Mapping[str, str], parameters: Sequence[str]
) -> dict[str, float]:
    """Values of parameters, as numbers. who: what is called; coefficients: to their terms. Raises InputError for a name
    that is none of the parameters, for a damping, and for what is no value of that parameter."""
    valid = [n for n in parameters if n not in coefficients]
    valid += [EPSILON] * (EPSILON not in valid)  # one dictionary for models with and without friction
    given = _mapping(who, "known", known)
    for name in given:
        if name in coefficients or name in coefficients.values():
            raise InputError(f"{who}: known {name!r} is a damping, which is always inferred; give it a prior")
        if name not in valid:
            raise InputError(f"{who}: known has unknown parameter {name!r}{nearest(name, valid)}")
    found = {name: number(value) for name, value in given.items()}
    for name, value in found.items():
        low = name in POSITIVE and not value > 0
        if not math.isfinite(value) or low or (name == EPSILON and value < 0):
            right = "a positive number" if name in POSITIVE else "a finite number"
            right += ", 0 or more" * (name == EPSILON)
            raise InputError(f"{who}: known {name!r} is {given[name]!r}; it must be {right}")
    return found


def checked_priors(
    who: str,
    priors: object,
    known: Mapping[str, float],
    coefficients: Mapping[str, str],
    parameters: Sequence[str],
) -> dict[str, Prior]:
    """Priors, by damping term or parameter as they are given. Raises InputError for a name that is none of these, for
    what is no prior, and for one that the parameter cannot have."""
    terms = tuple(coefficients.values())
    valid = [*terms, *parameters]
    given = _mapping(who, "priors", priors)
    seen: dict[str, str] = {}
    for name, prior in given.items():
        if name not in valid:
            raise InputError(f"{who}: priors has unknown term or parameter {name!r}{nearest(name, valid)}")
        if not isinstance(prior, KINDS):
            kinds = ", ".join(kind.__name__ for kind in KINDS)
            raise InputError(f"{who}: the prior of {name!r} is {prior!r}; it must be one of {kinds}")
        if name in known:
            raise InputError(f"{who}: {name!r} is known and has a prior; give one of the two")
        term = coefficients.get(name, name)
        if term in seen:
            raise InputError(f"{who}: {seen[term]!r} and {name!r} are one parameter; give one prior")
        seen[term] = name
        negative = isinstance(prior, Normal) or (isinstance(prior, Uniform) and prior.low < 0)
        if negative and (term in terms or name in (*POSITIVE, EPSILON)):
            right = "a HalfNormal, LogNormal, LogUniform, or a Uniform from 0 up"
            raise InputError(f"{who}: the prior of {name!r} allows values below zero; it must be {right}")
    return dict(given)


def checked_sensor(who: str, sensor: object) -> None:
    """Raises InputError for what is no relative linearity of a sensor."""
    if not 0 <= number(sensor) < LARGEST_SENSOR:
        raise InputError(
            f"{who}: sensor is {sensor!r}; it must be a number from 0 to below {LARGEST_SENSOR:g}"
        )


def sums_and_laws(
    damping: str | Sequence[str], restoring: str | Sequence[str]
) -> tuple[list[str], list[str]]:
    """Damping sums and restoring laws, one given as itself or several in a list. Raises InputError for a name that is
    none."""
    sums, laws = _names("damping", damping), _names("restoring", restoring)
    for one in sums:
        parse_model(one)
    for law in laws:
        LAWS.get(law)
    return sums, laws


def checked_noise(who: str, asked: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of noise models. Raises InputError where there is none, or one is unknown."""
    names = (asked,) if isinstance(asked, str) else tuple(asked)
    if not names:
        raise InputError(f'{who}: noise names no noise model; give one, several or "auto"')
    for name in names:
        if name not in NOISES.names() and names != ("auto",):
            raise InputError(f"{who}: unknown noise model {name!r}{nearest(name, [*NOISES.names(), 'auto'])}")
    return names


def _names(what: str, given: str | Iterable[str]) -> list[str]:
    names = [given] if isinstance(given, str) else list(given) if isinstance(given, Iterable) else []
    if not isinstance(given, Iterable) or not all(isinstance(one, str) for one in names):
        raise InputError(f"compare: {what} is {given!r}; it must be a name, or a list of names")
    return names


def known_and_priors(
    sums: Sequence[str],
    laws: Sequence[str],
    known: Mapping[str, float] | None,
    priors: Mapping[str, Prior] | None,
    noises: Sequence[str] = (GAUSSIAN,),
) -> tuple[dict[str, float], dict[str, Prior]]:
    """Of a comparison of sums under laws, empty for all: known values, and priors by parameter. Raises InputError for
    what none of these models has. noises: the noise models in play."""
    coefficients = coefficients_of(
        tuple(dict.fromkeys(t for s in sums or all_sums() for t in parse_model(s)))
    )
    terms = tuple(coefficients.values())
    parameters = tuple(
        dict.fromkeys(p for law in laws or LAWS.names() for p in Oscillator(terms, law).parameters)
    )
    parameters += tuple(dict.fromkeys(p for name in noises for p in NOISES.get(name).parameters))
    values = checked_known("compare", known or {}, coefficients, parameters)
    given = checked_priors("compare", priors or {}, values, coefficients, parameters)
    return values, by_parameter(given, coefficients)


def number(value: object) -> float:
    """A number as a float; nan for what is none."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _mapping(who: str, what: str, given: object) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise InputError(f"{who}: {what} is {type(given).__name__}; it must be a dictionary by parameter")
    return given
