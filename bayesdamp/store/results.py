"""The folder of a run: the stored results of its tasks, one file each, its lock, and the environment of the run.

The content of a result is an object of one class for each kind of task.

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
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from bayesdamp import __version__
from bayesdamp.machine import cores
from bayesdamp.serial import join, split
from bayesdamp.store.files import (
    CALIBRATION_TABLES,
    READ_ERRORS,
    TABLES,
    TEMPORARY_NAME,
    is_disk_full,
    name_in_errors,
    pack,
    unpack,
    write_bytes,
)
from bayesdamp.types import (
    OK,
    Estimate,
    Evidence,
    FeatureValues,
    FitCheck,
    InputError,
    Posterior,
    Ratio,
    Reference,
)

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
NAN = float("nan")
NO_DRAWS = np.empty((0, 0, 0)), np.empty((0, 0))
"""Empty arrays of draws and log likelihoods."""


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

        This is the key under which the task should be stored; a stored result may have another one. The key is cached:
        `compute` is called only once for the same task and the same objects.
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
        """Store a result in one step; it replaces a stored result of the same task.

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


class OtherVersionError(InputError, ValueError):
    """Error: a stored result has other fields than expected, because another version of the package wrote it."""


@dataclass(frozen=True)
class Content:
    """The values in a stored result, without its arrays. Subclasses are frozen dataclasses that JSON can represent."""

    @classmethod
    def of(cls, result: TaskResult) -> Self:
        """Read the content of a result. Raises OtherVersionError if it was stored by another version."""
        return cls.of_meta(result.meta)

    @classmethod
    def maybe(cls, result: TaskResult | None) -> Self | None:
        """Read the content of a result; None if there is no result, or it has an outcome but no values.

        Raises OtherVersionError if it was stored by another version.
        """
        return cls.of_meta(result.meta) if result is not None and result.meta else None

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any]) -> Self:
        """Read the content from its JSON form, as `meta` returns it. Raises OtherVersionError."""
        try:
            known = {f.name for f in fields(cls)}
            return join(cls, {name: value for name, value in meta.items() if name in known})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            what = "a stored result was written by another version of bayesdamp; compute it again with this version"
            raise OtherVersionError(f"{what} ({error})") from None

    def meta(self) -> dict[str, Any]:
        """Return the content in its JSON form, a dictionary by field; nan and infinities stay floats."""
        return split(self)


@dataclass(frozen=True)
class RecordContent(Content):
    """A record (`signal/NAME/REPEAT`).

    The samples are arrays of the result: `t` in s, and `y` in the base unit `unit` (per s or s² for a velocity or an
    acceleration). step: step to which values are rounded, in the unit of `y`; 0 if they are not rounded. provenance:
    source of the record, and how it was cleaned. bound: Cramér–Rao bound of a simulated record, standard deviation by
    parameter. The other fields exist only if the record oscillates. features: period, amplitudes and other features.
    anomalies: remarks for the user. reference: amplitude (rad or m) and frequency (rad/s) to which default priors are
    scaled. known: values of known parameters, and ε, the velocity (rad/s or m/s) within which Coulomb friction changes
    its sign. epsilon_note: a sentence if ε was assumed. noisy: whether the record has noise, without which there is no
    likelihood.
    """

    name: str = ""
    unit: str = "rad"
    quantity: str = "angle"
    step: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bound: Mapping[str, float] = field(default_factory=dict)
    features: FeatureValues | None = None
    anomalies: tuple[str, ...] = ()
    reference: Reference | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    epsilon_note: str = ""
    noisy: bool = False

    @property
    def scales(self) -> Reference:
        """The reference of the priors. Raises ValueError if the record does not oscillate."""
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference


@dataclass(frozen=True)
class EstimateContent(Content):
    """The estimates of one estimator for one candidate (`estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`), by stage.

    stages: the initial estimate and the trajectory fit that starts there, as far as the study asks for them.
    """

    stages: tuple[Estimate, ...] = ()


