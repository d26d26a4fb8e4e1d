"""Run a study from Python, and read the results of a run: its tables, and those of each model on each record."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from bayesdamp import types
from bayesdamp.config import Study, in_keys, load_study
from bayesdamp.config.checks import StudyError
from bayesdamp.config.load import resolve_study
from bayesdamp.formatting import Table, data_frame, digits
from bayesdamp.interface.result import ResultView, outcome_notes
from bayesdamp.pipeline import run
from bayesdamp.plugins import nearest
from bayesdamp.serial import split
from bayesdamp.store.files import TABLES, read_description, read_table
from bayesdamp.store.results import (
    EstimateContent,
    EvidenceContent,
    ModeContent,
    PosteriorContent,
    Store,
    TaskName,
    TaskResult,
)

if TYPE_CHECKING:
    import pandas as pd

PRINTED_CANDIDATES = 20
"""Greatest number of candidates that a printed `Run` lists."""


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(ResultView):
    """The results of a run for one damping model on one record.

    record: name of the signal. repeat: number of the repeat, from 0. damping, restoring: the damping sum, such as
    "viscous+coulomb", and the restoring law. values, sd: the inferred parameters at the posterior mode, by name and in
    their units, and their standard deviations; empty if there is no mode. log_posterior: log posterior density at the
    mode (nats, not normalised), for parameters that are transformed so that each has a standard normal prior; nan if
    there is no mode. estimates: for each estimator, its estimates at each stage. posteriors: the posterior by each
    sampler; its log likelihoods are nan if the file of its draws is missing. evidence: the log evidence by each method;
    nan if it gave none, or if it is nested sampling that was not needed as a check. outcome: the reason why there is no
    mode; "ok" if there is one, or if none was searched for.
    """

    record: str
    repeat: int
    damping: str
    restoring: str
    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    log_posterior: float = np.nan
    estimates: Mapping[str, tuple[types.Estimate, ...]] = field(default_factory=dict)
    posteriors: Mapping[str, types.Posterior] = field(default_factory=dict)
    evidence: Mapping[str, types.Evidence] = field(default_factory=dict)
    outcome: str = types.OK

    def _table(self) -> Table:
        rows = [(n, digits(v, n=6), digits(self.sd.get(n, np.nan), n=2)) for n, v in self.values.items()]
        finite = {m: e.log_evidence for m, e in self.evidence.items() if np.isfinite(e.log_evidence)}
        log_evidences = [f"{m} {digits(value, n=7)}" for m, value in finite.items()]
        more = {"estimates": self.estimates, "posteriors": self.posteriors, "log evidence": log_evidences}
        notes = outcome_notes(self.outcome, [f"{kind}: {', '.join(n)}" for kind, n in more.items() if n])
        title = f"{types.candidate_name(self.damping, self.restoring)} on {self.record}/{self.repeat}"
        return Table(("parameter", "value", "sd"), rows, caption=title, notes=notes)


@dataclass(frozen=True, eq=False, repr=False)
class Run(ResultView):
    """The results of a study, read from the folder of its run.

    folder: path of this folder, with tables, results of tasks, figures and report.html. name: name of the study.
    outcome: "ok", or a text with the number and the names of the tasks of the last complete run that failed, or whose
    results were damaged or replaced since.
    """

    folder: Path
    name: str
    outcome: str = types.OK

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """The table estimates.csv, with a row for each estimated parameter of a model by an estimator at a stage.

        A row contains the value with its standard error, and for a simulated record the true value and the error in per
        cent. The stages are the method's own estimate and the trajectory fit that starts from it. A stage without an
        estimate has one row, whose `outcome` says why.
        """
        return self._read("estimates.csv")

    @cached_property
    def posteriors(self) -> pd.DataFrame:
        """The table posteriors.csv, with a row for each parameter of a model (also derived ones) and sampler.

        A row contains mean, sd, quantiles, the shortest 95 % interval and the diagnostics of the sampler. A sampler
        without draws has one row, whose `outcome` says why.
        """
        return self._read("posteriors.csv")

    @cached_property
    def evidence(self) -> pd.DataFrame:
        """The table evidence.csv, with a row for each record, model and method.

        A row contains the log evidence with its standard error in nats, the log Bayes factor relative to the best model
        by the same method, and the posterior probability of the model (nan if the method lacks the evidence of a model
        that another method has, and for sequential Monte Carlo, "smc"). The method "combined" joins the results of the
        others.
        """
        return self._read("evidence.csv")

    @cached_property
    def fits(self) -> pd.DataFrame:
        """The table fits.csv, with a row for each record and model that was fitted or sampled in the answer.

        A row contains the rms of the residuals and the checks of the fit at the posterior mode (if it failed, `verdict`
        says why), and from the sampled answer the size of deviations from the damping law.
        """
        return self._read("fits.csv")

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """The results for each model on each record and repeat, sorted by the names of their tasks.

        Results that are damaged, or not of the last run, are left out.
        """
        description = read_description(self.folder)
        store = Store(self.folder, description.get("cells"))
        results: dict[tuple[str, int, str], list[TaskResult]] = {}
        for name in store.names():
            parts = TaskName.of(name)
            used = parts.kind in ("mode", "estimate", "posterior", "evidence")
            if used and parts.repeat is not None and (result := store.find(name)) is not None:
                key = parts.record, parts.repeat, parts.candidate
                results.setdefault(key, []).append(result)
        signals = (description.get("study") or {}).get("signals") or []
        laws = {s["name"]: (s.get("system") or {}).get("restoring") or "" for s in signals}
        return tuple(_candidate(self.folder, key, own, laws.get(key[0], "")) for key, own in results.items())

    def candidate(
        self, record: str, damping: str, restoring: str | None = None, repeat: int = 0
    ) -> Candidate:
        """Return the results for one model on one record.

        Parameters
        ----------
        record
            Name of the signal.
        damping
            The damping sum, such as "viscous+coulomb", with its terms in the order in which the run names them.
        restoring
            The restoring law; by default the first one with results.
        repeat
            Number of the repeat, from 0.

        Raises
        ------
        InputError
            If the run has no record or model of this name (the message suggests a similar name), or if this model was
            not run on this repeat of the record under this law.
        """
        for what, name, valid in (
            ("record", record, {c.record for c in self.candidates}),
            ("model", damping, {c.damping for c in self.candidates}),
        ):
            if name not in valid:
                raise types.InputError(
                    f"{self.name}: the run has no {what} {name!r}{nearest(name, sorted(valid))}"
                )
        wanted = record, damping, repeat
        for candidate in self.candidates:
            same = wanted == (candidate.record, candidate.damping, candidate.repeat)
            if same and restoring in (None, candidate.restoring):
                return candidate
        where = f"repeat {repeat} of {record} under {restoring or 'any law'}"
        raise types.InputError(f"{self.name}: {damping} was not run on {where}")

    @property
    def report(self) -> Path:
        """Path of the report, an HTML file in the folder of the run."""
        return self.folder / "report.html"

    def save(self, path: str | Path) -> Path:
        """Copy the folder of the run, without its lock and temporary files, to a new path, and return the path.

        Raises InputError if the path exists or cannot be written.
        """
        path = Path(path)
        try:
            shutil.copytree(self.folder, path, ignore=shutil.ignore_patterns(".lock", ".*.tmp"))
        except OSError as error:
            reason = error.strerror or error.args[0][0][-1]  # `shutil.Error` lists (source, target, reason)
            raise types.InputError(f"{path}: cannot be written ({reason}); give a new folder") from None
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read the run in a folder; nothing is computed. Raises InputError if the folder contains no run."""
        folder = Path(path)
        description = read_description(folder)
        name = (description.get("study") or {}).get("name")
        if name is None:
            right = "give the folder that run_study or the command study wrote"
            raise types.InputError(f"{folder}: its run.json does not contain a study; {right}")
        store = Store(folder, description.get("cells"))
        results = ((name, store.find(name, arrays=False)) for name in store.names())
        failed = [n for n, r in results if r is None or types.status_of(r.outcome) is types.Status.FAILED]
        outcome = f"{len(failed)} tasks failed: {', '.join(failed)}" if failed else types.OK
        return cls(folder, name, outcome)

    def _read(self, table: str) -> pd.DataFrame:
        return data_frame(read_table(self.folder / table), TABLES[table])

    def _table(self) -> Table:
        rows = tuple(
            (
                f"{c.record}/{c.repeat}",
                types.candidate_name(c.damping, c.restoring),
                ", ".join(f"{n} {digits(v)}" for n, v in c.values.items() if n in c.sd) or c.outcome,
            )
            for c in self.candidates[:PRINTED_CANDIDATES]
        )
        more = len(self.candidates) - PRINTED_CANDIDATES
        notes = (f"and {more} more",) if more > 0 else ()
        return Table(
            ("record", "model", "values"),
            rows,
            caption=f"Run of {self.name} in {self.folder}",
            notes=outcome_notes(self.outcome, notes),
        )


