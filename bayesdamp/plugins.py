"""Find plug-ins by name: in the package, in a user's modules, or among entry points of installed packages.

A shipped or installed plug-in is imported when it is first requested by its name; a user's module is run at once.
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
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from bayesdamp.plain_text import at_home, read_plain
from bayesdamp.sources import code_digest
from bayesdamp.types import InputError

T = TypeVar("T")

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_COMPILED = ("bayesdamp.physics.", "bayesdamp.inference.", "bayesdamp.estimators.", "bayesdamp.records.")
"""Prefixes of modules whose `lru_cache` functions may have stored results under the name of a plug-in. These caches are
cleared when a user's plug-ins change, because the same name may then be another plug-in."""

_EXTENDED: list[str] = []
"""Names of all plug-ins, other than the shipped ones, that were ever added in this process."""
_REGISTRIES: dict[str, Registry[Any]] = {}
"""The registry of each kind of plug-in, by the name of the package that contains the shipped plug-ins of this kind."""
_USED: list[PluginModule] = []
"""The user's modules whose plug-ins are registered."""


@dataclass(frozen=True)
class PluginModule:
    """A user's Python file with plug-ins, which it assigns to `PLUGIN` (one) or `PLUGINS` (several).

    Its source is sent to every process. file: path as the user wrote it. source: the Python code in the file.
    """

    file: str
    source: str

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the source."""
        return hashlib.sha256(self.source.encode()).hexdigest()


class Plugin:
    """Base class of plug-ins. One that ships with bayesdamp has the name of its file; others must have a `name`."""

    name: str

    def __init_subclass__(cls) -> None:
        """Set the name of a plug-in that ships with bayesdamp."""
        super().__init_subclass__()
        package, _, file = cls.__module__.rpartition(".")
        if package in _REGISTRIES:
            cls.name = file


class Registry(Generic[T]):
    """The plug-ins of one kind, such as damping terms, by name.

    package: the package with the shipped plug-ins. Each of its modules contains one, which has the name of the module
    and is assigned to `PLUGIN`, except modules whose names begin with _. kind: what the plug-ins are called in
    messages. home: package of the base class of these plug-ins, by default `package`; a user's plug-in is of this kind
    if its class is derived from a class in one of the two packages.
    """

    def __init__(self, package: str, kind: str, home: str | None = None) -> None:
        self.package = package
        self.kind = kind
        self.home = home or package
        self._added: dict[str, T] = {}
        self._sources: dict[str, str] = {}
        _REGISTRIES[package] = self

    def names(self) -> list[str]:
        """Return the names of all plug-ins, sorted: shipped, added, or in installed packages. Nothing is imported."""
        return sorted({*self._modules, *self._added, *self._entries})

    def present(self) -> list[str]:
        """Return the names of shipped and added plug-ins, sorted; nothing is imported.

        A plug-in of an installed package counts as added as soon as `get` has been called for it.
        """
        return sorted({*self._modules, *self._added})

    def added(self) -> list[str]:
        """Return the names of the plug-ins that a user added, sorted; none of them ships with bayesdamp.

        A plug-in of an installed package counts as added as soon as `get` has been called for it.
        """
        return sorted(self._added)

    @functools.cached_property
    def _modules(self) -> dict[str, str]:
        """Return the full module name of each plug-in that ships with bayesdamp, by the name of the plug-in."""
        path = importlib.import_module(self.package).__path__
        modules = [m.name for m in pkgutil.walk_packages(path, f"{self.package}.") if not m.ispkg]
        return {m.rpartition(".")[2]: m for m in modules if "._" not in m}

    @functools.cached_property
    def _entries(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Return the entry points of installed packages, by name.

        Entry points with the name of a shipped plug-in are left out. Their group is `bayesdamp.` and the last name of
        the registry's package (apart from `methods`), such as `bayesdamp.damping`.
        """
        group = f"bayesdamp.{self.package.removesuffix('.methods').rpartition('.')[2]}"
        entries = _entry_points(tuple(sys.path)).select(group=group)
        return {e.name: e for e in entries if e.name not in self._modules}

    def ships(self, name: str) -> bool:
        """Return whether a plug-in of this name ships with bayesdamp; False for an unknown name."""
        return name in self._modules

    def add(self, name: str, plugin: T, source: str | None = None) -> None:
        """Add a user's plug-in under a name; it replaces an added one with the same name.

        source: its source code, of which `source` returns the digest. By default this is the source of the module of
        its class, or the name of the class if it has no file. Raises InputError if a plug-in with this name ships with
        bayesdamp.
        """
        if name in self._modules:
            raise InputError(f"a {self.kind} {name!r} ships with bayesdamp; give yours another name")
        if source is None:
            cls = type(plugin)
            try:
                source = inspect.getsource(sys.modules[cls.__module__])
            except (OSError, TypeError, KeyError):  # a class without a file
                source = cls.__qualname__
        self._added[name], self._sources[name] = plugin, source
        _EXTENDED.append(name)

    def remove(self, name: str) -> None:
        """Remove a plug-in that a user added; do nothing for other names, also those of shipped plug-ins."""
        self._added.pop(name, None)
        self._sources.pop(name, None)

    def get(self, name: str, where: str = "") -> T:
        """Return the plug-in with a name; import it, or add it from an installed package, if necessary.

        Raises InputError, with a similar valid name, if there is none; its message begins with `where`. Also raises
        InputError if the installed package cannot be loaded or gives the plug-in another name.
        """
        if name in self._added:
            return self._added[name]
        if name in self._modules:
            return importlib.import_module(self._modules[name]).PLUGIN
        if name in self._entries:
            plugin = _load_entry(self._entries[name], self.kind)
            self.add(name, plugin)
            return plugin
        raise InputError(f"unknown {self.kind} {name!r}{nearest(name, self.names())}", where)

    def source(self, name: str) -> str:
        """Return the SHA-256 of a plug-in's source code, which is part of the keys of stored results.

        For a shipped plug-in, the sources of the modules that it imports, at any depth, are included; for any other it
        is the source that `add` got. Raises InputError for an unknown name.
        """
        if name in self._modules:
            return code_digest(self._modules[name])
        self.get(name)
        return hashlib.sha256(self._sources[name].encode()).hexdigest()


