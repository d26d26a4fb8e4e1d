"""Check the arguments of public functions; a wrong one raises an InputError of one line that names the keyword."""

import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from numbers import Integral, Real
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
    "seed": ((Integral,), "a whole number, 0 or more"),
    "amplitudes": ((Iterable,), "a list of amplitudes"),
    "start": ((str, Real, Mapping), 'a number of seconds or "auto"; for `fit`, values by parameter name'),
    "stop": ((str, Real), 'a number of seconds or "auto"'),
}
"""For names of arguments: the allowed types, and a description of them for error messages. They apply to every function
that `checked_call` wraps and that has an argument of this name. The default value of an argument is always allowed.
Modules of `interface` add entries for the classes that they define."""


class CheckedMethods:
    """Base of public classes whose methods check their arguments.

    `checked_call` wraps each method and class method that a subclass itself defines. It does not wrap static methods,
    properties, and methods whose names begin with _.
    """

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
    """Return a function that checks its arguments and then calls `function` with them.

    It raises InputError for arguments that do not match the signature (an unknown keyword, a missing or superfluous
    argument), or if an argument whose name is in `KINDS` has a wrong type. If `function` raises an InputError that
    names `arguments`, these are written in the message as Python keywords (`unit=`) instead of options of the command
    line (`--unit`). name: public name of the function, for messages.
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
            if argument == "seed" and isinstance(value, Integral) and value < 0:
                raise InputError(f"{name}: {argument} is {value}; it must be {what}")
            if not isinstance(value, kinds) and value is not signature.parameters[argument].default:
                raise InputError(f"{name}: {argument} is {type(value).__name__}; it must be {what}")
        try:
            return function(*args, **keywords)
        except InputError as error:
            if not error.arguments:
                raise
            raise error.naming(lambda argument: f"{argument}=") from None

    return checked