def run_study(
    study: Study | Mapping[str, Any] | str | Path,
    out: str | Path | None = None,
    *,
    workers: int = 1,
    fresh: bool = False,
) -> Run:
    """Compute those results of a study that are not stored in its folder yet, and write its tables and report.

    Parameters
    ----------
    study
        The path of a study file, a `Study` from `load_study`, or the content of a study file as a dictionary; paths in
        a dictionary are relative to the working directory.
    out
        Folder of the run; by default reports/NAME, as for the command `study`.
    workers
        Number of processes. With more than one, a script must call this under `if __name__ == "__main__"`.
    fresh
        Whether to delete the stored results and compute everything again.

    Returns
    -------
    Run
        The run. Its outcome names the tasks that failed.

    Raises
    ------
    InputError
        The study or one of its files is wrong, `workers` is not a whole number of at least 1, or `out` is a file or a
        folder that cannot be used: it contains files of others, or another process is writing to it.
    OSError
        A file cannot be written, for example because the disk is full.
    """
    from rich.console import Console

    if isinstance(study, str | Path):
        study = load_study(study)
    elif not isinstance(study, Study):
        if not isinstance(study, Mapping):
            kind = type(study).__name__
            raise types.InputError(
                f"run_study: the study is {kind}; it must be a file, a dictionary or a Study"
            )
        try:
            study = resolve_study(split(study), Path("study.toml"))
        except (StudyError, types.InputError, TypeError) as error:
            raise types.InputError(f"study: {error}") from None
    folder = Path("reports") / study.name if out is None else Path(out)
    if folder.exists() and not folder.is_dir():
        raise types.InputError(f"{folder}: is a file; out must be a folder, or a new name")
    if not hasattr(workers, "__index__") or workers < 1:
        raise types.InputError(f"run_study: workers is {workers!r}; it must be a whole number, 1 or more")
    with in_keys():
        run.run_study(study, folder, workers=workers, fresh=fresh, console=Console(stderr=True, quiet=True))
    return Run.load(folder)