def sources_below(package: str) -> list[str]:
    """Return the SHA-256 of the source of each shipped or added plug-in whose kind belongs to a package.

    A kind belongs to the package if the package of its shipped plug-ins is below it. Plug-ins of installed packages
    that were not used yet are left out.
    """
    registries = [_REGISTRIES[p] for p in sorted(_REGISTRIES) if p.startswith(f"{package}.")]
    return [registry.source(name) for registry in registries for name in registry.present()]


def read_modules(files: Iterable[str | Path], folder: Path | None = None) -> tuple[PluginModule, ...]:
    """Read a user's files of plug-ins, without running them; return them in the order of `files`, each file once.

    folder: folder to which relative paths refer; by default the working folder. Raises InputError if a file cannot be
    read.
    """
    modules: list[PluginModule] = []
    for file in dict.fromkeys(str(f) for f in files):
        path = (folder or Path()) / at_home(Path(file))
        try:
            modules.append(PluginModule(file, read_plain(path, "a Python file")))
        except InputError as error:
            raise InputError(f"plug-in {file}: {error}") from None
    return tuple(modules)


def use_modules(modules: Sequence[PluginModule]) -> None:
    """Register the plug-ins of these modules in this process, and remove those of all other user modules.

    Plug-ins of installed packages, and those added by `Registry.add`, stay. Raises InputError if a module cannot be run
    or does not contain valid plug-ins; then none of the modules is registered.
    """
    if list(modules) == _USED:
        return
    if _USED:
        _forget()
    try:
        for module in modules:
            _USED.append(module)
            loaded = _run(module)
            single = [loaded.PLUGIN] if hasattr(loaded, "PLUGIN") else []
            plugins = [*getattr(loaded, "PLUGINS", ()), *single]
            if not plugins:
                what = "contains neither PLUGIN nor PLUGINS; end it with PLUGIN = MyTerm()"
                raise InputError(what, f"plug-in {module.file}")
            for plugin in plugins:
                _register(plugin, module)
    except BaseException:
        _forget()
        raise


