"""Files written in one step, as bytes or as JSON."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bayesdamp.store import folders
from bayesdamp.store.beside import beside


def write_bytes(path: Path, content: bytes) -> None:
    """Replace a file in one step, and only once the content is on the disk. Creates the folders above it.

    Raises InputError where something else than a regular file has the name.
    """
    path = Path(path)
    folders.refuse_special(path)
    with beside(path, content) as partial:
        os.replace(partial, path)


def write_json(path: Path, obj: object) -> None:
    """Write strict, indented JSON in one step; nan becomes null, infinities the words "inf" and "-inf"."""
    text = json.dumps(_strict(obj), indent=2, ensure_ascii=False, allow_nan=False)
    write_bytes(path, (text + "\n").encode())


def _strict(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(k): _strict(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(v) for v in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None if math.isnan(value) else str(float(value))
    return _strict(plain(value))


def plain(value: object) -> object:
    """A NumPy scalar or array, or a path, as JSON can hold it."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a cell's meta cannot hold a {type(value).__name__}")
