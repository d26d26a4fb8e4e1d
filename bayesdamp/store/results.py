"""The folder of a run: the stored results of its tasks, one file each, its lock, and the environment of the run.

Each file is written in one step. Files in the folder that a run did not write are never replaced or removed.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.metadata
import json
import os
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp import __version__
from bayesdamp.machine import cores
from bayesdamp.store.files import (
    READ_ERRORS,
    TEMPORARY_NAME,
    is_disk_full,
    name_in_errors,
    pack,
    unpack,
    write_bytes,
)
from bayesdamp.store.tables import CALIBRATION_TABLES, TABLES
from bayesdamp.types import OK, InputError

MARK_FILE = ".bayesdamp"
"""Name of the file that marks a folder as the folder of a run (the mark)."""
MARK_TEXT = "bayesdamp run\n"
"""Content of the file `MARK_FILE`."""
FOLDERS = ("cells", "figures", "posterior")
"""Folders in the folder of a run; `cells` has the results of tasks."""
LOCK = ".lock"
FILES = (
    LOCK,
    "damping_curves.csv",
    "population.csv",
    "report.html",
    "run.json",
    "verdict.json",
    "verdicts.csv",
)
"""Files in the folder of a run, besides its tables; `LOCK` is the file that a running process locks."""
HEAD_MEMBER = "cell.json"
"""Name of the first member in the archive of a result: its name, key, outcome, seconds and values."""
_ZIP_HEADER = 30
"""Bytes before the name of the first member in a zip archive (format specification, local file header)."""
_ELSEWHERE = "choose another folder with --out"


def claim(folder: Path, tables: Iterable[str] = ()) -> None:
    """Mark a folder as the folder of a run, after checking that it contains nothing that a run would overwrite.

    Parameters
    ----------
    folder
        Folder of the run, which need not exist.
    tables
        Names of the tables that a run writes.

    Raises
    ------
    InputError
        The folder contains files with such names that no run wrote, or links in place of a run's files.
    OSError
        The folder cannot be written.
    """
    present = set(os.listdir(folder)) if os.path.lexists(folder) else set()
    if MARK_FILE not in present:
        taken = sorted(present & {*FOLDERS, *FILES, *tables})
        # A run that was cloned from a repository has a run.json but may have no mark.
        try:
            path = folder / "run.json"
            description = json.loads(path.read_bytes()) if is_regular(path) else None
        except (ValueError, RecursionError):
            description = None
        has_run = isinstance(description, dict) and {"name", "seed", "study"} <= description.keys()
        if taken and not has_run:
            what = f"contains {taken[0]!r}, which no run of bayesdamp wrote"
            raise InputError(f"{folder}: {what}; {_ELSEWHERE}, or move it away")
        write_bytes(folder / MARK_FILE, MARK_TEXT.encode())
    mark = folder / MARK_FILE
    if not is_regular(mark) or mark.read_bytes() != MARK_TEXT.encode():
        raise InputError(f"{mark}: was not written by bayesdamp; {_ELSEWHERE}, or remove it")
    for entry in (folder / name for name in (*FOLDERS, *FILES, *tables)):
        if entry.is_symlink():
            raise InputError(f"{entry}: is a link, but a run writes its results to this name; {_ELSEWHERE}")


def is_regular(path: Path) -> bool:
    """Return whether a path is an existing regular file, not a link or a device."""
    return path.is_file() and not path.is_symlink()


def remove_temporary(folder: Path) -> None:
    """Remove the temporary files that a killed run left in its folder; no other files have such names."""
    below = (path for name in FOLDERS for path in (folder / name).rglob("*"))
    for path in (*folder.iterdir(), *below):
        if TEMPORARY_NAME.fullmatch(path.name) and is_regular(path):
            path.unlink(missing_ok=True)


def remove_listed(folder: Path, listed: Iterable[str]) -> None:
    """Remove the regular files with the listed names directly in a folder."""
    for name in listed:
        path = folder / name
        if path.name == name and is_regular(path):
            path.unlink(missing_ok=True)


@dataclass(frozen=True)
class TaskName:
    """The parts of a task's name, such as `estimate/bench/0/viscous/least_squares`.

    kind: kind of task. record: name of the signal. repeat: number of the repeat. candidate: the damping
    sum, with the restoring law if several are compared. method: the estimator, sampler or evidence method. A part
    that a name does not have is empty, or None for the repeat.
    """

    kind: str
    record: str = ""
    repeat: int | None = None
    candidate: str = ""
    method: str = ""

    @classmethod
    def of(cls, name: str) -> TaskName:
        """Split the name of a task, such as `mode/bench/0/viscous`, into its parts."""
        kind, *rest = name.split("/")
        record = rest.pop(0) if rest else ""
        repeat = int(rest.pop(0)) if rest else None
        candidate, method = (*rest, "", "")[:2]
        return cls(kind, record, repeat, candidate, method)


@dataclass(frozen=True)
class TaskResult:
    """The stored result of one task.

    name: name of the task: its kind, record, repeat, candidate and method, such as
    `estimate/bench/0/viscous/least_squares`.
    key: hash of everything that the result depends on; a result is reused only under the same key.
    meta: the values, as JSON (nan and infinities included); tuples come back as lists.
    arrays: numeric arrays by name.
    outcome: "ok", or the reason why there is no result, or only a doubtful one.
    seconds: duration of the computation.
    """

    name: str
    key: str
    meta: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float = 0.0

    @property
    def parts(self) -> TaskName:
        """The parts of the task's name: kind, record, repeat, candidate and method."""
        return TaskName.of(self.name)


