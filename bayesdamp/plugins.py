"""One way to find a plug-in by its name: the module of that name, imported only when it is asked for."""

from __future__ import annotations

import importlib
import pkgutil
from difflib import get_close_matches
from functools import cached_property
from typing import Generic, TypeVar

from bayesdamp.types import InputError

T = TypeVar("T")

_EXTENDED: list[str] = []


class Registry(Generic[T]):
    """Plug-ins of one kind: each module of `package` holds one, bound to the name `PLUGIN`."""

    def __init__(self, package: str, kind: str) -> None:
        self.package = package
        self.kind = kind
        self._added: dict[str, T] = {}

    def names(self) -> list[str]:
        """All names, sorted; nothing is imported."""
        return sorted(self._modules | set(self._added))

    @cached_property
    def _modules(self) -> set[str]:
        path = importlib.import_module(self.package).__path__
        return {m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_")}

    def add(self, name: str, plugin: T) -> None:
        """Make a plug-in known that has no module in the package (a user's own)."""
        self._added[name] = plugin
        _EXTENDED.append(name)

    def remove(self, name: str) -> None:
        """Forget a plug-in that `add` made known."""
        self._added.pop(name, None)

    def get(self, name: str) -> T:
        """The plug-in of that name. Raises InputError with the nearest valid name."""
        if name in self._added:
            return self._added[name]
        if name not in self.names():
            raise InputError(f"unknown {self.kind} {name!r}{nearest(name, self.names())}")
        return importlib.import_module(f"{self.package}.{name}").PLUGIN


def extended() -> bool:
    """Whether this process has had a plug-in that is not in the package."""
    return bool(_EXTENDED)


def nearest(name: str, valid: list[str]) -> str:
    """A clause that names the nearest valid name, or all of them."""
    close = get_close_matches(name, valid, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else f"; valid are {', '.join(valid)}"
