"""Check the arguments of models, comparisons and signals before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdamp.config.study import DEVIATIONS
from bayesdamp.inference.noise import GAUSSIAN, NOISES
from bayesdamp.physics.damping import TERMS, all_sums, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.priors import GivenPrior, Normal, Prior, Uniform
from bayesdamp.types import InputError

_NOT_NUMBERS = {
    "b": "true and false",
    "c": "complex numbers",
    "M": "dates",
    "m": "durations",
    "S": "text",
    "U": "text",
}
"""Contents that NumPy would silently convert to numbers, by NumPy's code for the type of the elements."""
KINDS = get_args(get_args(GivenPrior)[0])
"""The classes of priors that a user may specify."""
POSITIVE = ("noise_sd", "noise_time", "noise_dof")
"""Parameters that must be positive."""
EPSILON = "epsilon"
"""Name of the parameter ε, the velocity within which Coulomb friction tanh(velocity/ε) changes its sign. A known value
may be 0, which means the sign function."""
LARGEST_SENSOR = 0.5
"""Upper limit of a sensor's relative linearity error (conventional)."""


def numbers_of(given: ArrayLike, what: str, where: str) -> NDArray[np.float64]:
    """Convert an argument to a new array of floats.

    Parameters
    ----------
    given
        Real numbers of any shape.
    what
        Name of the argument, for errors.
    where
        Name of the signal or of the function, for errors.

    Raises
    ------
    InputError
        If elements are masked or are not real numbers; nan and infinite values are allowed.
    """
    try:
        array = np.asanyarray(given)
        kinds = (
            {np.asarray(element).dtype.kind for element in array.flat} if array.dtype.kind == "O" else set()
        )
        for kind in (kind for kind in _NOT_NUMBERS if kind in {array.dtype.kind, *kinds}):
            right = "give real numbers, and times in s: (t - t[0]) / numpy.timedelta64(1, 's')"
            raise InputError(f"{what} contains {_NOT_NUMBERS[kind]}; {right}", where)
        numbers = np.array(array, float)
    except (TypeError, ValueError):
        raise InputError(f"{what} must be an array of numbers", where) from None
    if masked := np.count_nonzero(np.ma.getmaskarray(array)):
        raise InputError(f"{what} has {masked} masked values; remove these samples from t and y", where)
    return numbers


def coefficients_of(terms: Sequence[str], law: Sequence[str] = ()) -> dict[str, str]:
    """Return the name by which a user specifies the prior of each damping coefficient, by the coefficient's name.

    `terms` lists the damping terms. This is the name of the damping term, such as "viscous" for "zeta". If a parameter
    of the restoring law has the same name (`law` lists these parameters), it is the name of the coefficient itself,
    such as "mu_3" for cubic damping.
    """
    names = {t: TERMS.get(t).parameter for t in terms}
    return {n: n if t in law else t for t, n in names.items()}


def by_parameter(priors: Mapping[str, Prior], coefficients: Mapping[str, str]) -> dict[str, Prior]:
    """Return priors by name of the parameter, given priors by name of a damping term or of a parameter.

    `coefficients` maps each damping coefficient to its term, as `coefficients_of` returns it.
    """
    own = {term: name for name, term in coefficients.items()}
    return {own.get(name, name): prior for name, prior in priors.items()}


def check_known(
    who: str, known: object, coefficients: Mapping[str, str], parameters: Sequence[str]
) -> dict[str, float]:
    """Check the argument `known`, and return its values as floats, by name. epsilon (`EPSILON`) is always allowed.

    Parameters
    ----------
    who
        Name of the function or class, for errors.
    known
        The argument: values by name, in base units (rad, m or the sensor's unit, and s).
    coefficients
        The term of each damping coefficient, as `coefficients_of` returns it.
    parameters
        Names of all parameters.

    Raises
    ------
    InputError
        If a name is not a parameter or is a damping coefficient, or if the parameter cannot have the value.
    """
    valid = [n for n in parameters if n not in coefficients]
    valid += [EPSILON] * (
        EPSILON not in valid
    )  # allowed without friction, so that one dictionary fits all models
    given = _mapping(who, "known", known)
    values = {}
    for name, value in given.items():
        if name in coefficients or name in coefficients.values():
            raise InputError(
                f"{who}: known {name!r} is a damping coefficient, which is always inferred; give it a prior instead"
            )
        if name not in valid:
            raise InputError(f"{who}: known has unknown parameter {name!r}{nearest(name, valid)}")
        values[name] = number(value)
    for name, value in values.items():
        low = name in POSITIVE and not value > 0
        if not math.isfinite(value) or low or (name == EPSILON and value < 0):
            right = "a positive number" if name in POSITIVE else "a finite number"
            right += ", 0 or more" * (name == EPSILON)
            raise InputError(f"{who}: known {name!r} is {given[name]!r}; it must be {right}")
    return values