@dataclass(frozen=True)
class ModeContent(FitCheck, Content):
    """A posterior mode (`mode/NAME/REPEAT/CANDIDATE`) with the checks of its fit (`FitCheck`).

    values, sd: inferred parameters and their standard deviations, by name and in their units. known: the values of the
    other parameters. priors: descriptions in words. log_posterior: log density at the mode (nats, not normalised).
    shares: fractions of the posterior probability of the mode and of the other maxima that were found, the mode first.
    stored: an `inference.mode.StoredMode`, as `bayesdamp.serial` splits it, with arrays `stored/...`.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    log_posterior: float = NAN
    shares: tuple[float, ...] = ()
    stored: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class PosteriorContent(Content):
    """The draws of one sampler (`posterior/NAME/REPEAT/CANDIDATE/SAMPLER`).

    posterior: names, diagnostics and settings of the draws without their arrays; the result has `draws`, (chain, draw,
    parameter). summary, units: of parameters and derived quantities. without: derived quantities without a summary,
    with the number of draws for which they are not defined. file: path of the netCDF file with all draws, in the run's
    folder. ratios: damping ratios at the verdict's amplitudes.
    """

    posterior: Posterior = field(default_factory=lambda: Posterior("", (), *NO_DRAWS))
    units: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    without: Mapping[str, int] = field(default_factory=dict)
    file: str = ""
    ratios: tuple[Ratio, ...] = ()


@dataclass(frozen=True)
class EvidenceContent(Content):
    """The evidence by one method (`evidence/NAME/REPEAT/CANDIDATE/METHOD`).

    evidence: None if the referee (nested sampling) was not needed, because the other methods agree.
    """

    evidence: Evidence | None = None


@dataclass(frozen=True)
class ComparedCandidate:
    """The result of an answer for one candidate: a damping sum under a restoring law.

    log_evidence: in nats, with deviations from the laws; None under exact laws only. log_evidence_exact: under exact
    laws; None if it was not computed. outcome: "ok", or why there is no result. rms: root mean square residual of the
    fit under exact laws, in the record's unit. place: for a form of damping that the study does not compare, the
    compared sum that is its limiting case, if any. parameters: names of the inferred damping parameters.
    """

    damping: str
    restoring: str
    log_evidence: float | None = None
    log_evidence_exact: float | None = None
    rms: float | None = None
    outcome: str = OK
    place: str = ""
    parameters: tuple[str, ...] = ()

    @property
    def exact(self) -> float:
        """The log evidence under exact laws; −∞ if it was not computed."""
        return float("-inf") if self.log_evidence_exact is None else self.log_evidence_exact


@dataclass(frozen=True)
class SampledPosterior:
    """The posterior of a candidate in a sampled answer.

    parameters: by name, mean, sd, quantiles and other summaries, in the parameter's unit. deviation: size of the
    relative deviation from the damping law, (2.5 %, median, 97.5 %); 0.1 is 10 %. unexplained: root mean square
    residual under exact laws beyond the noise, as a fraction of the first amplitude. log_evidence, stderr: in nats.
    acceptance, temperatures: acceptance rate of the last moves of sequential Monte Carlo, and number of increases of
    the inverse temperature.
    """

    damping: str
    restoring: str
    parameters: Mapping[str, Mapping[str, float]]
    deviation: tuple[float, float, float]
    unexplained: float
    log_evidence: float
    stderr: float
    acceptance: float
    temperatures: int


@dataclass(frozen=True)
class CandidatePriors:
    """Descriptions (in words) of the priors of a candidate's inferred parameters, by parameter."""

    damping: str
    restoring: str
    priors: Mapping[str, str]


@dataclass(frozen=True)
class NoiseEvidence:
    """A noise model fitted to the residuals of the sum of all terms, with its log evidence in nats."""

    name: str
    log_evidence: float


@dataclass(frozen=True)
class StoredFit:
    """The fit of a candidate with deviations from its laws.

    found: the scalar fields of the fit, an `inference.deviation.single.FitState`. Its array fields are the arrays
    `found/DAMPING@RESTORING/...` of the result.
    """

    damping: str
    restoring: str
    found: Mapping[str, Any]


@dataclass(frozen=True)
class EnvelopeContent:
    """The answer on an envelope, without its verdict.

    unit: of the readings. samples: number of readings that were used. likelihoods: for each damping sum, the scalar
    fields of its likelihood as a function of the decay rates; the array fields are the arrays `likelihood/DAMPING/...`
    of the result. assumed: a sentence for each assumption.
    """

    unit: str
    samples: int = 0
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class AnswerContent(Content):
    """The answer on a record (`answer/NAME/REPEAT`, `sampled/NAME/REPEAT`).

    verdict: as `Verdict.to_dict` returns it. candidates: results of the compared damping sums. rivals: results of other
    forms of damping, which the study does not compare. priors: descriptions of the priors. posteriors: of the sampled
    candidates. laws: fits of the candidates with deviations from their laws. noise: the noise model of the answer.
    noises: all fitted noise models. epsilon: velocity (rad/s or m/s) within which Coulomb friction changes its sign,
    if it was not known. envelope: further values for an envelope, whose answer has only these and the verdict.
    """

    verdict: Mapping[str, Any]
    candidates: tuple[ComparedCandidate, ...] = ()
    priors: tuple[CandidatePriors, ...] = ()
    posteriors: tuple[SampledPosterior, ...] = ()
    laws: tuple[StoredFit, ...] = ()
    rivals: tuple[ComparedCandidate, ...] = ()
    noise: str = ""
    noises: tuple[NoiseEvidence, ...] = ()
    epsilon: float | None = None
    envelope: EnvelopeContent | None = None


@dataclass(frozen=True)
class ChunkContent(Content):
    """The simulated records of one calibration task.

    outcomes: of each record, "ok" or why it is not used. accepted: whether each record is usable. first: number of the
    first record, from 0; the others follow.
    """

    outcomes: tuple[str, ...] = ()
    accepted: tuple[bool, ...] = ()
    first: int = 0


@dataclass(frozen=True)
class RanksContent(ChunkContent):
    """Ranks of true parameters for the records of one task (`ranks/MODEL/FIRST`).

    The ranks are arrays of the result (`ranks.compute_chunk`). names: names of the ranked quantities. sampler_outcomes:
    by sampler, its outcome for each record; empty if the record has no mode. seconds: by sampler, and under "record"
    for simulation and fit.
    """

    model: str = ""
    names: tuple[str, ...] = ()
    sampler_outcomes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RecoveryContent(ChunkContent):
    """Model recovery for the records of a task (`recovery/FIRST`): which model has the most evidence.

    The log evidence itself is in the arrays of the result. models: names of the models. evidence_outcomes: for each
    record, the outcome of the evidence of each model ("ok", or why it is unreliable or missing).
    """

    models: tuple[str, ...] = ()
    evidence_outcomes: tuple[tuple[str, ...], ...] = ()
