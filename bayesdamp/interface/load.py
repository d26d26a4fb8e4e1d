"""Reading back whatever was saved."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from bayesdamp.interface.parts.result import read
from bayesdamp.plugins import nearest
from bayesdamp.types import InputError

KINDS = (
    "Record", "Signal", "Model", "Estimate", "Fit", "Posterior", "Evidence", "Comparison", "Prediction",
)  # fmt: skip
"""The public names of the results that are saved."""


def load(path: str | Path) -> Any:
    """The result that `save` wrote to a file, a verdict in JSON, or the run in a folder, whichever it is.

    A class's own `load`, such as `Fit.load(path)`, is the same with a type. Raises InputError where it is none of them.
    """
    path = Path(path)
    if path.is_dir():
        return import_module("bayesdamp").Run.load(path)
    if path.suffix == ".json":
        from bayesdamp.verdict.types import Verdict

        return Verdict.load(path)

    def class_of(kind: str) -> Any:
        if kind not in KINDS:
            raise InputError(f"{path}: holds a {kind!r}, which is not known here{nearest(kind, list(KINDS))}")
        return getattr(import_module("bayesdamp"), kind)

    return read(path, class_of)
