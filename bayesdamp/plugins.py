"""One way to find a plug-in by its name: in the package, in modules that a user names, or by entry points.

Nothing is imported before it is asked for by its name.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import linecache
import pkgutil
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from bayesdamp.plain_text import at_home, read_plain
from bayesdamp.sources import code_digest
from bayesdamp.types import InputError

T = TypeVar("T")

GROUPS = {
    "bayesdamp.physics.damping": "bayesdamp.damping",
    "bayesdamp.physics.restoring": "bayesdamp.restoring",
    "bayesdamp.estimators.methods": "bayesdamp.estimators",
    "bayesdamp.inference.samplers": "bayesdamp.samplers",
    "bayesdamp.inference.evidence.methods": "bayesdamp.evidence",
    "bayesdamp.inference.noise": "bayesdamp.noise",
    "bayesdamp.records.readers": "bayesdamp.readers",
    "bayesdamp.report.sections": "bayesdamp.sections",
}
"""The entry points' group of each package of plug-ins."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_COMPILED = ("bayesdamp.physics.", "bayesdamp.inference.", "bayesdamp.estimators.", "bayesdamp.records.")
"""Where functions keep what they made of plug-ins under the plug-ins' names."""

_EXTENDED: list[str] = []
_REGISTRIES: dict[str, Registry[Any]] = {}
_USED: list[PluginModule] = []


@dataclass(frozen=True)
class PluginModule:
    """A user's module that holds plug-ins, with its source, which goes to every process.

    file: as the user wrote it.
    """

    file: str
    source: str

    @property
    def digest(self) -> str:
        """SHA-256 of the source."""
        return hashlib.sha256(self.source.encode()).hexdigest()


@lru_cache(maxsize=2)
def _every_entry(path: tuple[str, ...]) -> Any:
    """Those of all packages that are installed on a path, which all have to be read for those of one group too."""
    del path
    return importlib.metadata.entry_points()