def check_priors(
    who: str,
    priors: object,
    known: Mapping[str, float],
    coefficients: Mapping[str, str],
    parameters: Sequence[str],
) -> dict[str, Prior]:
    """Check the argument `priors`, and return it as a dictionary by damping term or parameter.

    Parameters
    ----------
    who
        Name of the function or class, for errors.
    priors
        The argument: priors by term or parameter.
    known
        Values of the parameters that are known, by name.
    coefficients
        The term of each damping coefficient, as `coefficients_of` returns it.
    parameters
        Names of all parameters.

    Raises
    ------
    InputError
        If a name is neither a term nor a parameter, if a value is not a prior, if the prior allows values that the
        parameter cannot have, or if a parameter is known or has two priors.
    """
    terms = tuple(coefficients.values())
    valid = [*terms, *parameters]
    given = _mapping(who, "priors", priors)
    names: dict[str, str] = {}
    for name, prior in given.items():
        if name not in valid:
            raise InputError(f"{who}: priors has unknown term or parameter {name!r}{nearest(name, valid)}")
        if not isinstance(prior, KINDS):
            kinds = ", ".join(kind.__name__ for kind in KINDS)
            raise InputError(f"{who}: the prior of {name!r} is {prior!r}; it must be one of {kinds}")
        if name in known:
            raise InputError(f"{who}: {name!r} is known and has a prior; give one of the two")
        term = coefficients.get(name, name)
        if term in names:
            raise InputError(f"{who}: {names[term]!r} and {name!r} are the same parameter; give one prior")
        names[term] = name
        negative = isinstance(prior, Normal) or (isinstance(prior, Uniform) and prior.low < 0)
        if negative and (term in terms or name in (*POSITIVE, EPSILON)):
            right = "a HalfNormal, LogNormal, LogUniform, or a Uniform from 0 up"
            raise InputError(f"{who}: the prior of {name!r} allows values below zero; it must be {right}")
    return dict(given)


def check_deviation(who: str, deviation: object) -> None:
    """Raise InputError unless an argument `deviation` of the function `who` is one of `DEVIATIONS`."""
    if deviation not in DEVIATIONS:
        raise InputError(f"{who}: unknown deviation {deviation!r}{nearest(deviation, list(DEVIATIONS))}")


def check_sensor(who: str, sensor: object) -> None:
    """Raise InputError unless the relative linearity error of a sensor is a number from 0 to below `LARGEST_SENSOR`."""
    if not 0 <= number(sensor) < LARGEST_SENSOR:
        raise InputError(
            f"{who}: sensor is {sensor!r}; it must be a number from 0 to below {LARGEST_SENSOR:g}"
        )


def check_noise(who: str, noise: str | Sequence[str]) -> tuple[str, ...]:
    """Return the argument `noise` as a tuple of names; "auto", which must be alone, becomes ("auto",).

    Raises InputError if it is empty or contains an unknown name.
    """
    names = (noise,) if isinstance(noise, str) else tuple(noise)
    if not names:
        raise InputError(f'{who}: noise is empty; give one noise model, several, or "auto"')
    for name in names:
        if name not in NOISES.names() and names != ("auto",):
            raise InputError(f"{who}: unknown noise model {name!r}{nearest(name, [*NOISES.names(), 'auto'])}")
    return names


def sums_and_laws(
    damping: str | Sequence[str], restoring: str | Sequence[str]
) -> tuple[list[str], list[str]]:
    """Return damping sums and restoring laws, each one name or several, as lists.

    An empty argument gives an empty list, which stands for all. Raises InputError for an unknown name, and for anything
    that is not text.
    """
    sums, laws = _names("damping", damping), _names("restoring", restoring)
    for name in sums:
        parse_model(name, "compare")
    for law in laws:
        LAWS.get(law, "compare")
    return sums, laws


def _names(what: str, given: str | Iterable[str]) -> list[str]:
    """Return a name or several names as a list. Raises InputError if an element is not text."""
    names = [given] if isinstance(given, str) else list(given) if isinstance(given, Iterable) else [None]
    if not all(isinstance(name, str) for name in names):
        raise InputError(f"compare: {what} is {given!r}; it must be a name, or a list of names")
    return names  # type: ignore[return-value]


def known_and_priors(
    sums: Sequence[str],
    laws: Sequence[str],
    known: Mapping[str, float] | None,
    priors: Mapping[str, Prior] | None,
    noises: Sequence[str] = (GAUSSIAN,),
) -> tuple[dict[str, float], dict[str, Prior]]:
    """Check the known values and the priors of a comparison, and return both by name of the parameter.

    Parameters
    ----------
    sums, laws
        Damping sums and restoring laws that are compared; empty for all.
    known, priors
        The arguments of `compare`.
    noises
        Noise models that may be chosen.

    Raises
    ------
    InputError
        If none of these models has a parameter with a given name, or if a value is invalid.
    """
    coefficients = coefficients_of(
        tuple(dict.fromkeys(t for s in sums or all_sums() for t in parse_model(s)))
    )
    terms = tuple(coefficients.values())
    oscillators = [Oscillator(terms, law) for law in laws or LAWS.names()]
    parameters = tuple(dict.fromkeys(p for oscillator in oscillators for p in oscillator.parameters))
    parameters += tuple(dict.fromkeys(p for name in noises for p in NOISES.get(name).parameters))
    values = check_known("compare", known or {}, coefficients, parameters)
    given = check_priors("compare", priors or {}, values, coefficients, parameters)
    return values, by_parameter(given, coefficients)


def number(value: object) -> float:
    """Convert an int or a float to a float; return NaN for anything else, also for True and False."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _mapping(who: str, what: str, given: object) -> Mapping[str, Any]:
    """Return an argument that must be a dictionary. Raises InputError if it is something else."""
    if not isinstance(given, Mapping):
        raise InputError(
            f"{who}: {what} is {type(given).__name__}; it must be a dictionary by parameter name"
        )
    return given
