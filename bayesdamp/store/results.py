"""Read and write the folder of a run: a file for the result of each task, the lock, and a description of the machine.

A task is one computation of a study, such as one estimate. For each kind of task there is a class that describes the
values in its results (a subclass of `Content`).

A file is written completely or not at all. Files in the folder that a run did not write are never replaced or removed.
"""

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
"""Name of the file that marks a folder as the folder of a run."""
MARK_TEXT = "bayesdamp run\n"
"""Content of the file `MARK_FILE`."""
FOLDERS = ("cells", "figures", "posterior")
"""Names of the folders in the folder of a run; `cells` contains the results of tasks."""
LOCK = ".lock"
FILES = (
    LOCK, "damping_curves.csv", "population.csv", "report.html", "run.json", "verdict.json", "verdicts.csv",
)  # fmt: skip
"""Names of the files in the folder of a run, besides `TABLES` and `CALIBRATION_TABLES`. A running process locks the
file `LOCK`."""
HEAD_MEMBER = "cell.json"
"""Name of the first member in the zip archive of a result: JSON with the task's name, key, outcome, seconds, values."""
_ZIP_HEADER = 30
"""Number of bytes before the name of the first member in a zip archive (zip specification, local file header)."""
_ELSEWHERE = "choose another folder with --out"
NAN = float("nan")
NO_DRAWS = np.empty((0, 0, 0)), np.empty((0, 0))
"""Empty arrays of a posterior: draws, (chain, draw, parameter), and log likelihoods, (chain, draw)."""


def claim(folder: Path, tables: Iterable[str] = ()) -> None:
    """Mark a folder as the folder of a run, after checking that a run would overwrite only files of an earlier run.

    A missing folder is created. A folder was written by a run if it has the mark `MARK_FILE`, or a run.json of a run.

    Parameters
    ----------
    folder
        Folder of the run.
    tables
        Names of the tables that a run writes.

    Raises
    ------
    InputError
        No run wrote the folder, but it contains files or folders with names that a run uses. Or a name that a run uses
        is a link, or `MARK_FILE` is not a regular file with the content `MARK_TEXT`.
    OSError
        The folder cannot be read or written, for example because it is a file.
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
    """Remove the temporary files that a killed run left in its folder and in the subfolders that a run writes.

    Their names match `TEMPORARY_NAME`. No other files have names of this form, because it contains 32 random digits.
    """
    below = (path for name in FOLDERS for path in (folder / name).rglob("*"))
    for path in (*folder.iterdir(), *below):
        if TEMPORARY_NAME.fullmatch(path.name) and is_regular(path):
            path.unlink(missing_ok=True)


def remove_listed(folder: Path, listed: Iterable[str]) -> None:
    """Remove the regular files with the listed names directly in a folder.

    Names that contain a folder, links and missing files are ignored.
    """
    for name in listed:
        path = folder / name
        if path.name == name and is_regular(path):
            path.unlink(missing_ok=True)


@dataclass(frozen=True)
class TaskName:
    """The parts of a task's name, such as `estimate/bench/0/viscous/least_squares`.

    kind: kind of task. record: name of the signal. repeat: number of the repeat, from 0. candidate: the damping model,
    such as `viscous+coulomb`; followed by @ and the restoring law if several restoring laws are compared. method: the
    estimator, sampler or evidence method. If a name does not have a part, this part is "" (None for the repeat). In a
    calibration's tasks, `ranks/MODEL/FIRST` and `recovery/FIRST`, record is MODEL or FIRST.
    """

    kind: str
    record: str = ""
    repeat: int | None = None
    candidate: str = ""
    method: str = ""

    @classmethod
    def of(cls, name: str) -> Self:
        """Split the name of a task, such as `mode/bench/0/viscous`, into its parts."""
        kind, *rest = name.split("/")
        record = rest.pop(0) if rest else ""
        repeat = int(rest.pop(0)) if rest else None
        candidate, method = (*rest, "", "")[:2]
        return cls(kind, record, repeat, candidate, method)


@dataclass(frozen=True)
class TaskResult:
    """The stored result of one task.

    name: name of the task: its kind, record, repeat, damping model and method (`TaskName`), such as
    `estimate/bench/0/viscous/least_squares`.
    key: hash of everything that the result depends on. The result is reused only while the key is the same.
    meta: the values, as JSON (nan and infinities included); tuples are read back as lists.
    arrays: numeric arrays by name.
    outcome: "ok", or a text that says why there is no result, or why it is unreliable.
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
        """The parts of the task's name: kind, record, repeat, candidate (the damping model) and method."""
        return TaskName.of(self.name)


