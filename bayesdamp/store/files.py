"""Write and read files of bytes, JSON, arrays or tables, and define the columns of the tables of a run.

Each file is written in one step: a failed write leaves no partial file.
"""

from __future__ import annotations

import csv
import errno
import io
import json
import math
import os
import re
import struct
import sys
import uuid
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bayesdamp.serial import split
from bayesdamp.types import InputError

if TYPE_CHECKING:
    import xarray as xr


SCHEMA = 2
"""Version number of the columns of all tables, written to run.json. It increases when a column is renamed, removed or
redefined."""
READ_ERRORS = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, KeyError, ValueError, TypeError, AttributeError,
    NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip
"""Exceptions that reading a zip archive can raise if it is damaged or truncated, or if another program wrote it."""
TEMPORARY_NAME = re.compile(r"\.bayesdamp-[0-9a-f]{32}\.tmp")
"""Pattern of the names of temporary files. A file is first written under such a name, and renamed when it is
complete."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})


def temporary_path(path: Path) -> Path:
    """Return a path with a random name in the folder of `path`, for writing a file before it is renamed to `path`."""
    return path.with_name(f".bayesdamp-{uuid.uuid4().hex}.tmp")


def is_disk_full(error: BaseException) -> bool:
    """Return whether an error means that the disk cannot store the file that was to be written.

    The disk is full or read-only, a quota is exhausted, or the file is too large for the system.
    """
    return isinstance(error, OSError) and error.errno in _NO_ROOM


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Replace the file name in any OSError within this context by `path`.

    Otherwise the error for a full disk would name no file, or only the temporary one. An OSError without an error
    number is not changed.
    """
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def refuse_special(path: Path) -> None:
    """Raise InputError if a path exists but is not a regular file, or if it is a link."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        kind = "a link" if path.is_symlink() else "a folder" if path.is_dir() else "a device"
        raise InputError(f"{path}: is {kind} and is not replaced; give a regular file or a new file's name")


def write_bytes(path: Path, content: bytes) -> None:
    """Write or replace a file, completely or not at all. Missing folders are created.

    The content is written to a temporary file, which is then renamed.
    Raises InputError if the path exists but is not a regular file, and OSError if it cannot be written.
    """
    path = Path(path)
    refuse_special(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = temporary_path(path)
    try:
        with name_in_errors(path):
            with partial.open("xb") as handle:
                handle.write(content)
                handle.flush()
                os.fsync(handle.fileno())
            os.replace(partial, path)
    except BaseException:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def save_bytes(path: str | Path, content: bytes) -> Path:
    """Write a file with `write_bytes` and return its path. Raises InputError if that fails."""
    path = Path(path)
    try:
        write_bytes(path, content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def netcdf_bytes(tree: xr.DataTree) -> bytes:
    """Return the bytes of a netCDF file that contains a tree of datasets.

    The file is built in memory and not on the disk, because HDF5 crashes the process if the disk is full.
    """
    content = io.BytesIO()
    # On a Dask worker xarray would lock the file by its name, which a file in memory does not have.
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        tree.to_netcdf(content, engine="h5netcdf")
    return content.getvalue()


def write_json(path: Path, obj: object) -> None:
    """Write a value to a file as strict, indented JSON; nan becomes null, infinities become "inf" and "-inf".

    The value is first converted by `serial.split`: dataclasses become objects, arrays become lists. The file is written
    by `write_bytes`.
    """
    text = json.dumps(_strict(split(obj)), indent=2, ensure_ascii=False, allow_nan=False)
    write_bytes(path, (text + "\n").encode())


def _strict(value: object) -> object:
    """Return a JSON value with nan replaced by None, and infinities by "inf" and "-inf"."""
    if isinstance(value, dict):
        return {k: _strict(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_strict(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def pack(
    first: str,
    head: Mapping[str, object],
    arrays: Mapping[str, np.ndarray],
    compression: int = zipfile.ZIP_STORED,
) -> bytes:
    """Return the bytes of a zip archive that contains values and arrays, and that `unpack` can read.

    Its first member, named `first`, contains the values `head` and the names of the arrays as JSON. The arrays follow
    in the format .npy. compression: a constant of `zipfile`; by default the archive is not compressed.
    """
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        archive.writestr(first, json.dumps(split({**head, "arrays": list(arrays)})))
        for i, array in enumerate(arrays.values()):
            with archive.open(f"{i}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)  # type: ignore[arg-type]
    return buffer.getvalue()


def unpack(path: Path, first: str, *, arrays: bool = True) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return the values and the arrays (by name) in a zip archive that `pack` made; no arrays if `arrays` is false.

    first: name of the member with the values. Among the values is also the list `arrays` of the names of all arrays.
    Raises one of `READ_ERRORS` if the file is missing, damaged or not such an archive.
    """
    with zipfile.ZipFile(path) as archive:
        head = json.loads(archive.read(first))
        if not arrays:
            return head, {}
        # Each member is read completely: only then is its checksum verified.
        return head, {
            label: np.lib.format.read_array(io.BytesIO(archive.read(f"{i}.npy")), allow_pickle=False)
            for i, label in enumerate(head["arrays"])
        }


