"""Digest the source of the code that a computation can reach, on which its stored results depend."""

from __future__ import annotations

import hashlib
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
"""Modules that decide where and when something is computed, and how it is shown, but not the result itself; settings
are part of a key by their values."""
LEAVES = (
    "bayesdamp.pipeline", "bayesdamp.pipeline.candidates.branch", "bayesdamp.pipeline.candidates.cells",
    "bayesdamp.pipeline.envelopes", "bayesdamp.interface.envelopes",
)  # fmt: skip
"""Modules that combine many computations: each counts with its own source, without its imports."""

_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(bayesdamp[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]+)|import[ \t]+(bayesdamp[\w.]*))",
    re.M,
)
_ONLY_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n|\n)+", re.M)
_TEXTS: dict[str, str | None] = {}
"""Each module's source at its first request: a process computes with what it has loaded."""
_IMPORTED: dict[str, frozenset[str]] = {}


@cache
def code_digest(*modules: str) -> str:
    """Return the SHA-256 of the sources of modules and of all modules of the package that they import, at any depth.

    A plug-in that is found by its name is not an import: its own source must be added where it is used.
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
    """Return these modules and all that they import, at any depth; of the modules `OUTSIDE` only the given ones."""
    waiting = list(modules)
    names = {name for name in waiting if _is_outside(name)}
    while waiting:
        name = waiting.pop()
        if name in names or name == PACKAGE or _is_outside(name) or _text(name) is None:
            continue
        names.add(name)
        waiting.append(name.rpartition(".")[0])
        if name not in LEAVES:
            waiting += imported(name) - names
    return names


@cache
def _is_outside(name: str) -> bool:
    return any(name == module or name.startswith(f"{module}.") for module in OUTSIDE)


def imported(name: str) -> frozenset[str]:
    """Return the modules of the package that a module imports directly, when it is loaded or later."""
    if name not in _IMPORTED:
        text, modules = _ONLY_FOR_TYPES.sub("", _text(name) or ""), set[str]()
        for base, names, plain in _IMPORT.findall(text):
            modules.add(plain or base)
            parts = (part.split("#")[0].split() for part in re.split(r"[,\n]", names.strip("()")))
            below = {f"{base}.{part[0].strip('()')}" for part in parts if part}
            modules |= {module for module in below if _text(module) is not None}
        _IMPORTED[name] = frozenset(modules)
    return _IMPORTED[name]


def _text(name: str) -> str | None:
    """Return a module's source; None where the package has no such module."""
    if name not in _TEXTS:
        file = _files().get(name)
        _TEXTS[name] = file.read_text(encoding="utf-8") if file else None
    return _TEXTS[name]


@cache
def _files() -> dict[str, Path]:
    """Map the package's modules to their files: a test of each file that an import may mean takes ten times as long."""
    parts = {path: path.relative_to(ROOT.parent).with_suffix("").parts for path in ROOT.rglob("*.py")}
    return {".".join(part for part in each if part != "__init__"): path for path, each in parts.items()}
