"""A run's folder: one atomic file a cell, the tables, provenance, and a lock."""

from __future__ import annotations

import csv
import fcntl
import hashlib
import importlib.metadata
import io
import json
import math
import os
import platform
import struct
import subprocess
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.store import folders
from bayesdamp.types import OK, InputError

TABLES: dict[str, tuple[str, ...]] = {
    "estimates.csv": (
        "signal", "repeat", "model", "restoring", "estimator", "stage", "parameter", "unit", "value", "stderr", "truth",
        "error_pct", "evaluations", "seconds", "outcome",
    ),
    "posteriors.csv": (
        "signal", "repeat", "model", "restoring", "sampler", "parameter", "unit", "mean", "sd", "median",
        "q2.5", "q25", "q75", "q97.5", "hdi_low", "hdi_high", "ess_bulk", "ess_tail", "rhat", "divergences",
        "seconds", "outcome",
    ),
    "evidence.csv": (
        "signal", "repeat", "model", "restoring", "method", "log_evidence", "stderr", "log_bayes_factor",
        "probability", "diagnostic", "outcome",
    ),
    "fits.csv": (
        "signal", "repeat", "model", "restoring", "rms", "rms_unit", "residual_autocorrelation",
        "window_spread", "predictive_p", "verdict",
    ),
}  # fmt: skip

SPECIMEN_TABLES: dict[str, tuple[str, ...]] = {
    "specimens.csv": (
        "specimen", "records", "record", "model", "restoring", "shared", "parameter", "unit", "mean", "sd", "median",
        "q2.5", "q97.5", "log_evidence", "stderr", "probability", "pareto_k", "effective", "outcome",
    ),
    "population.csv": (
        "over", "model", "restoring", "parameter", "unit", "what", "of", "mean", "sd", "median", "q2.5", "q97.5",
        "effective", "prior_scale", "outcome",
    ),
}  # fmt: skip
"""Tables of a study that names specimens."""
VERDICTS: tuple[str, ...] = (
    "record", "grade", "decided", "damping", "probability", "rivals", "restoring", "restoring_probability",
    "frequency", "frequency_low", "frequency_high", "exponent", "exponent_low", "exponent_high",
    *(
        f"{name}_{i}{end}"
        for i in (1, 2, 3)
        for name, ends in (
            ("amplitude", ("",)),
            ("unit", ("",)),
            ("ratio", ("", "_low", "_high", "_sd_noise", "_sd_law")),
        )
        for end in ends
    ),
    "energy", "other_forms", "deviation", "deviation_low", "deviation_high", "unnamed", "unnamed_low", "unnamed_high",
    "unexplained_pct", "noise_pct",
    "start", "stop", "cycles", "remarks", "sentence",
)  # fmt: skip
"""Columns of verdicts.csv."""

DAMPING_CURVES = ("amplitude", "ratio", "ratio_low", "ratio_high", "lost", "lost_low", "lost_high")
"""Columns of damping_curves.csv after the record's name and the unit of the amplitude; arrays `free/NAME` of an
answer."""

CALIBRATION_TABLES = ("calibration.csv", "ranks.csv", "recovery.csv")

_TEXT = frozenset({
    "signal", "model", "estimator", "stage", "parameter", "unit", "outcome", "sampler", "restoring", "method",
    "diagnostic", "rms_unit", "verdict", "specimen", "record", "shared", "over", "what", "of",
})  # fmt: skip
_WHOLE = frozenset({"repeat", "evaluations", "divergences", "records"})
_NUMBER = (
    frozenset(c for t in (TABLES, SPECIMEN_TABLES) for columns in t.values() for c in columns)
    - _TEXT
    - _WHOLE
)

_HEAD = folders.CELL
_BROKEN = (
    zipfile.BadZipFile, zlib.error, struct.error, OSError, EOFError, KeyError, ValueError, TypeError,
    NotImplementedError, RuntimeError, OverflowError, MemoryError,
)  # fmt: skip


