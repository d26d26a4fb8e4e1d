"""Convert values to JSON and named arrays, and back; the types of dataclass fields determine how."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, TypeAdapter

_adapter = cache(TypeAdapter)
UNIONS = (Union, UnionType)
UNCHANGED = (str, int, bool, NoneType)
"""Types whose values `join` does not change."""


class Storable:
    """Base of classes whose instances are stored as instances of another class.

    A subclass sets `_STORED` to this other class, which `split` can convert to JSON.
    """

    _STORED: type

    def _reduced(self) -> Any:
        """Convert this object to the form in which it is stored, an instance of `_STORED`, and return it."""
        raise NotImplementedError

    @classmethod
    def _restored(cls, stored: Any) -> Any:
        """Restore an object of this class from its stored form, an instance of `_STORED`, and return it."""
        raise NotImplementedError


def split(value: object, arrays: dict[str, np.ndarray] | None = None, path: str = "") -> Any:
    """Convert a value to types of JSON; `join` is the inverse.

    Parameters
    ----------
    value
        Value that consists of dataclasses, pydantic models, `Storable` objects, mappings, lists, tuples, arrays, enums,
        paths and types of JSON. Keys of mappings become strings; floats that are not finite stay floats.
    arrays
        Mapping to which each array is added under its path, such as `signal/t`; in the value it is replaced by None. If
        no mapping is given, arrays become lists.
    path
        Path of the value itself, with which the paths of its arrays begin.

    Returns
    -------
    object
        The converted value.

    Raises
    ------
    TypeError
        If a part of the value cannot be converted.
    """
    below = f"{path}/" if path else ""
    if isinstance(value, Storable):
        value = value._reduced()
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if is_dataclass(value):
        value = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(k): split(v, arrays, f"{below}{k}") for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [split(v, arrays, f"{below}{i}") for i, v in enumerate(value)]
    if isinstance(value, np.ndarray):
        if arrays is None:
            return value.tolist()
        arrays[path] = value
        return None
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, str | int | float):
        return value
    raise TypeError(f"cannot store a {type(value).__name__}")


def join(kind: Any, value: Any, arrays: Mapping[str, np.ndarray] | None = None, path: str = "") -> Any:
    """Convert JSON and arrays from `split` back to a value of the type `kind`.

    value: the JSON. arrays: arrays by path, as `split` stored them. path: path of the value in `arrays`. None becomes
    NaN where a float is expected, and fields that are missing get their defaults. Raises AttributeError, KeyError,
    TypeError or ValueError if the structure of the value does not match the type. The types of single numbers and texts
    are not checked.
    """
    if arrays and path in arrays:
        return arrays[path]
    origin, args = _parts(kind)
    if origin in UNIONS:
        kind = _member(kind, value)
        origin, args = _parts(kind)
    if origin is float:
        return np.nan if value is None or value != value else value
    if origin in UNIONS:
        return _adapter(kind).validate_python(value)
    if origin in UNCHANGED or not isinstance(origin, type):
        return value
    below = f"{path}/" if path else ""
    if issubclass(origin, Storable):
        return origin._restored(join(origin._STORED, value, arrays, path))
    if issubclass(origin, BaseModel):
        return _adapter(origin).validate_python(value)
    if is_dataclass(origin):
        hints = _hints(origin)
        return origin(**{n: join(hints[n], v, arrays, f"{below}{n}") for n, v in value.items()})
    if issubclass(origin, tuple):
        kinds = [args[0]] * len(value) if Ellipsis in args else args
        each = enumerate(zip(kinds, value, strict=True))
        return tuple(join(k, v, arrays, f"{below}{i}") for i, (k, v) in each)
    if issubclass(origin, Mapping):
        return {k: join(args[1], v, arrays, f"{below}{k}") for k, v in value.items()}
    if issubclass(origin, np.ndarray):
        return np.array(value)
    return origin(value) if issubclass(origin, Enum | Path) else value


@cache
def _parts(kind: Any) -> tuple[Any, tuple[Any, ...]]:
    """Return the type without its arguments, and the arguments: for tuple[int, ...] these are tuple and (int, ...)."""
    return get_origin(kind) or kind, get_args(kind)


def _member(kind: Any, value: object) -> Any:
    """Return the member of a union type that matches a stored value in JSON form.

    kind: the union. For None the result is NoneType. If all members of the union are pydantic models, it is the union
    itself. If the union has only one member besides None, it is this member. Otherwise it is the first member that fits
    a list (tuple, array) or an object (mapping, dataclass), or Any if none fits, as for numbers and texts.
    """
    kinds = [k for k in get_args(kind) if k is not NoneType]
    if value is None and NoneType in get_args(kind):
        return NoneType
    if all(isinstance(k, type) and issubclass(k, BaseModel) for k in kinds):
        return kind
    wanted = {list: (tuple, np.ndarray), dict: (Mapping,)}.get(type(value), ())
    fitting = (k for k in kinds if (get_origin(k) or k) in wanted or (wanted and is_dataclass(k)))
    return kinds[0] if len(kinds) == 1 else next(fitting, Any)


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Return the types of a dataclass's fields by name.

    This also works if the module of the dataclass imports NumPy only under `if TYPE_CHECKING`.
    """
    return get_type_hints(kind, localns={"np": np, "NDArray": NDArray})
