"""What is asked of a comparison, checked before anything is computed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, get_args

from bayesdamp.physics.damping import TERMS, all_sums, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.priors import Prior
from bayesdamp.types import InputError

KINDS = get_args(get_args(Prior)[0])
"""The classes of priors."""
NOISE = "noise_sd"
LARGEST_SENSOR = 0.5


def sums_and_laws(
    damping: str | Sequence[str], restoring: str | Sequence[str]
) -> tuple[list[str], list[str]]:
    """Damping sums and restoring laws, one given as itself or several in a list. Raises InputError for a name that is
    none."""
    sums = [damping] if isinstance(damping, str) else list(damping)
    laws = [restoring] if isinstance(restoring, str) else list(restoring)
    for one in sums:
        parse_model(one)
    for law in laws:
        LAWS.get(law)
    return sums, laws


def known_and_priors(
    sums: Sequence[str],
    laws: Sequence[str],
    known: Mapping[str, float] | None,
    priors: Mapping[str, Prior] | None,
    sensor: float,
) -> dict[str, Prior]:
    """The priors by parameter. Raises InputError for a name that no model here has, and for what is no such value.

    sums, laws: what is compared, empty for all; known: values of parameters; priors: by damping term or parameter.
    """
    terms = tuple(dict.fromkeys(t for s in sums or all_sums() for t in parse_model(s)))
    coefficients = {t: TERMS.get(t).parameter for t in terms}
    parameters = dict.fromkeys(p for law in laws or LAWS.names() for p in Oscillator(terms, law).parameters)
    free = [
        *(p for p in parameters if p not in coefficients.values()),
        *["epsilon"] * ("epsilon" not in parameters),
    ]
    for name, value in _mapping("known", known).items():
        if name in coefficients or name in coefficients.values():
            raise InputError(
                f"compare: known {name!r} is a damping, which is always inferred; give it a prior"
            )
        if name not in (*free, NOISE):
            raise InputError(f"compare: known has unknown parameter {name!r}{nearest(name, [*free, NOISE])}")
        if not _is_number(value):
            raise InputError(f"compare: known {name!r} is {value!r}; it must be a finite number")
    found: dict[str, Prior] = {}
    for name, prior in _mapping("priors", priors).items():
        if name not in (*terms, *parameters):
            right = nearest(name, [*terms, *parameters])
            raise InputError(f"compare: priors has unknown term or parameter {name!r}{right}")
        if not isinstance(prior, KINDS):
            kinds = ", ".join(kind.__name__ for kind in KINDS)
            raise InputError(f"compare: the prior of {name!r} is {prior!r}; it must be one of {kinds}")
        if name in (known or {}):
            raise InputError(f"compare: {name!r} is known and has a prior; give one of the two")
        found[coefficients.get(name, name)] = prior
    if not (_is_number(sensor) and 0 <= sensor < LARGEST_SENSOR):
        raise InputError(
            f"compare: sensor is {sensor!r}; it must be a number from 0 to below {LARGEST_SENSOR:g}"
        )
    return found


def _mapping(what: str, given: object) -> Mapping[str, Any]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InputError(f"compare: {what} is {type(given).__name__}; it must be a dictionary by parameter")
    return given


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
