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
"""A record's keys that are called otherwise than the arguments of `read`."""


class StudyError(Exception):
    """What is wrong at a key of the study file; `load_study` adds the file's name."""

    def __init__(self, key: str, what: str) -> None:
        key = key if len(key) <= 80 else f"{key[:50]}...{key[-27:]}"
        self.key, self.what = key, what
        super().__init__(f"{key}: {what}" if key else what)

    def within(self, table: str) -> str:
        """The line with its key as it is called inside a table."""
        key = "" if self.key == table else self.key.removeprefix(f"{table}.")
        return f"{key}: {self.what}" if key else self.what


def shown(value: object) -> str:
    """A value as the study file writes it, cut to a line's length."""
    try:
        text = str(value).lower() if isinstance(value, bool) else repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def below(key: str, name: str) -> str:
    """The key `name` of the table `key`."""
    return f"{key}.{name}" if key else name


def table(raw: object, key: str) -> dict[str, Any]:
    """The raw value as a table. Raises StudyError."""
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {shown(raw)}; it must be a table")
    return raw


def known_keys(raw: Iterable[str], valid: Iterable[str], key: str) -> None:
    """Refuse an unknown key and name the nearest valid one. Raises StudyError."""
    valid = list(valid)
    for name in raw:
        if name not in valid:
            raise StudyError(below(key, name), f"unknown key{nearest(name, valid)}")


def section(model: type[Model], raw: object, key: str) -> Model:
    """A table as a frozen model; each field's description says what would be right. Raises StudyError."""
    fields = {n: f for n, f in model.model_fields.items() if not f.exclude}
    known_keys(table(raw, key), fields, key)
    try:
        return model.model_validate(raw, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        inner = first.get("ctx", {}).get("error")
        if not first["loc"]:
            raise StudyError(key, str(inner or first["msg"])) from None
        name = str(first["loc"][0])
        right = fields[name].description
        must = f"it must be {right}" if right else first["msg"].lower()
        if first["type"] == "missing":
            raise StudyError(below(key, name), f"is missing; {must}") from None
        given = raw.get(name) if isinstance(raw, dict) else None
        raise StudyError(below(key, name), f"is {shown(given)}; {must}") from None


def number(raw: object, key: str, *, positive: bool = False, minimum: float | None = None) -> float:
    """A finite number. Raises StudyError."""
    right = "a positive number" if positive else "a number" if minimum is None else f"at least {minimum:g}"
    try:
        value = float(raw) if isinstance(raw, int | float) and not isinstance(raw, bool) else math.nan
    except OverflowError:  # an integer of more than 308 digits
        value = math.inf
    if not math.isfinite(value) or (positive and value <= 0) or (minimum is not None and value < minimum):
        raise StudyError(key, f"is {shown(raw)}; it must be {right}")
    return value


_PRIORS: Mapping[str, type[BaseModel]] = {
    kind.model_fields["prior"].default: kind for kind in get_args(get_args(GivenPrior)[0])
}


def prior(raw: object, key: str, *, negative: bool = True) -> Any:
    """A prior table as one of `bayesdamp.priors`, with or without values below zero. Raises StudyError."""
    found = _prior(raw, key)
    if not negative and (isinstance(found, Normal) or (isinstance(found, Uniform) and found.low < 0)):
        what = f"is {found.describe()}, which allows values below zero"
        raise StudyError(
            key, f"{what}; it must be a halfnormal, lognormal, loguniform, or a uniform from 0 up"
        )
    return found


def _prior(raw: object, key: str) -> Any:
    example = 'a table such as { prior = "normal", mean = 0.0, sd = 1.0 }'
    if not isinstance(raw, dict):
        raise StudyError(key, f"is {shown(raw)}; it must be {example}")
    kind = raw.get("prior")
    if kind is None:
        raise StudyError(key, f"names no prior; it must be {example}")
    if not isinstance(kind, str) or kind not in _PRIORS:
        raise StudyError(
            below(key, "prior"), f"unknown prior {shown(kind)}{nearest(str(kind), list(_PRIORS))}"
        )
    return section(_PRIORS[kind], raw, key)


def plugin_name(registry: Registry[Any], name: str, key: str) -> str:
    """A plug-in's name, checked without importing the plug-in. Raises StudyError."""
    if name not in registry.names():
        raise StudyError(key, f"unknown {registry.kind} {name!r}{nearest(name, registry.names())}")
    return name


def distinct(names: Iterable[str], key: str, what: str) -> None:
    """Refuse a repeated name. Raises StudyError."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise StudyError(key, f"names {what} {name!r} twice; once is enough")
        seen.add(name)


@contextmanager
def in_keys() -> Iterator[None]:
    """Name what a refusal asks for as keys of a study, and not as the command's options."""
    try:
        yield
    except InputError as error:
        if not error.arguments:
            raise
        raise error.naming(lambda argument: f"signal.{_KEYS.get(argument, argument)}") from None
