"""MATLAB and NumPy files: arrays that are found by a path with dots."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.plugins import nearest
from bayesdamp.signals.isolated import load_isolated
from bayesdamp.signals.text import Loaded
from bayesdamp.types import InputError


def from_arrays(path: Path, time: str | int | None, value: str | int | None, no_time: bool) -> Loaded:
    """(times or None, values, row of each, provenance) of a .mat, .npy or .npz file; raises InputError."""
    where = path.name
    kind = {".mat": "MATLAB", ".npz": "NumPy archive", ".npy": "NumPy array"}[path.suffix.lower()]
    found = named_arrays(path)
    if time is None and not no_time:
        raise InputError(
            f"{where}: no time given: name the time array or give rate in Hz; it holds {_list(found)}"
        )
    if value is None:
        left = [name for name in found if name != str(time).strip()]
        if len(left) != 1:
            raise InputError(f"{where}: name the array of the recorded quantity; it holds {_list(found)}")
        value = left[0]
    y = _pick(found, value, where)
    t = None if no_time or time is None else _pick(found, time, where)
    if t is not None and t.size != y.size:
        raise InputError(f"{where}: {str(time)!r} has {t.size} samples, {str(value)!r} has {y.size}")
    provenance: dict[str, object] = {
        "file": where,
        "format": kind,
        "time_column": None if t is None else str(time),
        "value_column": str(value),
        "incomplete_rows": 0,
        "notes": [],
    }
    return t, y, np.arange(y.size), provenance


def named_arrays(path: Path) -> dict[str, np.ndarray]:
    """The vectors in a file by name; a matrix gives its columns, numbered from 1. Raises InputError."""
    found = _matlab(path) if path.suffix.lower() == ".mat" else _numpy(path)
    if not found:
        raise InputError(f"{path.name}: no numeric array of numbers in it")
    return found


def _list(found: dict[str, np.ndarray]) -> str:
    names = list(found)
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _pick(found: dict[str, np.ndarray], name: str | int, where: str) -> np.ndarray:
    key = str(name).strip()
    if key not in found:
        hint = nearest(key, list(found)) if len(found) <= 12 else f"; it holds {_list(found)}"
        raise InputError(f"{where}: unknown array {key!r}{hint}")
    return found[key]


def _add(found: dict[str, np.ndarray], path: str, item: Any) -> None:
    """Put every vector under item into found; a matrix gives its columns, numbered from 1."""
    if isinstance(item, dict):
        for key, below in item.items():
            if not str(key).startswith("__"):
                _add(found, f"{path}.{key}" if path else str(key), below)
        return
    array: Any = np.asarray(item) if isinstance(item, np.ndarray | list) else np.empty(0)
    if array.dtype.names:
        for key in array.dtype.names:
            _add(found, f"{path}.{key}" if path else str(key), array[key])
    elif array.dtype.kind in "fiub" and array.size > 1:
        array = np.squeeze(array)
        if array.ndim == 1:
            found[path or "1"] = array.astype(float)
        elif array.ndim == 2:
            table = array if array.shape[0] >= array.shape[1] else array.T
            for i in range(table.shape[1] if table.shape[1] <= 64 else 0):
                found[f"{path}.{i + 1}" if path else str(i + 1)] = table[:, i].astype(float)


def _numpy(path: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    try:
        data = np.load(path, allow_pickle=False)
        if isinstance(data, np.ndarray):
            _add(found, "", data)
        else:
            with data:
                for key in data.files:
                    _add(found, key, data[key])
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path.name}: not a readable NumPy file ({str(error).splitlines()[0]})") from None
    return found


def _matlab(path: Path) -> dict[str, np.ndarray]:
    stat = path.stat()
    return dict(_isolated(path.resolve(), stat.st_mtime_ns, stat.st_size))


@lru_cache(maxsize=2)
def _isolated(path: Path, *_state: int) -> dict[str, np.ndarray]:
    """Its columns are looked up before it is read: one child does for both."""
    return load_isolated(from_matlab, path)


def from_matlab(path: Path) -> dict[str, np.ndarray]:
    """The numeric arrays of a MATLAB file, in this process. Raises InputError."""
    from scipy.io import loadmat  # imports slowly, and few records need it
    from scipy.io.matlab import MatReadError

    found: dict[str, np.ndarray] = {}
    with path.open("rb") as file:
        head = file.read(128)
    if b"MATLAB 7.3" in head or head.startswith(b"\x89HDF"):
        _hdf(path, found)
        return found
    try:
        data = loadmat(path, simplify_cells=True)
    except (MatReadError, ValueError, TypeError, NotImplementedError, EOFError) as error:
        raise InputError(f"{path.name}: not a readable MATLAB file ({str(error).splitlines()[0]})") from None
    _add(found, "", {key: item for key, item in data.items() if not key.startswith("__")})
    return found


def _hdf(path: Path, found: dict[str, np.ndarray]) -> None:
    """The datasets of a MATLAB 7.3 file, which is HDF5."""
    try:
        import h5py
    except ImportError:
        raise InputError(f"{path.name}: a MATLAB 7.3 file; install h5py, or save it with -v7") from None

    def visit(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and not name.startswith("#"):
            _add(found, name.replace("/", "."), np.asarray(item[()]).T)

    with h5py.File(path, "r") as file:
        file.visititems(visit)