@dataclass(frozen=True)
class CellResult:
    """What one cell left behind.

    name: the cell's path-like name, such as `estimate/bench/0/viscous/least_squares`.
    key: hash of everything the result depends on; a result is reused only under the same key.
    meta: values that JSON can hold (nan and infinities included); tuples come back as lists.
    arrays: named numeric arrays.
    """

    name: str
    key: str
    meta: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float = 0.0


class Store:
    """The cells of one run, each an `.npz` file under `cells/`. Nothing is created before the first write.

    only: name to key of the cells that are seen, where a folder may hold those of another question too; None for all.
    """

    def __init__(self, folder: Path, only: Mapping[str, str] | None = None) -> None:
        self.folder = Path(folder)
        self.only = only
        self._cells = self.folder / "cells"

    def has(self, cell_name: str, key: str) -> bool:
        """Whether a whole result is there under this key; a truncated or damaged file counts as absent."""
        try:
            return self.read(cell_name).key == key
        except KeyError:
            return False

    def read(self, cell_name: str) -> CellResult:
        """The result of one cell. Raises KeyError where there is none that can be read."""
        if self.only is not None and cell_name not in self.only:
            raise KeyError(cell_name)
        try:
            found = _unpack(self._path(cell_name), cell_name)
        except _BROKEN as fault:
            raise KeyError(cell_name) from fault
        if self.only is not None and self.only[cell_name] != found.key:
            raise KeyError(cell_name)
        return found

    def head(self, cell_name: str) -> tuple[str, str]:
        """Key and outcome of a cell; its arrays are not looked at. Raises KeyError."""
        try:
            with zipfile.ZipFile(self._path(cell_name)) as archive:
                found = json.loads(archive.read(_HEAD))
            return found["key"], found["outcome"]
        except _BROKEN as fault:
            raise KeyError(cell_name) from fault

    def write(self, result: CellResult) -> None:
        """Store a result in one step: another process sees the old file or the new one, never a part."""
        write_bytes(self._path(result.name), _pack(result))

    def names(self) -> list[str]:
        """Names of all stored cells, sorted; whether each can be read, `read` tells."""
        found = (p.relative_to(self._cells).as_posix() for p in self._cells.rglob("*.npz"))
        names = (name.removesuffix(".npz") for name in found)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Forget all cells of a folder that is marked as a run's; other files stay."""
        folders.remove_cells(self.folder)

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Hold the folder for writing, and sweep what a killed run left half-written.

        Raises InputError while another process holds it, and where the folder holds what no run wrote. The system drops
        the lock of a process that dies.
        """
        try:
            folders.claim(self.folder, (*TABLES, *SPECIMEN_TABLES, *CALIBRATION_TABLES))
            handle = folders.open_lock(self.folder)
        except OSError as fault:
            raise InputError(f"{self.folder}: cannot write a run here ({fault.strerror})") from fault
        with handle:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as fault:
                handle.seek(0)
                holder = handle.read().strip() or "unknown"
                raise InputError(
                    f"{self.folder}: another run (process {holder}) is writing here; "
                    "wait until it is done or choose another folder with --out"
                ) from fault
            handle.truncate(0)
            handle.write(str(os.getpid()))
            handle.flush()
            folders.sweep(self.folder)
            yield

    def _path(self, cell_name: str) -> Path:
        parts = cell_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not a cell's name: {cell_name!r}")
        return self._cells.joinpath(*parts[:-1], parts[-1] + ".npz")


def _pack(result: CellResult) -> bytes:
    head = {
        "name": result.name,
        "key": result.key,
        "outcome": result.outcome,
        "seconds": float(result.seconds),
        "meta": dict(result.meta),
        "arrays": list(result.arrays),
    }
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(_HEAD, json.dumps(head, default=_plain))
        for i, array in enumerate(result.arrays.values()):
            with archive.open(f"{i}.npy", "w") as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)  # type: ignore[arg-type]
    return buffer.getvalue()


def _unpack(path: Path, name: str) -> CellResult:
    with zipfile.ZipFile(path) as archive:
        head = json.loads(archive.read(_HEAD))
        # each member is read whole: only then is its checksum compared
        arrays = {
            label: np.lib.format.read_array(io.BytesIO(archive.read(f"{i}.npy")), allow_pickle=False)
            for i, label in enumerate(head["arrays"])
        }
    return CellResult(name, head["key"], head["meta"], arrays, head["outcome"], head["seconds"])


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"a cell's meta cannot hold a {type(value).__name__}")


def write_bytes(path: Path, content: bytes) -> None:
    """Replace a file in one step, and only once the content is on the disk. Creates the folders above it.

    Raises InputError where something else than a regular file has the name.
    """
    path = Path(path)
    folders.refuse_special(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = folders.temporary(path)
    try:
        with partial.open("xb") as handle:
            handle.write(content)
            handle.flush()
            os.fsync(handle.fileno())
        os.replace(partial, path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


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
    return _strict(_plain(value))


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV in one step. Floats read back exactly; nan, None and missing keys are empty fields.

    Raises ValueError on a key that is no column.
    """
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        unknown = set(row) - set(columns)
        if unknown:
            raise ValueError(f"{Path(path).name} has no column {', '.join(sorted(unknown))}")
        writer.writerow([_field(row.get(c)) for c in columns])
    write_bytes(path, buffer.getvalue().encode())