class Store:
    """The results of a run's tasks, each an `.npz` file under `cells/`. Nothing is created before the first write.

    only: the keys of the results that are visible, by task name; None for all. A folder may also contain results of an
    earlier version of the study.
    """

    def __init__(self, folder: Path, only: Mapping[str, str] | None = None) -> None:
        self.folder = Path(folder)
        self.only = only
        self._results = self.folder / "cells"
        self._keys: dict[tuple[object, ...], tuple[tuple[object, ...], str]] = {}

    def key(self, task_name: str, of: tuple[object, ...], compute: Callable[[], str]) -> str:
        """Return the key of a task, which `compute` returns and which depends on the objects `of`.

        This is the key under which the task should be stored, not that of a stored result. The key is cached: `compute`
        is called only once for the same task and the same objects.
        """
        identity = (task_name, *map(id, of))
        if identity not in self._keys:
            self._keys[identity] = of, compute()  # storing the objects keeps their ids valid
        return self._keys[identity][1]

    def has(self, task_name: str, key: str) -> bool:
        """Return whether an undamaged result of a task is stored under this key.

        Under another key the result is out of date: the key is a hash of the inputs and the code.
        """
        result = self.find(task_name)
        return result is not None and result.key == key

    def read(self, task_name: str, *, arrays: bool = True) -> TaskResult:
        """Return the stored result of a task, whatever its key; without its arrays if `arrays` is false.

        Damaged arrays are only noticed if they are read. Raises KeyError if it is missing, damaged, or not among the
        visible results (`only`).
        """
        if self.only is not None and task_name not in self.only:
            raise KeyError(task_name)
        try:
            path = self._path(task_name)
            if not is_regular(path):  # reading a device or a pipe could block
                raise FileNotFoundError(path)
            head, stored = unpack(path, HEAD_MEMBER, arrays=arrays)
            result = TaskResult(
                task_name, head["key"], head["meta"], stored, head["outcome"], head["seconds"]
            )
        except READ_ERRORS as fault:
            raise KeyError(task_name) from fault
        if self.only is not None and self.only[task_name] != result.key:
            raise KeyError(task_name)
        return result

    def find(self, task_name: str, *, arrays: bool = True) -> TaskResult | None:
        """Return the stored result of a task, or None if it is missing, damaged, or not among the visible results.

        The arguments are those of `read`.
        """
        try:
            return self.read(task_name, arrays=arrays)
        except KeyError:
            return None

    def write(self, result: TaskResult) -> None:
        """Store a result, or replace that of the same task, in one step.

        Other processes see the old file or the new one, never a part of it. Raises OSError if it cannot be written.
        """
        head = {"name": result.name, "key": result.key, "outcome": result.outcome}
        head |= {"seconds": float(result.seconds), "meta": result.meta}
        write_bytes(self._path(result.name), pack(HEAD_MEMBER, head, result.arrays))

    def names(self) -> list[str]:
        """Return the names of all tasks with a stored result, sorted; some results may be damaged."""
        paths = (p.relative_to(self._results).as_posix() for p in self._results.rglob("*.npz"))
        names = (path.removesuffix(".npz") for path in paths)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Remove all stored results, but no other files in their folder; to be called under the `lock`."""
        for path in list(self._results.rglob("*.npz")):
            # A stored result begins with its own name, even if the file is truncated.
            name = path.relative_to(self._results).as_posix().removesuffix(".npz")
            beginning = f'{HEAD_MEMBER}{{"name": {json.dumps(name)},'.encode()
            if is_regular(path) and path.read_bytes()[_ZIP_HEADER:].startswith(beginning):
                path.unlink()

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the folder for writing, and remove the temporary files of a killed run.

        Raises InputError if another process has the lock, if the folder contains files that no run wrote, or if it
        cannot be written; OSError if the disk is full. The system releases the lock of a process that dies.
        """
        try:
            claim(self.folder, (*TABLES, *CALIBRATION_TABLES))
            path = self.folder / LOCK
            flags = os.O_CREAT | os.O_RDWR | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
            handle = os.fdopen(os.open(path, flags, 0o666), "a+")
        except OSError as fault:
            if is_disk_full(fault):
                raise
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
            with name_in_errors(self.folder):
                handle.truncate(0)
                os.write(
                    handle.fileno(), str(os.getpid()).encode()
                )  # unbuffered: a full disk is reported once
            remove_temporary(self.folder)
            yield

    def _path(self, task_name: str) -> Path:
        """Return the path of a task's result. Raises ValueError if the name could be a path outside the folder."""
        parts = task_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not the name of a task: {task_name!r}")
        return self._results.joinpath(*parts[:-1], parts[-1] + ".npz")


