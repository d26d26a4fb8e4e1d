"""The source of the code that a computation can reach: what its stored results depend on besides their inputs."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

PACKAGE = "bayesdamp"
ROOT = Path(__file__).parent
OUTSIDE = (
    "bayesdamp.cli", "bayesdamp.config", "bayesdamp.machine", "bayesdamp.plugins", "bayesdamp.report",
    "bayesdamp.sources", "bayesdamp.store",
)  # fmt: skip
"""What decides where and when something is computed, and what is made of it, but not the result itself; settings are
part of a key by their values."""
LEAVES = (
    "bayesdamp.pipeline", "bayesdamp.pipeline.candidates.branch", "bayesdamp.pipeline.candidates.cells",
    "bayesdamp.pipeline.envelopes", "bayesdamp.interface.envelopes",
)  # fmt: skip
"""Modules that bring many computations together: each counts with its own source, not with what it imports."""

_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(bayesdamp[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]+)|import[ \t]+(bayesdamp[\w.]*))",
    re.M,
)
_ONLY_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n|\n)+", re.M)
_TEXTS: dict[str, str | None] = {}
"""Each module's source as it was when it was first asked for: a process computes with what it has loaded."""
_IMPORTED: dict[str, frozenset[str]] = {}


@cache
def code_digest(*modules: str) -> str:
    """SHA-256 of the sources of modules of the package and of all of the package that they import, at any depth.

    A plug-in that is looked up by its name is no import: its own source has to be added where it is used.
    """
    digest = hashlib.sha256()
    for name in sorted(reached(modules)):
        digest.update(f"{name}\0{_text(name)}\0".encode())
    return digest.hexdigest()


@cache
def package_digest() -> str:
    """Return the SHA-256 of the sources of the whole package."""
    return hashlib.sha256("\0".join(f"{n}\0{_text(n)}" for n in sorted(_files())).encode()).hexdigest()


def reached(modules: Iterable[str]) -> set[str]:
    """Return these modules of the package and all that they import, at any depth; nothing else of what is `OUTSIDE`."""
    waiting = list(modules)
    found = {name for name in waiting if _is_outside(name)}
    while waiting:
        name = waiting.pop()
        if name in found or name == PACKAGE or _is_outside(name) or _text(name) is None:
            continue
        found.add(name)
        waiting.append(name.rpartition(".")[0])
        if name not in LEAVES:
            waiting += imported(name) - found
    return found


@cache
def _is_outside(name: str) -> bool:
    return any(name == one or name.startswith(f"{one}.") for one in OUTSIDE)


def imported(name: str) -> frozenset[str]:
    """The modules of the package that a module imports directly, when it is loaded or later."""
    if name not in _IMPORTED:
        text, found = _ONLY_FOR_TYPES.sub("", _text(name) or ""), set[str]()
        for base, names, plain in _IMPORT.findall(text):
            if plain:
                found.add(plain)
                continue
            found.add(base)
            parts = (part.split("#")[0].split() for part in re.split(r"[,\n]", names.strip("()")))
            below = {f"{base}.{part[0].strip('()')}" for part in parts if part}
            found |= {one for one in below if _text(one) is not None}
        _IMPORTED[name] = frozenset(found)
    return _IMPORTED[name]


def _text(name: str) -> str | None:
    """A module's source; None where the package has no such module."""
    if name not in _TEXTS:
        file = _files().get(name)
        _TEXTS[name] = file.read_text(encoding="utf-8") if file else None
    return _TEXTS[name]


@cache
def _files() -> dict[str, Path]:
    """The package's modules: asking for each file that an import may mean takes ten times as long."""
    found: dict[str, Path] = {}
    for folder, below, files in os.walk(ROOT):
        below[:] = [one for one in below if one != "__pycache__"]
        path = Path(folder)
        package = ".".join((PACKAGE, *path.relative_to(ROOT).parts))
        found |= {f"{package}.{name[:-3]}": path / name for name in files if name.endswith(".py")}
        if f"{package}.__init__" in found:
            found[package] = found.pop(f"{package}.__init__")
    return found
