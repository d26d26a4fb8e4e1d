"""Compiled programs that outlive their process.

Tracing a program takes as long as loading it: where a folder is set, what a trace gave is kept there as JAX exports
it, under a digest of everything that it depends on, and the next process starts from that.
"""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from bayesdamp.numerics.lazily import jax
from bayesdamp.plugins import extended

_FAILURES = (OSError, ValueError, NotImplementedError, RuntimeError, TypeError)
"""What comes of a program that cannot be exported, or of a folder that cannot be written."""
_MARK = hashlib.sha256().digest_size
PATIENCE = 120.0
"""Seconds for which one process waits for another's program before it makes its own."""


class _Kept:
    """Where programs are kept; nowhere until `keep_in`."""

    folder: Path | None = None


def keep_in(folder: Path | None) -> None:
    """Keep traced programs in a folder, shared by all runs; None for no longer."""
    _Kept.folder = folder


class Program:
    """`jax.jit(function)`, its traces kept.

    function: of pure arrays and of trees of these; name: what it is called; made_of: all else that it depends on,
    of which the text says all, such as a layout. Its own code is the package's; where a user has added a plug-in,
    of which a name says too little, nothing is kept.
    """

    def __init__(self, function: Callable[..., Any], name: str, *made_of: object) -> None:
        self.name, self.made_of = name, made_of
        self._function = function
        self._traced = jax.jit(function)
        self._loaded: dict[Any, Callable[..., Any]] = {}

    def __call__(self, *args: Any) -> Any:
        """What the function gives; by the stored program where there is one for arguments of these shapes."""
        from jax.core import Tracer

        leaves, tree = jax.tree.flatten(args)
        if _Kept.folder is None or extended() or any(isinstance(leaf, Tracer) for leaf in leaves):
            return self._traced(*args)
        leaves = [leaf if hasattr(leaf, "dtype") else np.asarray(leaf) for leaf in leaves]
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        if (tree, shapes) not in self._loaded:
            self._loaded[tree, shapes] = self._load(_Kept.folder, leaves, tree, shapes)
        return self._loaded[tree, shapes](*leaves)

    def _load(self, folder: Path, leaves: list[Any], tree: Any, shapes: object) -> Callable[..., Any]:
        """The program for arguments of these shapes: from its file, or traced and written."""

        def flat(*values: Any) -> Any:
            return self._function(*jax.tree.unflatten(tree, values))

        text = repr((self.name, self.made_of, str(tree), shapes))
        from jax import export

        path = folder / f"{hashlib.sha256((_here() + text).encode()).hexdigest()[:32]}.jax"
        if (kept := _kept(path)) is not None:
            return kept
        with _alone(path.with_suffix(".lock")):
            if (kept := _kept(path)) is not None:
                return kept
            try:
                content = bytes(export.export(jax.jit(flat))(*leaves).serialize())
                # As every later process has it: what was traced a moment ago may be compiled to other sums.
                program = _called(content)
                program.lower(*leaves).compile()  # now, so that whoever waits finds it in JAX's own cache
                _write(path, content)
            except _FAILURES:
                return jax.jit(flat)
            return program


def _kept(path: Path) -> Callable[..., Any] | None:
    """The program of a file, or None."""
    content = _read(path)
    return None if content is None else _called(content)


def _called(content: bytes) -> Any:
    from jax import export

    return jax.jit(export.deserialize(bytearray(content)).call)


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """Only one process at a time; all at once where the folder cannot be written or the wait is long."""
    lock = FileLock(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire(timeout=PATIENCE)
    except (OSError, NotImplementedError, Timeout):
        yield
        return
    try:
        yield
        # Nobody needs it any more: whoever comes now finds the program.
        path.unlink(missing_ok=True)
    finally:
        lock.release()


@cache
def _here() -> str:
    """All that programs depend on beside their name: the package's code and JAX."""
    package = Path(__file__).parents[1]
    found = hashlib.sha256(f"{version('jax')} {version('jaxlib')}".encode())
    for path in sorted(package.rglob("*.py")):
        found.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return found.hexdigest()


def _read(path: Path) -> bytes | None:
    """What `_write` wrote; None where there is no such file, or it is not whole."""
    try:
        found = path.read_bytes()
    except OSError:
        return None
    mark, content = found[:_MARK], found[_MARK:]
    return content if hashlib.sha256(content).digest() == mark else None


def _write(path: Path, content: bytes) -> None:
    """In one step, as other processes read the folder, and with a digest in front."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{uuid.uuid4().hex}.tmp")
    partial.write_bytes(hashlib.sha256(content).digest() + content)
    os.replace(partial, path)