class Store:
    """The results of a run's tasks, each in an `.npz` file under `cells/`. Only `write` and `lock` create files.

    A file has the name of its task, so that a new result replaces the old one. The file also contains the result's key,
    a hash of everything on which the result depends. only: the key of each visible result, by task name. Results of
    other tasks, or with other keys, are hidden, for example those of an earlier version of the study. None if all
    results are visible.
    """

    def __init__(self, folder: Path, only: Mapping[str, str] | None = None) -> None:
        self.folder = Path(folder)
        self.only = only
        self._results = self.folder / "cells"
        self._keys: dict[tuple[object, ...], tuple[tuple[object, ...], str]] = {}

    def key(self, task_name: str, of: tuple[object, ...], compute: Callable[[], str]) -> str:
        """Return the key under which the result of a task should be stored; `compute` computes it.

        of: the objects on which the key depends. `compute` is called only once for the same task and the same objects
        (identical, not only equal); then the key is taken from a cache. A result that is already stored may have
        another key.
        """
        identity = (task_name, *map(id, of))
        if identity not in self._keys:
            self._keys[identity] = of, compute()  # storing the objects keeps their ids valid
        return self._keys[identity][1]

    def has(self, task_name: str, key: str) -> bool:
        """Return whether an undamaged result of a task is stored with this key, and not hidden by `only`.

        A result with another key is out of date, because the key is a hash of the inputs and the code.
        """
        result = self.find(task_name)
        return result is not None and result.key == key

    def read(self, task_name: str, *, arrays: bool = True) -> TaskResult:
        """Return the stored result of a task, also if its key is out of date; without its arrays if `arrays` is false.

        Damaged arrays are only noticed if they are read. Raises KeyError if the result is missing, damaged or hidden by
        `only`.
        """
        if self.only is not None and task_name not in self.only:
            raise KeyError(task_name)
        try:
            path = self._path(task_name)
            if not is_regular(path):  # reading a device or a pipe could block
                raise FileNotFoundError(path)
            head, stored = unpack(path, HEAD_MEMBER, arrays=arrays)
            outcome, seconds = head["outcome"], head["seconds"]
            result = TaskResult(task_name, head["key"], head["meta"], stored, outcome, seconds)
        except READ_ERRORS as fault:
            raise KeyError(task_name) from fault
        if self.only is not None and self.only[task_name] != result.key:
            raise KeyError(task_name)
        return result

    def find(self, task_name: str, *, arrays: bool = True) -> TaskResult | None:
        """Return the stored result of a task, or None if it is missing, damaged or hidden by `only`.

        The arguments are the same as for `read`.
        """
        try:
            return self.read(task_name, arrays=arrays)
        except KeyError:
            return None

    def write(self, result: TaskResult) -> None:
        """Store the result of a task. It replaces an earlier result of the same task.

        Other processes see the old file or the new one, never a part of it. Raises OSError if the file cannot be
        written, and InputError if there is a link or a folder in its place.
        """
        head = {"name": result.name, "key": result.key, "outcome": result.outcome}
        head |= {"seconds": float(result.seconds), "meta": result.meta}
        write_bytes(self._path(result.name), pack(HEAD_MEMBER, head, result.arrays))

    def names(self) -> list[str]:
        """Return the names of all tasks with a stored result, sorted; some results may be damaged.

        Tasks that are not in `only` are left out. Keys are not compared, so `read` may raise KeyError for a name.
        """
        paths = (p.relative_to(self._results).as_posix() for p in self._results.rglob("*.npz"))
        names = (path.removesuffix(".npz") for path in paths)
        return sorted(name for name in names if self.only is None or name in self.only)

    def clear(self) -> None:
        """Remove all stored results, also hidden ones, but no other files in their folder.

        Call this only inside `with store.lock():`.
        """
        for path in list(self._results.rglob("*.npz")):
            # A stored result begins with its own name, even if the file is truncated.
            name = path.relative_to(self._results).as_posix().removesuffix(".npz")
            beginning = f'{HEAD_MEMBER}{{"name": {json.dumps(name)},'.encode()
            if is_regular(path) and path.read_bytes()[_ZIP_HEADER:].startswith(beginning):
                path.unlink()

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Lock the folder for writing within this context, and remove the temporary files of a killed run.

        Raises InputError if another run has locked the folder (also one in this process), if `claim` refuses it (it
        contains files with names that a run uses, but that no run wrote), or if it cannot be written (for example, it
        is a file). Raises OSError if the disk is full. The operating system releases the lock of a process that dies.
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
                # Unbuffered: a full disk is reported once.
                os.write(handle.fileno(), str(os.getpid()).encode())
            remove_temporary(self.folder)
            yield

    def _path(self, task_name: str) -> Path:
        """Return the path of the file with a task's result. Raises ValueError if the name could leave the folder."""
        parts = task_name.split("/")
        if any(not p or p[0] == "." or "\\" in p or "\0" in p for p in parts):
            raise ValueError(f"not the name of a task: {task_name!r}")
        return self._results.joinpath(*parts[:-1], parts[-1] + ".npz")


