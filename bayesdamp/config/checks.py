"""Checks of a study file's tables; every fault is one line that names the key."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from bayesdamp.plugins import Registry, nearest
from bayesdamp.priors import GivenPrior, Normal, Uniform
from bayesdamp.types import InputError

Model = TypeVar("Model", bound=BaseModel)
_KEYS = {"value": "angle", "channels": "channel", "runs": "run"}
"""Arguments of `read` that have another name among the keys of a record."""
_PRIORS: Mapping[str, type[BaseModel]] = {
    kind.model_fields["prior"].default: kind for kind in get_args(get_args(GivenPrior)[0])
}


class StudyError(Exception):
    """A fault at a key of the study file; `load_study` adds the file's name."""

    def __init__(self, key: str, what: str) -> None:
        key = key if len(key) <= 80 else f"{key[:50]}...{key[-27:]}"
        self.key, self.what = key, what
        super().__init__(f"{key}: {what}" if key else what)

    def within(self, table: str) -> str:
        """Return the line with its key as it is called inside a table."""
        key = "" if self.key == table else self.key.removeprefix(f"{table}.")
        return f"{key}: {self.what}" if key else self.what


def show(value: object) -> str:
    """Return a value as the study file writes it, cut to a line's length."""
    try:
        text = str(value).lower() if isinstance(value, bool) else repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def join_keys(key: str, name: str) -> str:
    """Return the full key of `name` in the table `key`."""
    return f"{key}.{name}" if key else name


def check_table(raw: object, key: str) -> dict[str, Any]:
    """Return the raw value as a table. Raises StudyError."""
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {show(raw)}; it must be a table")
    return raw


def check_keys(raw: Iterable[str], valid: Iterable[str], key: str) -> None:
    """Refuse an unknown key and name the nearest valid one. Raises StudyError."""
    valid = list(valid)
    for name in raw:
        if name not in valid:
            raise StudyError(join_keys(key, name), f"unknown key{nearest(name, valid)}")


def read_section(model: type[Model], raw: object, key: str) -> Model:
    """Return a table as a frozen model; a field's description says what would be right. Raises StudyError."""
    fields = {n: f for n, f in model.model_fields.items() if not f.exclude}
    given = check_table(raw, key)
    check_keys(given, fields, key)
    try:
        return model.model_validate(given, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if not first["loc"]:
            inner = first.get("ctx", {}).get("error")
            raise StudyError(key, str(inner or first["msg"])) from None
        name = str(first["loc"][0])
        right = fields[name].description
        must = f"it must be {right}" if right else first["msg"].lower()
        what = "is missing" if first["type"] == "missing" else f"is {show(given.get(name))}"
        raise StudyError(join_keys(key, name), f"{what}; {must}") from None


def check_number(raw: object, key: str, *, positive: bool = False, minimum: float | None = None) -> float:
    """Return a finite number. Raises StudyError."""
    right = "a positive number" if positive else "a number" if minimum is None else f"at least {minimum:g}"
    try:
        value = float(raw) if isinstance(raw, int | float) and not isinstance(raw, bool) else math.nan
    except OverflowError:  # an integer of more than 308 digits
        value = math.inf
    if not math.isfinite(value) or (positive and value <= 0) or (minimum is not None and value < minimum):
        raise StudyError(key, f"is {show(raw)}; it must be {right}")
    return value


def read_prior(raw: object, key: str, *, negative: bool = True) -> Any:
    """Return a prior table as one of `bayesdamp.priors`, with or without values below zero. Raises StudyError."""
    example = 'a table such as { prior = "normal", mean = 0.0, sd = 1.0 }'
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {show(raw)}; it must be {example}")
    kind = raw.get("prior")
    if kind is None:
        raise StudyError(key, f"names no prior; it must be {example}")
    if not isinstance(kind, str) or kind not in _PRIORS:
        what = f"unknown prior {show(kind)}{nearest(str(kind), list(_PRIORS))}"
        raise StudyError(join_keys(key, "prior"), what)
    prior = read_section(_PRIORS[kind], raw, key)
    if not negative and (isinstance(prior, Normal) or (isinstance(prior, Uniform) and prior.low < 0)):
        right = "it must be a halfnormal, lognormal, loguniform, or a uniform from 0 up"
        raise StudyError(key, f"is {prior.describe()}, which allows values below zero; {right}")
    return prior


def check_plugins(registry: Registry[Any], names: Iterable[str], key: str) -> None:
    """Check plug-ins' names, without importing a plug-in. Raises StudyError."""
    for name in names:
        if name not in registry.names():
            raise StudyError(key, f"unknown {registry.kind} {name!r}{nearest(name, registry.names())}")


def check_distinct(names: Iterable[str], key: str, what: str) -> None:
    """Refuse a repeated name. Raises StudyError."""
    earlier: set[str] = set()
    for name in names:
        if name in earlier:
            raise StudyError(key, f"names {what} {name!r} twice; once is enough")
        earlier.add(name)


@contextmanager
def in_keys() -> Iterator[None]:
    """Make refusals name the keys of a study, in place of the command's options."""
    try:
        yield
    except InputError as error:
        if not error.arguments:
            raise
        raise error.naming(lambda argument: f"signal.{_KEYS.get(argument, argument)}") from None