def _candidate(folder: Path, key: tuple[str, int, str], results: Sequence[TaskResult], law: str) -> Candidate:
    """Combine the results of all tasks of one model on one record into a `Candidate`.

    key: name of the record, number of the repeat and name of the model. results: results of the tasks. law: the
    restoring law if the name of the model contains none.
    """
    record, repeat, name = key
    damping, restoring = types.candidate_parts(name)
    fit: dict[str, Any] = {}
    outcome = types.OK
    estimates: dict[str, tuple[types.Estimate, ...]] = {}
    posteriors: dict[str, types.Posterior] = {}
    evidence: dict[str, types.Evidence] = {}
    for result in results:
        kind, method = result.parts.kind, result.parts.method
        if kind == "mode":
            outcome = result.outcome
            if outcome == types.OK:
                mode = ModeContent.of(result)
                fit = {name: getattr(mode, name) for name in ("values", "sd", "log_posterior")}
        elif kind == "estimate":
            stages = EstimateContent.of(result).stages
            estimates[method] = tuple(replace(stage, estimator=method) for stage in stages)
        elif kind == "posterior":
            draws = result.arrays.get("draws", np.empty((0, 0, 0)))
            likelihood, content = np.full(draws.shape[:2], np.nan), PosteriorContent.of(result)
            if content.file and (folder / content.file).is_file():
                import xarray as xr

                with xr.open_datatree(folder / content.file, engine="h5netcdf") as tree:
                    likelihood = tree["/sample_stats/log_likelihood"].to_numpy()
            posteriors[method] = replace(
                content.posterior,
                draws=draws,
                log_likelihood=likelihood,
                summaries=content.summary,
                sampler=method,
                seconds=result.seconds,
                outcome=result.outcome,
            )
        else:
            content = EvidenceContent.of(result).evidence
            evidence[method] = content or types.Evidence(name, method, outcome=result.outcome)
    return Candidate(
        record=record,
        repeat=repeat,
        damping=damping,
        restoring=restoring or law,
        **fit,
        estimates=estimates,
        posteriors=posteriors,
        evidence=evidence,
        outcome=outcome,
    )
