"""Calls from Python: what cannot be meant is refused in one line, in the words of Python."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping
from functools import wraps
from numbers import Real
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

from bayesdamp.plugins import nearest
from bayesdamp.types import InputError, Signal

P = ParamSpec("P")
R = TypeVar("R")

KINDS: dict[str, tuple[tuple[type, ...], str]] = {
    "path": ((str, os.PathLike), "a path"),
    "signal": ((Signal,), "a Signal, such as read(...).signal() gives"),
    "unit": ((str,), "a unit's name"),
    "quantity": ((str,), "a quantity's name"),
    "rate": ((Real,), "a number, in Hz"),
}
"""What an argument of this name is, wherever it stands; None where that is its default."""


class Told:
    """Base of public classes: their methods are `told`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name, value in list(vars(cls).items()):
            if name.startswith("_"):
                continue
            if isinstance(value, FunctionType):
                setattr(cls, name, told(value, name))
            elif isinstance(value, classmethod):
                setattr(cls, name, classmethod(told(value.__func__, name)))


def told(function: Callable[P, R], name: str) -> Callable[P, R]:
    """Return the function under a public name, with InputError for a keyword that it has not, an argument that is
    missing, or one of `KINDS` that is of another type; what it refuses names keywords, not the command's options."""
    signature = inspect.signature(function)

    @wraps(function)
    def called(*args: P.args, **given: P.kwargs) -> R:
        try:
            bound = signature.bind(*args, **given)
        except TypeError as error:
            raise InputError(_wrong(signature, name, given) or f"{name}: {error}") from None
        for argument, value in bound.arguments.items():
            kinds, what = KINDS.get(argument, ((object,), ""))
            if not isinstance(value, kinds) and value is not signature.parameters[argument].default:
                raise InputError(f"{name}: {argument} is {type(value).__name__}; it must be {what}")
        try:
            return function(*args, **given)
        except InputError as error:
            if not error.arguments:
                raise
            raise error.naming(lambda argument: f"{argument}=") from None

    return called


def _wrong(signature: inspect.Signature, name: str, given: Mapping[str, object]) -> str:
    """What is wrong with a keyword; empty where all may stand."""
    if any(one.kind is inspect.Parameter.VAR_KEYWORD for one in signature.parameters.values()):
        return ""
    known = [n for n in signature.parameters if n not in ("self", "cls")]
    wrong = next((n for n in given if n not in known), None)
    return "" if wrong is None else f"{name}: unknown argument {wrong!r}{nearest(wrong, known)}"
