"""Check the tables of a study file. Each error message is one line that names the key."""

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from bayesdamp.formatting import show
from bayesdamp.plugins import Registry, nearest
from bayesdamp.priors import GivenPrior, Normal, Uniform
from bayesdamp.types import InputError

Model = TypeVar("Model", bound=BaseModel)
_KEYS = {"value": "angle", "channels": "channel", "runs": "run"}
"""For each argument of `bayesdamp.read` that has another name in a study file: the name of its key in [[signal]]."""
PRIORS: Mapping[str, type[BaseModel]] = {
    kind.model_fields["prior"].default: kind for kind in get_args(get_args(GivenPrior)[0])
}
"""The class of each prior that a study file can specify, by its name, such as "normal"."""


class StudyError(InputError):
    """An error at a key of the study file, or at an argument that is checked in the same way; `where` is the key.

    `load_study` converts it to an InputError with the name of the file.
    """

    def __init__(self, key: str, what: str) -> None:
        super().__init__(what, key if len(key) <= 80 else f"{key[:50]}...{key[-27:]}")


def join_keys(key: str, name: str) -> str:
    """Return the full key of `name` in the table `key`, such as "simulate.samples"; `name` alone if `key` is empty."""
    return f"{key}.{name}" if key else name


def check_table(raw: object, key: str) -> dict[str, Any]:
    """Return the value `raw` if it is a table (a dict); otherwise raise StudyError, which names its `key`."""
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {show(raw)}; it must be a table")
    return raw


def check_keys(raw: Iterable[str], valid: Iterable[str], key: str) -> None:
    """Raise StudyError if a key of the table `key` is not valid; the message names the nearest valid key."""
    valid = list(valid)
    for name in raw:
        if name not in valid:
            raise StudyError(join_keys(key, name), f"unknown key{nearest(name, valid)}")


def read_section(model: type[Model], raw: object, key: str) -> Model:
    """Check a table of the study file, and return it as an instance of `model`, the class that defines its keys.

    `key` is the full key of the table, for messages; empty for the top of the file. Raises StudyError if `raw` is not a
    table, or for an unknown, missing or wrong key; the message states valid values.
    """
    fields = {n: f for n, f in model.model_fields.items() if not f.exclude}
    given = check_table(raw, key)
    check_keys(given, fields, key)
    try:
        return model.model_validate(given, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if not first["loc"]:
            raise StudyError(key, str(first.get("ctx", {}).get("error") or first["msg"])) from None
        name = str(first["loc"][0])
        right = fields[name].description
        must = f"it must be {right}" if right else first["msg"].lower()
        what = "is missing" if first["type"] == "missing" else f"is {show(given.get(name))}"
        raise StudyError(join_keys(key, name), f"{what}; {must}") from None


def check_number(raw: object, key: str, *, positive: bool = False, minimum: float | None = None) -> float:
    """Return a raw value as a finite float. Raises StudyError if it is not a finite number, or out of range.

    A bool is not a number. key: full key of the value, for the message. positive: whether it must be above 0. minimum:
    smallest allowed value.
    """
    right = "a positive number" if positive else "a number"
    if minimum is not None:
        right += f" of at least {minimum:g}"
    try:
        value = float(raw) if isinstance(raw, int | float) and not isinstance(raw, bool) else math.nan
    except OverflowError:  # an integer of more than 308 digits
        value = math.inf
    if not math.isfinite(value) or (positive and value <= 0) or (minimum is not None and value < minimum):
        raise StudyError(key, f"is {show(raw)}; it must be {right}")
    return value


def read_prior(raw: object, key: str, *, negative: bool = True) -> Any:
    """Return the prior that a table such as { prior = "normal", mean = 0.0, sd = 1.0 } describes.

    key: full key of the table, for messages. negative: whether the prior may allow negative values. Raises StudyError
    if the table is wrong.
    """
    example = 'a table such as { prior = "normal", mean = 0.0, sd = 1.0 }'
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {show(raw)}; it must be {example}")
    kind = raw.get("prior")
    if kind is None:
        raise StudyError(key, f"does not state the type of the prior; the value must be {example}")
    if not isinstance(kind, str) or kind not in PRIORS:
        what = f"unknown prior {show(kind)}{nearest(str(kind), list(PRIORS))}"
        raise StudyError(join_keys(key, "prior"), what)
    prior = read_section(PRIORS[kind], raw, key)
    check_support(prior, key, negative=negative)
    return prior


def check_support(prior: Any, key: str, *, negative: bool) -> None:
    """Raise StudyError, at `key`, if a prior allows negative values although `negative` is false."""
    if not negative and (isinstance(prior, Normal) or (isinstance(prior, Uniform) and prior.low < 0)):
        right = "it must be a halfnormal, lognormal, loguniform, or a uniform from 0 up"
        raise StudyError(key, f"is {prior.describe()}, which allows values below zero; {right}")


def check_plugins(registry: Registry[Any], names: Iterable[str], key: str) -> None:
    """Raise StudyError if `registry` has no plug-in (such as an estimator) of one of these names.

    `key` is the key of the study file with the names. The plug-ins are not imported.
    """
    for name in names:
        if name not in registry.names():
            raise StudyError(key, f"unknown {registry.kind} {name!r}{nearest(name, registry.names())}")


def check_distinct(names: Iterable[str], key: str, what: str) -> None:
    """Raise StudyError if a name is repeated.

    For the message, `key` is the key of the study file with the names, and `what` their kind, such as "the sampler".
    """
    earlier: set[str] = set()
    for name in names:
        if name in earlier:
            raise StudyError(key, f"names {what} {name!r} twice; delete or rename one")
        earlier.add(name)


@contextmanager
def in_keys() -> Iterator[None]:
    """Make InputErrors that are raised in this context name keys of a study file instead of command-line options.

    Errors without `arguments` name no options and are not changed.
    """
    try:
        yield
    except InputError as error:
        if not error.arguments:
            raise
        raise error.naming(lambda argument: f"signal.{_KEYS.get(argument, argument)}") from None