def _register(plugin: Any, module: PluginModule) -> None:
    """Register a plug-in of a user's module.

    Raises InputError if it is a class instead of an instance, if its class is not derived from a base class of
    plug-ins, if its name has other characters than letters, digits and _, or if another plug-in of its kind has this
    name.
    """
    where = f"plug-in {module.file}"
    if isinstance(plugin, type):
        raise InputError(f"{plugin.__name__} is a class; give an instance, {plugin.__name__}()", where)
    homes = [f"{cls.__module__}." for cls in type(plugin).__mro__]
    registries = sorted(_REGISTRIES.values(), key=lambda r: -len(r.home))
    registry = next(
        (r for r in registries if any(h.startswith((f"{r.home}.", f"{r.package}.")) for h in homes)), None
    )
    if registry is None:
        raise InputError(
            f"PLUGIN is of type {type(plugin).__name__}, which is not a plug-in; derive its class from a base class "
            "such as bayesdamp.physics.damping.DampingTerm",
            where,
        )
    name = getattr(plugin, "name", None)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise InputError(
            f"the name of a {registry.kind} is {name!r}; it must consist of letters, digits and _", where
        )
    if registry.ships(name):
        raise InputError(f"the {registry.kind} {name!r} ships with bayesdamp; give yours another name", where)
    if name in registry.added():
        raise InputError(
            f"two plug-ins add the {registry.kind} {name!r}; give one of them another name", where
        )
    registry.add(name, plugin, module.source)


def _forget() -> None:
    """Unregister the plug-ins of all user modules, and clear caches that may contain results under their names."""
    sources = {module.source for module in _USED}
    for registry in _REGISTRIES.values():
        for name in [n for n, source in registry._sources.items() if source in sources]:
            registry.remove(name)
    _USED.clear()
    for value in gc.get_objects():
        # Compare types, because isinstance may run code of the object.
        if type(value) is functools._lru_cache_wrapper and (value.__module__ or "").startswith(_COMPILED):
            value.cache_clear()


def _run(module: PluginModule) -> ModuleType:
    """Run the source of a module and return the module. Raises InputError, with the line, if it fails.

    The module is registered in `sys.modules`, so that its classes can be pickled.
    """
    name = f"bayesdamp_plugin_{module.digest[:12]}"
    loaded = ModuleType(name)
    loaded.__file__ = module.file
    lines = module.source.splitlines(keepends=True)
    linecache.cache[module.file] = (len(module.source), None, lines, module.file)
    sys.modules[name] = loaded
    try:
        exec(compile(module.source, module.file, "exec"), loaded.__dict__)
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(
            f"{error.msg}; correct it there", f"plug-in {module.file}", f"line {error.lineno}"
        ) from error
    except Exception as error:
        frames = inspect.getinnerframes(error.__traceback__)[::-1] if error.__traceback__ else []
        at = next((f"line {frame.lineno}" for frame in frames if frame.filename == module.file), "")
        raise InputError(f"{_in_one_line(error)}; correct it there", f"plug-in {module.file}", at) from error
    return loaded


def _in_one_line(error: Exception) -> str:
    """Return the type and the message of an exception as one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


@functools.lru_cache(maxsize=2)
def _entry_points(path: tuple[str, ...]) -> Any:
    """Return the entry points of all installed packages on `path`.

    path: `sys.path`; it serves only as the key of the cache. Reading a single group would take as long as reading all.
    """
    del path
    return importlib.metadata.entry_points()


def _load_entry(entry: importlib.metadata.EntryPoint, kind: str) -> Any:
    """Return the plug-in of an entry point, which may be an instance, a class, or a module with PLUGIN.

    Raises InputError if its package cannot be loaded, if a module has no PLUGIN, if a class cannot be called without
    arguments, or if the plug-in has another name than the entry point.
    """
    try:
        value = entry.load()
        value = value.PLUGIN if isinstance(value, ModuleType) else value
        plugin = value() if isinstance(value, type) else value
    except Exception as error:
        what = f"its package cannot be loaded: {_in_one_line(error)}"
        raise InputError(f"{kind} {entry.name!r}: {what}") from error
    if getattr(plugin, "name", entry.name) != entry.name:
        what = f"its own name is {plugin.name!r}; its package must use the same name for both"
        raise InputError(f"{kind} {entry.name!r}: {what}")
    return plugin


def has_added_plugins() -> bool:
    """Return whether a plug-in that does not ship has ever been added in this process."""
    return bool(_EXTENDED)


def nearest(name: object, valid: list[str]) -> str:
    """Return a clause for the end of an error message, such as "; did you mean 'viscous'?", with the most similar name.

    If no name in `valid` is similar to `name`, the clause lists all of them.
    """
    close = get_close_matches(str(name), valid, n=1, cutoff=0.6)
    return f"; did you mean {close[0]!r}?" if close else f"; valid are {', '.join(valid)}"