def _field(value: object) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None:
        return ""
    if isinstance(value, float):
        return "" if math.isnan(value) else repr(float(value))
    return str(value)


def read_table(path: Path) -> list[dict[str, Any]]:
    """The rows of a table that `write_table` wrote.

    Columns of `TABLES` are typed: text, whole numbers (None where empty) and floats (nan where empty);
    any other column is text. Raises InputError on a field that is no number where one belongs.
    """
    path = Path(path)
    with path.open(newline="", encoding="utf-8") as handle:
        reader = csv.DictReader(handle)
        return [
            {
                column: _value(path, reader.line_num, column, text or "")
                for column, text in row.items()
                if column
            }
            for row in reader
        ]


def _value(path: Path, line: int, column: str, text: str) -> object:
    try:
        if column in _WHOLE:
            return int(text) if text else None
        if column in _NUMBER:
            return float(text) if text else math.nan
    except ValueError:
        raise InputError(f"{path.name}, line {line}, column {column}: {text!r} is not a number") from None
    return text


def provenance(inputs: Iterable[Path] = (), packages: Iterable[str] = ()) -> dict[str, Any]:
    """What run.json says of the program and its inputs.

    inputs: files whose SHA-256 is noted.
    packages: names of distributions; by default all that bayesdamp requires.
    Returns versions {package: version}, revision, machine {system, processor, cpus, python} and
    inputs {path: hash}.
    """
    return {
        "versions": _versions(packages),
        "revision": _revision(),
        "machine": {
            "system": platform.platform(),
            "processor": _processor(),
            "cpus": len(os.sched_getaffinity(0)),
            "python": platform.python_version(),
        },
        "inputs": {str(p): sha256(p) for p in inputs},
    }


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file's content."""
    with Path(path).open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _versions(packages: Iterable[str]) -> dict[str, str]:
    names = set(packages)
    if not names:
        try:
            required = importlib.metadata.requires("bayesdamp") or []
        except importlib.metadata.PackageNotFoundError:
            required = []
        bare = (r.split(";")[0].strip() for r in required if "extra ==" not in r)
        names = {"bayesdamp", "jaxlib", *("".join(_leading_name(r)) for r in bare)}
    found = {}
    for name in sorted(names):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _leading_name(requirement: str) -> Iterator[str]:
    for letter in requirement:
        if not (letter.isalnum() or letter in "-_."):
            return
        yield letter


def _revision() -> str:
    """The commit of a checkout ("+changes" where files differ from it), else the package's version."""
    here = Path(__file__)
    package = here.parents[1]

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", "-C", str(package), *arguments], capture_output=True, text=True, check=True, timeout=20
        )
        return done.stdout.strip()

    try:
        # an installed copy may lie inside somebody else's checkout: then this file is not tracked there
        git("ls-files", "--error-unmatch", str(here.relative_to(package)))
        return git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        return "version " + _versions(["bayesdamp"]).get("bayesdamp", "unknown")


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
