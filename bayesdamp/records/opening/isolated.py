"""Foreign readers in a process of their own: a damaged file may crash one, and takes nothing else with it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

import numpy as np

from bayesdamp.types import InputError

PATIENCE = 300.0
"""Seconds after which a reader that does not end is ended."""
_CHILD = """
import json, sys
module, function, path, out, options, sys.path[:] = json.loads(sys.argv[1])
from bayesdamp.records.opening.isolated import serve
serve(module, function, path, out, options)
"""


def load_isolated(
    load: Callable[..., Mapping[str, np.ndarray]],
    path: Path,
    patience: float = PATIENCE,
    **options: float | str,
) -> dict[str, np.ndarray]:
    """What a loader makes of a file, run in a child process: arrays by name.

    load: a function at the top level of a module that is quick to import, of the path and the options; its arrays hold
    numbers. patience: in s.
    Raises InputError, one line, where the loader does, and where it crashes, fails otherwise or does not end.
    """
    with tempfile.TemporaryDirectory(prefix="bayesdamp-") as folder:
        out = Path(folder)
        given = json.dumps(
            [load.__module__, load.__qualname__, str(path.resolve()), folder, options, sys.path]
        )
        try:
            done = subprocess.run(
                [sys.executable, "-c", _CHILD, given],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=patience,
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"its reader did not end within {patience:g} s; {_AGAIN}", path.name) from None
        if not (out / "names.json").is_file():
            raise InputError(f"{_end(done.returncode, done.stderr)}; {_AGAIN}", path.name)
        said = json.loads((out / "names.json").read_text(encoding="utf-8"))
        if "error" in said:
            raise InputError(**said["error"])
        return {name: np.load(out / f"{i}.npy", allow_pickle=False) for i, name in enumerate(said["names"])}


_AGAIN = "the file is damaged or of another kind: save it again, or export it as text"


def _end(code: int, complaint: bytes) -> str:
    """How a child ended that left nothing, in words."""
    if code < 0:
        try:
            return f"its reader crashed ({signal.Signals(-code).name})"
        except ValueError:
            return f"its reader crashed (signal {-code})"
    lines = complaint.decode(errors="replace").strip().splitlines()
    return f"cannot be read ({lines[-1] if lines else f'status {code}'})"


def serve(module: str, function: str, path: str, out: str, options: Mapping[str, float | str]) -> None:
    """The child's part: load, and leave the arrays in a folder, or the line that says why there are none."""
    folder = Path(out)
    try:
        found = getattr(import_module(module), function)(Path(path), **options)
    except InputError as error:
        said: dict[str, object] = {"error": vars(error)}
    else:
        for i, array in enumerate(found.values()):
            np.save(folder / f"{i}.npy", array, allow_pickle=False)
        said = {"names": list(found)}
    (folder / "names.json").write_text(json.dumps(said), encoding="utf-8")