def provenance(inputs: Mapping[str, Path] | None = None, packages: Iterable[str] = ()) -> dict[str, Any]:
    """Return a description of the program, the machine and the input files, for run.json.

    Parameters
    ----------
    inputs
        Paths of the input files, by the names that the result uses for them.
    packages
        Names of the packages whose versions are returned; by default bayesdamp, jaxlib and the requirements of
        bayesdamp. A package that is not installed is left out.

    Returns
    -------
    dict
        versions: {package: version}. revision: the git commit of the source, with "+changes" if files of the package
        differ from it; "version X" if the source is not in git. machine: {system, processor, cpus, python}. inputs:
        {name: SHA-256 of the file}.

    Raises
    ------
    OSError
        An input file cannot be read.
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
    """Error: the values of a stored result do not fit the fields of its `Content`, as after a change of the package."""


@dataclass(frozen=True)
class Content:
    """The values in the stored result of a task, without its arrays.

    Each kind of task has a subclass: a frozen dataclass that can be converted to JSON and back.
    """

    @classmethod
    def of(cls, result: TaskResult) -> Self:
        """Read the values of a result. Raises OtherVersionError if another version of the package stored it.

        Fields without a stored value get their defaults; OtherVersionError is raised if a field has no default. For a
        result that may have only an outcome, such as that of a refused task, see `maybe`.
        """
        return cls.of_meta(result.meta)

    @classmethod
    def maybe(cls, result: TaskResult | None) -> Self | None:
        """Read the values of a result; None if there is no result, or if it has only an outcome and no values.

        Raises OtherVersionError if another version of the package stored it.
        """
        return cls.of_meta(result.meta) if result is not None and result.meta else None

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any]) -> Self:
        """Build the object from its JSON form (see `meta`). Raises OtherVersionError if a field does not fit.

        Missing fields get their defaults (OtherVersionError if there is none), and unknown ones are ignored.
        """
        try:
            known = {f.name for f in fields(cls)}
            return join(cls, {name: value for name, value in meta.items() if name in known})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            what = "a stored result was written by another version of bayesdamp; compute it again with this version"
            raise OtherVersionError(f"{what} ({error})") from None

    def meta(self) -> dict[str, Any]:
        """Return the values in JSON form: a dictionary with an entry for each field; nan and infinities stay floats."""
        return split(self)


@dataclass(frozen=True)
class RecordContent(Content):
    """The values of a record, from the task `signal/NAME/REPEAT`.

    name: of the signal. The samples are in `arrays` of the same result: `t` in s, and `y` in the base unit `unit`, such
    as rad (for a velocity or an acceleration: `unit` per s or per s²); a measured record also has `raw_t` and `raw_y`
    (see `compute_signal`). step: step to which `y` is rounded, in the unit of `y`; 0 if it is not rounded. provenance:
    source of the record, and how it was cleaned. bound: for the first repeat of a simulated record, the Cramér–Rao
    bound (smallest standard deviation) by parameter; {} if there is none.

    The other fields have values only if the record oscillates. features: period, amplitudes and other features.
    anomalies: remarks for the user. reference: amplitude (rad or m) and angular frequency (rad/s) to which default
    priors are scaled. known: values of the parameters that are not inferred, also ε (unless it is inferred), the
    velocity (rad/s or m/s) within which Coulomb friction changes its sign. epsilon_note: a sentence if ε was assumed.
    noisy: whether the record has noise; without noise there is no likelihood.
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
        """Amplitude and frequency to which default priors are scaled.

        Raises ValueError if the record does not oscillate.
        """
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference


@dataclass(frozen=True)
class EstimateContent(Content):
    """The estimates by one estimator for one damping model, from the task `estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`.

    stages: the method's own (initial) estimate and the trajectory fit that starts from it, or only one of them,
    depending on the study.
    """

    stages: tuple[Estimate, ...] = ()


@dataclass(frozen=True)
class ModeContent(FitCheck, Content):
    """The posterior mode of one damping model, with checks of its fit, from the task `mode/NAME/REPEAT/CANDIDATE`.

    values, sd: inferred parameters and their standard deviations, by name and in their units. known: values of the
    parameters that are not inferred. priors: descriptions of the priors in words. log_posterior: log posterior density
    at the mode (nats, not normalised), for the standard normal scores of the parameters. shares: fractions of the
    posterior probability that belong to the maxima that the search found: first the mode, then the others. stored: the
    mode itself in JSON form (`inference.mode.StoredMode`); its array fields are the entries `stored/...` of `arrays` of
    the same result.
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
    """The posterior of one damping model by one sampler, from the task `posterior/NAME/REPEAT/CANDIDATE/SAMPLER`.

    posterior: names and diagnostics of the draws; its own arrays are empty. The draws are `draws` in `arrays` of the
    same result, (chain, draw, parameter), in the units of the parameters. summary: mean, sd and other summaries of each
    parameter and derived quantity, by name. units: their units. without: derived quantities that have no summary, with
    the number of draws for which they are not defined. file: path of the netCDF file with the draws, relative to the
    run's folder. ratios: damping ratios at the amplitudes of the verdict on the record; () without a verdict.
    """

    posterior: Posterior = field(default_factory=lambda: Posterior("", (), *NO_DRAWS))
    units: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    without: Mapping[str, int] = field(default_factory=dict)
    file: str = ""
    ratios: tuple[Ratio, ...] = ()


@dataclass(frozen=True)
class EvidenceContent(Content):
    """The evidence of one damping model by one method, from the task `evidence/NAME/REPEAT/CANDIDATE/METHOD`.

    evidence: the log evidence with its error. None if the method is nested sampling, used as a check, and was not
    needed because the other methods agree; also None if the outcome of the task says why it gave no result.
    """

    evidence: Evidence | None = None


@dataclass(frozen=True)
class ComparedCandidate:
    """The result for one candidate in the comparison of models on a record.

    A candidate is a sum of damping terms under a restoring law. log_evidence: log evidence (nats) if damping and
    restoring force may deviate from their laws; None if this was not computed. log_evidence_exact: log evidence (nats)
    if the laws hold exactly; None if this was not computed. outcome: "ok", or why there is no result. rms: root mean
    square residual of the fit with exact laws, in the base unit of the recorded quantity, such as rad/s for a velocity;
    None if there is no result, or if the record was reduced to amplitudes and phases. place: for a form of damping that
    the study does not compare, the compared sum that is its limiting case; "" if there is none. parameters: names of
    the inferred damping parameters.
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
        """The log evidence (nats) if the laws hold exactly; −∞ if it was not computed."""
        return float("-inf") if self.log_evidence_exact is None else self.log_evidence_exact