def provenance(inputs: Mapping[str, Path] | None = None, packages: Iterable[str] = ()) -> dict[str, Any]:
    """Return the description of program, machine and inputs for run.json.

    Parameters
    ----------
    inputs
        Input files, by the names under which their SHA-256 is stated.
    packages
        Names of packages whose versions are stated; by default bayesdamp and its requirements. A package that is not
        installed is left out.

    Returns
    -------
    dict
        versions: {package: version}. revision: the commit of a checkout, with "+changes" if files differ from it; else
        the version of the package. machine: {system, processor, cpus, python}. inputs: {name: hash}.
    """
    names, versions = set(packages), dict[str, str]()
    if not names:
        names = {"bayesdamp", "jaxlib"}
        with suppress(importlib.metadata.PackageNotFoundError):
            required = importlib.metadata.requires("bayesdamp") or []
            names |= {re.split(r"[^\w.-]", r)[0] for r in required if "extra ==" not in r}
    for name in sorted(names):
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[name] = importlib.metadata.version(name)
    file = Path(__file__)
    package = file.parents[1]

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(package), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        # An installed copy may be inside the checkout of another project, in which this file is not tracked.
        git("ls-files", "--error-unmatch", str(file.relative_to(package)))
        revision = git("rev-parse", "HEAD") + ("+changes" if git("status", "--porcelain", "--", ".") else "")
    except (OSError, subprocess.SubprocessError):
        revision = f"version {__version__}"
    processor = platform.processor() or platform.machine()
    with suppress(OSError):
        model = re.search(r"^model name.*?:(.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
        processor = model.group(1).strip() if model else processor
    return {
        "versions": versions,
        "revision": revision,
        "machine": {
            "system": platform.platform(),
            "processor": processor,
            "cpus": cores(),
            "python": platform.python_version(),
        },
        "inputs": {name: sha256(path) for name, path in (inputs or {}).items()},
    }


def sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file's content."""
    with Path(path).open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()
