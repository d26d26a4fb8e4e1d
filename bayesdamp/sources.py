"""Compute digests of the source code that a computation uses; they are part of the keys of stored results."""

import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

PACKAGE = "bayesdamp"
"""Name of the package."""
ROOT = Path(__file__).parent
"""Folder of the package's source files."""
UNRELATED_MODULES = (
    "bayesdamp.cli", "bayesdamp.config", "bayesdamp.machine", "bayesdamp.plugins", "bayesdamp.report",
    "bayesdamp.sources", "bayesdamp.store",
)  # fmt: skip
"""Modules that do not affect results, but only where and when something is computed and how it is shown. They are not
part of a digest. (The values of settings are a separate part of the key of a result.)"""
LEAF_MODULES = (
    "bayesdamp.pipeline", "bayesdamp.pipeline.candidates.candidate", "bayesdamp.pipeline.candidates.tasks",
    "bayesdamp.pipeline.envelopes", "bayesdamp.interface.envelopes",
)  # fmt: skip
"""Modules that import many independent computations. Their own source is part of a digest, but not the modules that
they import, so that a change of one computation does not affect the digests of all others."""

_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+(bayesdamp[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]+)|import[ \t]+(bayesdamp[\w.]*))",
    re.M,
)
_ONLY_FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:[ \t]+[^\n]*\n|\n)+", re.M)


@cache
def code_digest(*modules: str) -> str:
    """Return the SHA-256 of the sources of modules and of the package's modules that they import, at any depth.

    Modules that do not affect results are left out, as in `import_closure`. The digest does not contain plug-ins,
    because these are found by name and not imported; a caller must add their sources.
    """
    digest = hashlib.sha256()
    for name in sorted(import_closure(modules)):
        digest.update(f"{name}\0{_text(name)}\0".encode())
    return digest.hexdigest()


@cache
def package_digest() -> str:
    """Return the SHA-256 of the sources of all modules of the package.

    Worker processes compare it with that of the process that started the run, and refuse to run other code.
    """
    return hashlib.sha256("\0".join(f"{n}\0{_text(n)}" for n in sorted(_files())).encode()).hexdigest()


def import_closure(modules: Iterable[str]) -> set[str]:
    """Return the names of `modules` and of all modules of this package that they import, at any depth.

    The packages that contain these modules are included, but not `bayesdamp` itself. Imports of `LEAF_MODULES` are not
    followed. A module of `UNRELATED_MODULES` is left out, unless it is one of `modules`; its imports are never
    followed.
    """
    waiting = list(modules)
    names = {name for name in waiting if _is_outside(name)}
    while waiting:
        name = waiting.pop()
        if name in names or name == PACKAGE or _is_outside(name) or _text(name) is None:
            continue
        names.add(name)
        waiting.append(name.rpartition(".")[0])
        if name not in LEAF_MODULES:
            waiting += direct_imports(name) - names
    return names


@cache
def _is_outside(name: str) -> bool:
    """Return whether a module is in `UNRELATED_MODULES`, or inside a package that is in this list."""
    return any(name == module or name.startswith(f"{module}.") for module in UNRELATED_MODULES)


@cache
def direct_imports(name: str) -> frozenset[str]:
    """Return the names of the modules of this package that a module imports directly, at its top or in functions.

    Imports under `if TYPE_CHECKING` are left out.
    """
    text, modules = _ONLY_FOR_TYPES.sub("", _text(name) or ""), set[str]()
    for base, names, plain in _IMPORT.findall(text):
        modules.add(plain or base)
        parts = (part.split("#")[0].split() for part in re.split(r"[,\n]", names.strip("()")))
        below = {f"{base}.{part[0].strip('()')}" for part in parts if part}
        modules |= below & _files().keys()
    return frozenset(modules)


@cache
def _text(name: str) -> str | None:
    """Return the source code of a module; None if this package has no such module.

    The result is cached: a change of the file after the first call has no effect in this process.
    """
    file = _files().get(name)
    return file.read_text(encoding="utf-8") if file else None


@cache
def _files() -> dict[str, Path]:
    """Return the path of the file of each module in this package, by module name.

    The list is made once, which is faster than a search for the file of each import.
    """
    parts = {path: path.relative_to(ROOT.parent).with_suffix("").parts for path in ROOT.rglob("*.py")}
    return {".".join(part for part in each if part != "__init__"): path for path, each in parts.items()}