@dataclass(frozen=True)
class SampledPosterior:
    """The posterior of one candidate (a sum of damping terms under a restoring law), sampled by sequential Monte Carlo.

    parameters: for each parameter its mean, sd, quantiles and other summaries, in the parameter's unit. deviation: size
    of the relative deviation from the damping law, (2.5 % quantile, median, 97.5 % quantile); 0.1 is 10 %; zeros under
    exact laws. unexplained: root mean square of the residual with exact laws that the noise does not account for, as a
    fraction of the first amplitude. log_evidence, stderr: log evidence and its standard error, in nats. acceptance:
    acceptance rate of the last moves. temperatures: number of increases of the inverse temperature.
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
    """The priors of one candidate (a sum of damping terms under a restoring law), in words, by inferred parameter."""

    damping: str
    restoring: str
    priors: Mapping[str, str]


@dataclass(frozen=True)
class NoiseEvidence:
    """The name of a noise model and its log evidence (nats), from the residuals of a fit to the record."""

    name: str
    log_evidence: float


@dataclass(frozen=True)
class StoredFit:
    """The fit of one candidate (a sum of damping terms under a restoring law) that allows deviations from the laws.

    found: the scalar fields of the fit (`inference.deviation.single.FitState`). Its array fields are the arrays
    `found/DAMPING@RESTORING/...` of the task's result.
    """

    damping: str
    restoring: str
    found: Mapping[str, Any]


@dataclass(frozen=True)
class EnvelopeContent:
    """The result of the comparison of damping models on an envelope (recorded amplitudes), without the verdict.

    unit: unit of the readings. samples: number of readings that were used. likelihoods: for each damping sum, the
    scalar fields of its likelihood as a function of the decay rates; the array fields are the arrays
    `likelihood/DAMPING/...` of the task's result. Sums whose terms have inferred parameters besides their coefficients,
    such as an exponent, are missing. `likelihoods` is empty if the record does not belong to a specimen, or if it
    contains no free decay. assumed: a sentence for each assumption.
    """

    unit: str
    samples: int = 0
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class AnswerContent(Content):
    """The answer on a record: the comparison of damping models, from the task `answer/...` or `sampled/NAME/REPEAT`.

    verdict: the conclusion, as `Verdict.to_dict` returns it, with amplitudes in the base unit, such as rad. candidates:
    results of the compared damping sums under each restoring law. rivals: results of other forms of damping, which the
    study does not compare. priors: descriptions of the priors of each candidate that was fitted. posteriors: posteriors
    of the candidates that were sampled, without unreliable ones; () from the task `answer`. laws: fits of the
    candidates that allow deviations from the laws. noise: name of the noise model that is used. noises: all noise
    models that were fitted. epsilon: velocity (rad/s or m/s) within which Coulomb friction changes its sign, as chosen
    by the comparison; None if it was given. envelope: further values for an envelope; its answer has only these and the
    verdict. If no model was compared (no free decay, or every fit failed), only `verdict` has a value.
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
    """What happened to each simulated record of one task of a calibration, which computes several records.

    outcomes: for each record, "ok" or why it is not used. accepted: for each record, whether it is usable. first:
    number of the first record, from 0; the following records have the next numbers.
    """

    outcomes: tuple[str, ...] = ()
    accepted: tuple[bool, ...] = ()
    first: int = 0


@dataclass(frozen=True)
class RanksContent(ChunkContent):
    """The ranks of true parameters among posterior draws, for the simulated records of one task `ranks/MODEL/FIRST`.

    The ranks themselves are the entry `ranks` of `arrays` of the same result file (`calibrate.ranks.compute_chunk`
    describes all its arrays). names: names of the ranked quantities: the parameters, and last the log likelihood.
    sampler_outcomes: for each sampler, its outcome on each record; "" if the record has no posterior mode. seconds:
    computing time by sampler, and under "record" that of simulation and fit.
    """

    model: str = ""
    names: tuple[str, ...] = ()
    sampler_outcomes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RecoveryContent(ChunkContent):
    """The outcomes of the evidence of each damping model, for the simulated records of one task `recovery/FIRST`.

    The task tests how often the true model has the most evidence. The log evidences, the probabilities and the true
    models are in `arrays` of the same result file (see `calibrate.recovery.compute_chunk`). models: names of the
    models. evidence_outcomes: for each record, the outcome of the evidence of each model: "ok", or why it is
    unreliable; "" for a model whose computation failed, and for the models after it.
    """

    models: tuple[str, ...] = ()
    evidence_outcomes: tuple[tuple[str, ...], ...] = ()