def read_description(folder: Path) -> dict[str, Any]:
    """Return the content of the run.json in the folder of a run; any key may be missing.

    Raises InputError if there is no such file, if it is not a JSON object, or if it states another version of the
    tables than `SCHEMA`.
    """
    path = folder / "run.json"
    if not path.is_file():
        raise InputError(
            f"{folder}: does not contain run.json; give the folder of a run, such as reports/<name>"
        )
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); run the study again") from fault
    if not isinstance(description, dict):
        raise InputError(f"{path}: does not describe a run; run the study again")
    if description.get("schema", SCHEMA) != SCHEMA:
        raise InputError(f"{path}: was written by another version of bayesdamp; run the study again")
    return description


TABLES: dict[str, tuple[str, ...]] = {
    "estimates.csv": (
        "signal", "repeat", "model", "restoring", "estimator", "stage", "parameter", "unit", "value", "stderr", "truth",
        "error_pct", "evaluations", "seconds", "outcome",
    ),
    "posteriors.csv": (
        "signal", "repeat", "model", "restoring", "sampler", "deviation", "parameter", "unit", "mean", "sd",
        "sd_noise", "sd_law", "median", "q2.5", "q25", "q75", "q97.5", "hdi_low", "hdi_high", "ess_bulk", "ess_tail",
        "rhat", "divergences", "seconds", "outcome",
    ),
    "evidence.csv": (
        "signal", "repeat", "model", "restoring", "method", "deviation", "log_evidence", "stderr", "log_bayes_factor",
        "probability", "diagnostic", "outcome",
    ),
    "fits.csv": (
        "signal", "repeat", "model", "restoring", "rms", "rms_unit", "residual_autocorrelation",
        "window_spread", "predictive_p", "deviation", "deviation_low", "deviation_high", "unexplained_pct", "verdict",
    ),
}  # fmt: skip
"""Columns of the tables of every study, by file name. All intervals are 95 %. log_evidence, its stderr and
log_bayes_factor are in nats, error_pct and unexplained_pct in per cent, seconds in s. The column `unit` has the unit of
the values of a parameter, `rms_unit` that of rms."""

POPULATION = (
    "model", "restoring", "parameter", "unit", "specimens", "mean", "mean_low", "mean_high", "spread", "spread_low",
    "spread_high", "next_low", "next_high",
)  # fmt: skip
"""Columns of population.csv, which is written if a study has several specimens (tested objects). Each row has the mean
and the spread of one damping coefficient over the specimens, and the interval for one more specimen (95 %)."""
DAMPING_CURVES = ("amplitude", "ratio", "ratio_low", "ratio_high", "lost", "lost_low", "lost_high")
"""Columns of damping_curves.csv that follow the record's name and the unit of the amplitude. The curves are measured
without assuming a damping law: damping ratio (a fraction) and energy lost in a cycle per unit of inertia (square of the
amplitude's unit per s²) at each amplitude, with 95 % intervals. In the answer on a record, the arrays of these columns
have the names `free/COLUMN`."""

CALIBRATION_TABLES = ("calibration.csv", "ranks.csv", "recovery.csv")
"""Names of the tables that the command `calibrate` can write."""

_TEXT = frozenset({
    "signal", "model", "estimator", "stage", "parameter", "unit", "outcome", "sampler", "restoring", "method",
    "diagnostic", "rms_unit", "verdict",
})  # fmt: skip
_WHOLE = frozenset({"repeat", "evaluations", "divergences", "specimens"})
_NUMBER = {c for columns in (*TABLES.values(), POPULATION) for c in columns} - _TEXT - _WHOLE
TEXT_COLUMNS = frozenset({("posteriors.csv", "deviation"), ("evidence.csv", "deviation")})
"""Pairs (table, column) of columns that contain text, although a column of the same name contains numbers in another
table."""


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write rows to a CSV file. Floats are written with all digits; nan, None and missing keys become empty fields.

    Raises ValueError if a row has a key that is not a column.
    """

    def field(value: object) -> str:
        value = value.item() if isinstance(value, np.generic) else value
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        return repr(float(value)) if isinstance(value, float) else str(value)

    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({column: field(value) for column, value in row.items()} for row in rows)
    write_bytes(path, buffer.getvalue().encode())


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table that `write_table` wrote.

    Columns of `TABLES` and `POPULATION` contain text, whole numbers (None if empty) or floats (nan if empty);
    other columns are text. Raises InputError if a field in a column of numbers is not a number.
    """
    path = Path(path)

    def convert(line: int, column: str, text: str) -> object:
        try:
            if column in _WHOLE:
                return int(text) if text else None
            if column in _NUMBER and (path.name, column) not in TEXT_COLUMNS:
                return float(text) if text else math.nan
        except ValueError:
            raise InputError(f"{path.name}, line {line}, column {column}: {text!r} is not a number") from None
        return text

    with path.open(newline="", encoding="utf-8") as handle:
        reader = csv.DictReader(handle)
        rows = ((reader.line_num, row.items()) for row in reader)
        return [{c: convert(line, c, text or "") for c, text in cells if c} for line, cells in rows]
