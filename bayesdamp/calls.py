"""Check the arguments of public functions; a wrong one raises an InputError of one line that names the keyword."""

import inspect
import os
from collections.abc import Callable
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
"""Allowed types of arguments with these names, in all functions, and their description. Defaults are always allowed."""


class CheckedMethods:
    """Base of public classes: `checked_call` wraps each public method and class method that a subclass defines."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name, value in list(vars(cls).items()):
            if name.startswith("_"):
                continue
            if isinstance(value, FunctionType):
                setattr(cls, name, checked_call(value, name))
            elif isinstance(value, classmethod):
                setattr(cls, name, classmethod(checked_call(value.__func__, name)))


def checked_call(function: Callable[P, R], name: str) -> Callable[P, R]:
    """Return the function with a check of its arguments; `name` is its public name, for messages.

    The result raises InputError for arguments that do not match the signature (an unknown keyword, a missing or
    superfluous argument), or an argument of `KINDS` with a wrong type. Input errors that the function raises name
    Python keywords instead of options of the command.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def checked(*args: P.args, **keywords: P.kwargs) -> R:
        try:
            bound = signature.bind(*args, **keywords)
        except TypeError as error:
            what = str(error)
            known = [n for n in signature.parameters if n not in ("self", "cls")]
            unknown = next((n for n in keywords if n not in known), None)
            takes_any = any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values())
            if unknown is not None and not takes_any:
                what = f"unknown argument {unknown!r}{nearest(unknown, known)}"
            raise InputError(f"{name}: {what}") from None
        for argument, value in bound.arguments.items():
            kinds, what = KINDS.get(argument, ((object,), ""))
            if not isinstance(value, kinds) and value is not signature.parameters[argument].default:
                raise InputError(f"{name}: {argument} is {type(value).__name__}; it must be {what}")
        try:
            return function(*args, **keywords)
        except InputError as error:
            if not error.arguments:
                raise
            raise error.naming(lambda argument: f"{argument}=") from None

    return checked
