"""Run foreign readers in a process of their own: a damaged file may crash one, and takes nothing else with it."""

from __future__ import annotations

import json
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from bayesdamp.types import InputError

Loaded = TypeVar("Loaded")
PATIENCE = 300.0
"""Seconds after which a reader that has not finished is stopped."""
_AGAIN = "the file is damaged or of another kind: save it again, or export it as text"
_CHILD = """
import json, pickle, sys
from importlib import import_module
from pathlib import Path
module, function, path, out, options, sys.path[:] = json.loads(sys.argv[1])
from bayesdamp.types import InputError
try:
    result = getattr(import_module(module), function)(Path(path), **options)
except InputError as error:
    result = error
Path(out).write_bytes(pickle.dumps(result))
"""


def load_isolated(
    load: Callable[..., Loaded], path: Path, patience: float = PATIENCE, **options: float | str
) -> Loaded:
    """Load a file in a child process.

    load: a function at the top level of a module that is quick to import, of the path and the options. patience: in s.
    Raises InputError, one line, where the loader does, and where it crashes, fails otherwise or does not end.
    """
    with tempfile.TemporaryDirectory(prefix="bayesdamp-") as folder:
        out = Path(folder) / "result"
        given = json.dumps(
            [load.__module__, load.__qualname__, str(path.resolve()), str(out), options, sys.path]
        )
        try:
            child = subprocess.run(
                [sys.executable, "-c", _CHILD, given],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=patience,
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"its reader did not end within {patience:g} s; {_AGAIN}", path.name) from None
        if child.returncode == 0 and out.is_file():
            result = pickle.loads(out.read_bytes())
            if isinstance(result, InputError):
                raise result
            return result
    if child.returncode < 0:
        names = {number.value: number.name for number in signal.Signals}
        end = f"its reader crashed ({names.get(-child.returncode, f'signal {-child.returncode}')})"
    else:
        lines = child.stderr.decode(errors="replace").strip().splitlines()
        end = f"cannot be read ({lines[-1] if lines else f'status {child.returncode}'})"
    raise InputError(f"{end}; {_AGAIN}", path.name)