class Registry(Generic[T]):
    """Plug-ins of one kind: each module of `package` holds one, bound to the name `PLUGIN`.

    home: the package that holds the base class, by which a user's plug-in is known to be of this kind.
    """

    def __init__(self, package: str, kind: str, home: str | None = None) -> None:
        self.package = package
        self.kind = kind
        self.home = home or package
        self._added: dict[str, T] = {}
        self._sources: dict[str, str] = {}
        _REGISTRIES[package] = self

    def names(self) -> list[str]:
        """All names, sorted; nothing is imported."""
        return sorted({*self._modules, *self._added, *self._entries})

    def present(self) -> list[str]:
        """The names that ship or were asked for, without those that are merely installed; nothing is imported."""
        return sorted({*self._modules, *self._added})

    def added(self) -> list[str]:
        """The names that were asked for and do not ship; nothing is imported."""
        return sorted(self._added)

    @cached_property
    def _modules(self) -> dict[str, str]:
        """Name to module of what ships, in the package or in a folder of it."""
        path = importlib.import_module(self.package).__path__
        found = [m for m in pkgutil.walk_packages(path, f"{self.package}.") if not m.ispkg]
        names = {m.name.rpartition(".")[2]: m.name for m in found}
        return {name: module for name, module in names.items() if not name.startswith("_")}

    @cached_property
    def _entries(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Plug-ins of installed packages; a name that ships stays what it is."""
        group = GROUPS.get(self.package)
        found = _every_entry(tuple(sys.path)).select(group=group) if group else ()
        return {e.name: e for e in found if e.name not in self._modules}

    def ships(self, name: str) -> bool:
        """Whether a plug-in is the package's own."""
        return name in self._modules and name not in self._added

    def add(self, name: str, plugin: T, source: str | None = None) -> None:
        """Make a plug-in known that has no module in the package (a user's own).

        source: of its code; by default of its class, where that can be found. Raises InputError for a name that ships.
        """
        if name in self._modules:
            raise InputError(f"a {self.kind} {name!r} ships already; give it another name")
        self._added[name] = plugin
        self._sources[name] = _source_of(plugin) if source is None else source
        _EXTENDED.append(name)

    def remove(self, name: str) -> None:
        """Forget a plug-in that `add` made known."""
        self._added.pop(name, None)
        self._sources.pop(name, None)

    def get(self, name: str) -> T:
        """The plug-in of that name. Raises InputError with the nearest valid name."""
        if name in self._added:
            return self._added[name]
        if name in self._modules:
            return importlib.import_module(self._modules[name]).PLUGIN
        if name in self._entries:
            entry = self._entries[name]
            plugin, source = _installed(entry, self.kind)
            self.add(name, plugin, source)
            return plugin
        raise InputError(f"unknown {self.kind} {name!r}{nearest(name, self.names())}")

    def source(self, name: str) -> str:
        """A digest of the source of a plug-in: of one that ships with all that it imports of the package.

        Raises InputError where there is none of that name.
        """
        if name not in self._added and name in self._modules:
            return code_digest(self._modules[name])
        self.get(name)
        return hashlib.sha256(self._sources[name].encode()).hexdigest()


def sources_below(package: str) -> list[str]:
    """Digests of the sources of all plug-ins that are present, of the kinds whose packages are below this one."""
    found = sorted(p for p in _REGISTRIES if p.startswith(f"{package}."))
    return [_REGISTRIES[p].source(name) for p in found for name in _REGISTRIES[p].present()]


def read_modules(files: Iterable[str | Path], folder: Path | None = None) -> tuple[PluginModule, ...]:
    """Modules of plug-ins, read but not run. folder: where relative paths start; the working one by default.

    Raises InputError where one cannot be read.
    """
    found: list[PluginModule] = []
    for file in dict.fromkeys(str(f) for f in files):
        path = (folder or Path()) / at_home(Path(file))
        try:
            found.append(PluginModule(file, read_plain(path, "a Python file")))
        except InputError as error:
            raise InputError(f"plug-in {file}: {error}") from None
    return tuple(found)


def use(modules: Sequence[PluginModule]) -> None:
    """Have the plug-ins of these modules, and of no others, in this process.

    Raises InputError where a module cannot be run, or holds what is no plug-in.
    """
    if list(modules) == _USED:
        return
    if _USED:
        _forget()
    try:
        for module in modules:
            _USED.append(module)
            for registry, name, plugin in _plugins_of(module):
                registry.add(name, plugin, module.source)
    except BaseException:
        _forget()
        raise


def _forget() -> None:
    """Forget all modules' plug-ins, and what was made of them under their names."""
    sources = {module.source for module in _USED}
    for registry in _REGISTRIES.values():
        for name in [n for n, source in registry._sources.items() if source in sources]:
            registry.remove(name)
    _USED.clear()
    for one in gc.get_objects():
        # By type: asking an object for its class may run code of its own.
        if type(one) is functools._lru_cache_wrapper and (one.__module__ or "").startswith(_COMPILED):
            one.cache_clear()


def _plugins_of(module: PluginModule) -> list[tuple[Registry[Any], str, Any]]:
    loaded = _run(module)
    plugins = list(getattr(loaded, "PLUGINS", ()))
    plugins += [loaded.PLUGIN] if hasattr(loaded, "PLUGIN") else []
    where = f"plug-in {module.file}"
    if not plugins:
        raise InputError(f"{where}: holds neither PLUGIN nor PLUGINS; end it with PLUGIN = MyTerm()")
    found = []
    for plugin in plugins:
        if isinstance(plugin, type):
            raise InputError(
                f"{where}: {plugin.__name__} is a class; give one of its kind, {plugin.__name__}()"
            )
        registry, name = _registry_of(plugin, where), getattr(plugin, "name", None)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise InputError(
                f"{where}: the name of a {registry.kind} is {name!r}; it must be letters, digits and _"
            )
        if registry.ships(name):
            raise InputError(f"{where}: a {registry.kind} {name!r} ships already; give it another name")
        if (registry, name) in [(r, n) for r, n, _ in found] or name in registry._added:
            raise InputError(f"{where}: there is another {registry.kind} {name!r}; give it another name")
        found.append((registry, name, plugin))
    return found


def _registry_of(plugin: object, where: str) -> Registry[Any]:
    """The registry of the kind that a plug-in's classes are of."""
    homes = [cls.__module__ for cls in type(plugin).__mro__]
    for registry in sorted(_REGISTRIES.values(), key=lambda r: -len(r.home)):
        if any(home.startswith((f"{registry.home}.", f"{registry.package}.")) for home in homes):
            return registry
    raise InputError(
        f"{where}: PLUGIN is of type {type(plugin).__name__}, which is no plug-in; derive its class from one such as "
        "bayesdamp.physics.damping.DampingTerm"
    )


def _run(module: PluginModule) -> ModuleType:
    """Run a module's source under a name of its own, so that its classes can be pickled and traced."""
    name = f"bayesdamp_plugin_{module.digest[:12]}"
    loaded = ModuleType(name)
    loaded.__file__ = module.file
    linecache.cache[module.file] = (
        len(module.source), None, module.source.splitlines(keepends=True), module.file
    )  # fmt: skip
    sys.modules[name] = loaded
    try:
        exec(compile(module.source, module.file, "exec"), loaded.__dict__)
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(f"plug-in {module.file}, line {error.lineno}: {error.msg}; mend it there") from error
    except Exception as error:
        line = next((t.lineno for t in _frames(error) if t.filename == module.file), None)
        at, what = f", line {line}" if line else "", " ".join(str(error).split())
        raise InputError(
            f"plug-in {module.file}{at}: {type(error).__name__}: {what}; mend it there"
        ) from error
    return loaded


def _frames(error: Exception) -> list[inspect.FrameInfo]:
    return inspect.getinnerframes(error.__traceback__)[::-1] if error.__traceback__ else []


def _installed(entry: importlib.metadata.EntryPoint, kind: str) -> tuple[Any, str]:
    """The plug-in of an entry point (an instance, a class of one, or a module with PLUGIN) and its source."""
    try:
        found = entry.load()
    except Exception as error:
        what = " ".join(str(error).split())
        raise InputError(
            f"{kind} {entry.name!r}: its package cannot be loaded: {type(error).__name__}: {what}"
        ) from error
    found = found.PLUGIN if isinstance(found, ModuleType) else found
    plugin = found() if isinstance(found, type) else found
    if getattr(plugin, "name", entry.name) != entry.name:
        raise InputError(
            f"{kind} {entry.name!r}: calls itself {plugin.name!r}; its package must use one name for both"
        )
    return plugin, _source_of(plugin)


def _source_of(plugin: object) -> str:
    """The source of the module of a plug-in's class, of the class alone where it has no file, or its name."""
    cls = type(plugin)
    try:
        return inspect.getsource(sys.modules[cls.__module__])
    except (OSError, TypeError, KeyError):
        return cls.__qualname__


def extended() -> bool:
    """Whether this process has had a plug-in that is not in the package."""
    return bool(_EXTENDED)


def nearest(name: str, valid: list[str]) -> str:
    """A clause that names the nearest valid name, or all of them."""
    close = get_close_matches(name, valid, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else f"; valid are {', '.join(valid)}"
