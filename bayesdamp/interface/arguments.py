"""Check the arguments of models, comparisons and signals before anything is computed."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bayesdamp.config.checks import (
    PRIORS,
    StudyError,
    check_keys,
    check_number,
    check_plugins,
    check_support,
    read_section,
)
from bayesdamp.config.signals import NOISE
from bayesdamp.config.study import PosteriorTable
from bayesdamp.formatting import show
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import Prior

EPSILON = "epsilon"
"""Name of the parameter ε, the velocity within which Coulomb friction tanh(velocity/ε) changes its sign. A known value
may be 0, which means the sign function."""


def names_of_parameters(terms: Sequence[str], parameters: Sequence[str]) -> dict[str, str]:
    """Return a dictionary from each name under which a prior may be given to the name of its parameter.

    Each of the `parameters` has its own name. For the coefficient of a damping term in `terms`, the name of the term is
    valid too, such as "viscous" for "zeta", unless a parameter of the restoring law has this name.
    """
    return {t: TERMS.get(t).parameter for t in terms} | {p: p for p in parameters}


def known_and_priors(
    who: str, known: object, priors: object, terms: Sequence[str], parameters: Sequence[str]
) -> tuple[dict[str, float], dict[str, Prior]]:
    """Check the arguments `known` and `priors`, and return both as dictionaries by name of the parameter.

    Parameters
    ----------
    who
        Name of the function or class, for errors.
    known
        Values by name, in base units (rad, m or the sensor's unit, and s). The parameter `EPSILON` of Coulomb friction
        is allowed for models without friction too, so that one dictionary can be used for all models.
    priors
        Priors by damping term or parameter.
    terms, parameters
        Damping terms, and names of all parameters.

    Raises
    ------
    InputError
        If an argument is not a dictionary, if a name is unknown, if the parameter cannot have the value or the prior,
        or if it is given twice. Damping coefficients cannot be known.
    """
    names, coefficients = names_of_parameters(terms, parameters), {TERMS.get(t).parameter for t in terms}
    values: dict[str, float] = {}
    given: dict[str, Any] = {}
    for name, value in _mapping(known, f"{who}.known").items():
        key = f"{who}.known.{name}"
        if names.get(name) in coefficients:
            right = "is always inferred; give it a prior instead"
            raise StudyError(key, f"is a damping coefficient, which {right}")
        check_keys([name], [n for n in (*parameters, EPSILON) if n not in coefficients], f"{who}.known")
        least = 0.0 if name == EPSILON else None
        values[name] = check_number(value, key, positive=name in NOISE, minimum=least)
    for name, prior in _mapping(priors, f"{who}.priors").items():
        key = f"{who}.priors.{name}"
        check_keys([name], names, f"{who}.priors")
        parameter = names[name]
        if not isinstance(prior, tuple(PRIORS.values())):
            right = f"it must be one of {', '.join(kind.__name__ for kind in PRIORS.values())}"
            raise StudyError(key, f"is {show(prior)}; {right}")
        if parameter in values:
            raise StudyError(key, f"{parameter} is also in known; give its value or its prior, not both")
        if parameter in given:
            raise StudyError(key, f"is a second prior of {parameter}; give only one")
        check_support(prior, key, negative=parameter not in (*coefficients, *NOISE, EPSILON))
        given[parameter] = prior
    return values, given


def check_settings(
    who: str, noise: str | Iterable[str], deviation: object, sensor: object
) -> str | tuple[str, ...]:
    """Check the arguments `noise`, `deviation` and `sensor` as in the table [posterior] of a study; return the noise.

    who: name of the function or class with these arguments, for errors. The result is "auto", or a tuple of names of
    noise models. Raises InputError, whose message gives the valid values.
    """
    given = names_given(noise)
    named = "auto" if given == ("auto",) else given
    read_section(PosteriorTable, {"noise": named, "deviation": deviation, "sensor": sensor}, who)
    check_plugins(NOISES, () if named == "auto" else given, f"{who}.noise")
    return named


def names_given(given: object) -> tuple[Any, ...]:
    """Convert an argument that may be one name or several names to a tuple; the names are not checked."""
    return tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)


def _mapping(given: object, key: str) -> Mapping[str, Any]:
    """Return an argument unchanged if it is a dictionary; otherwise raise InputError, whose message names `key`."""
    if not isinstance(given, Mapping):
        raise StudyError(key, f"is {show(given)}; it must be a dictionary by parameter name")
    return given
