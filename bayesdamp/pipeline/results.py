"""A study that has been run: its tables, and what was found for each candidate on each record."""

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
from bayesdamp.formatting import compact
from bayesdamp.interface.result import Shown, outcome_notes
from bayesdamp.outcomes import Status, status_of
from bayesdamp.plugins import nearest
from bayesdamp.serial import split
from bayesdamp.store import TABLES, CellResult, Store, read_table
from bayesdamp.store.cells import Place
from bayesdamp.store.contents import EstimateContent, EvidenceContent, ModeContent, PosteriorContent
from bayesdamp.store.files import read_description
from bayesdamp.table import Table
from bayesdamp.types import OK, InputError

if TYPE_CHECKING:
    import pandas as pd

MOST = 20
"""Candidates that a run prints."""
SOURCE = "study.toml"
"""What a study that is given as a dictionary is called where a file would be named."""


@dataclass(frozen=True, eq=False, repr=False)
class Candidate(Shown):
    """What a run found for one model on one record.

    record, repeat: the signal's name and which of its repeats, from 0. values, sd, log_posterior: of the mode, in
    natural units and, the last, per score; empty and nan where there is none. estimates: both stages by estimator;
    posteriors: by sampler; evidence: by method. outcome: "ok", or why there is no mode, in a sentence.
    """

    record: str
    repeat: int
    damping: str
    restoring: str
    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    log_posterior: float = float("nan")
    estimates: Mapping[str, tuple[types.Estimate, ...]] = field(default_factory=dict)
    posteriors: Mapping[str, types.Posterior] = field(default_factory=dict)
    evidence: Mapping[str, types.Evidence] = field(default_factory=dict)
    outcome: str = OK

    def _table(self) -> Table:
        rows = [(n, compact(v, 6), compact(self.sd.get(n, float("nan")), 2)) for n, v in self.values.items()]
        weighed = [
            f"{m} {compact(e.log_evidence, 7)}"
            for m, e in self.evidence.items()
            if np.isfinite(e.log_evidence)
        ]
        more = {"estimates": self.estimates, "posteriors": self.posteriors, "log evidence": weighed}
        notes = [f"{kind}: {', '.join(found)}" for kind, found in more.items() if found]
        title = f"{types.candidate_name(self.damping, self.restoring)} on {self.record}/{self.repeat}"
        return Table(
            ("parameter", "value", "sd"), rows, caption=title, notes=outcome_notes(self.outcome, notes)
        )


@dataclass(frozen=True, eq=False, repr=False)
class Run(Shown):
    """A study's run, as its folder holds it.

    folder: with tables, cells, figures and report.html. name: the study's. candidates: what was found, in the tables'
    order. outcome: "ok", or which tasks failed.
    """

    folder: Path
    name: str
    outcome: str = OK

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """A row for each estimated parameter: estimates.csv."""
        return self._read("estimates.csv")

    @cached_property
    def posteriors(self) -> pd.DataFrame:
        """A row for each parameter of each posterior: posteriors.csv."""
        return self._read("posteriors.csv")

    @cached_property
    def evidence(self) -> pd.DataFrame:
        """A row for each candidate and method: evidence.csv."""
        return self._read("evidence.csv")

    @cached_property
    def fits(self) -> pd.DataFrame:
        """A row for each candidate: fits.csv."""
        return self._read("fits.csv")

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """What was found for each model on each record."""
        store = Store(self.folder)
        cells: dict[tuple[str, int, str], list[CellResult]] = {}
        for name in store.names():
            place = Place.of(name)
            if place.kind in ("mode", "estimate", "posterior", "evidence") and place.repeat is not None:
                key = place.record, place.repeat, place.candidate
                cells.setdefault(key, []).append(store.read(name))
        signals = (read_description(self.folder).get("study") or {}).get("signals") or []
        laws = {s["name"]: (s.get("system") or {}).get("restoring") or "" for s in signals}
        return tuple(
            _candidate(self.folder, key, found, laws.get(key[0], "")) for key, found in cells.items()
        )

    def candidate(
        self, record: str, damping: str, restoring: str | None = None, repeat: int = 0
    ) -> Candidate:
        """What was found for one model on one record. Raises InputError, with the nearest name, where there is none."""
        for what, name, valid in (
            ("record", record, {c.record for c in self.candidates}),
            ("model", damping, {c.damping for c in self.candidates}),
        ):
            if name not in valid:
                raise InputError(f"{self.name}: no {what} {name!r}{nearest(name, sorted(valid))}")
        for found in self.candidates:
            law = restoring is None or found.restoring == restoring
            if law and (found.record, found.damping, found.repeat) == (record, damping, repeat):
                return found
        raise InputError(
            f"{self.name}: {damping} was not run on repeat {repeat} of {record} under {restoring or 'any law'}"
        )

    @property
    def report(self) -> Path:
        """The report, one HTML file."""
        return self.folder / "report.html"

    def save(self, path: str | Path) -> Path:
        """Copy its folder to a new one; the path. Raises InputError where there is something already."""
        path = Path(path)
        try:
            shutil.copytree(self.folder, path, ignore=shutil.ignore_patterns(".lock", ".*.tmp"))
        except OSError as error:
            raise InputError(
                f"{path}: cannot be written ({error.strerror or 'it exists'}); give a new folder"
            ) from None
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """The run in a folder. Raises InputError where there is none."""
        folder = Path(path)
        name = (read_description(folder).get("study") or {}).get("name")
        if name is None:
            raise InputError(
                f"{folder}: its run.json names no study; give the folder that run_study or the command wrote"
            )
        store = Store(folder)
        found = ((n, store.read(n).outcome) for n in store.names())
        failed = [n for n, outcome in found if status_of(outcome) is Status.FAILED]
        outcome = f"{len(failed)} tasks failed: {', '.join(failed)}" if failed else OK
        return cls(folder, name, outcome)

    def _read(self, table: str) -> pd.DataFrame:
        import pandas as pd

        return pd.DataFrame(read_table(self.folder / table), columns=list(TABLES[table]))

    def _table(self) -> Table:
        rows = tuple(
            (
                f"{c.record}/{c.repeat}",
                types.candidate_name(c.damping, c.restoring),
                ", ".join(f"{n} {v:.4g}" for n, v in c.values.items() if n in c.sd) or c.outcome,
            )
            for c in self.candidates[:MOST]
        )
        more = len(self.candidates) - MOST
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
    """Run what a folder does not hold yet of a study, and write its tables and report.

    study: a study file, what `load_study` gives, or the same tables as a dictionary (files in it are looked for in the
    working directory). out: the folder; reports/NAME by default, as for the command. workers: processes; with more than
    one, a script that is run has to stand under `if __name__ == "__main__"`. fresh: compute everything again.
    Cells that failed are named in the run's outcome. Raises InputError, one line, where the input is wrong.
    """
    from rich.console import Console

    from bayesdamp.pipeline import run_study as run

    loaded = _loaded(study)
    folder = Path("reports") / loaded.name if out is None else Path(out)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; out must be a folder, or a new name")
    if workers < 1:
        raise InputError(f"run_study: workers is {workers!r}; it must be a whole number, 1 or more")
    with in_keys():
        run(loaded, folder, workers=workers, fresh=fresh, console=Console(stderr=True, quiet=True))
    return Run.load(folder)


def _loaded(study: Study | Mapping[str, Any] | str | Path) -> Study:
    if isinstance(study, Study):
        return study
    if isinstance(study, str | Path):
        return load_study(study)
    if not isinstance(study, Mapping):
        raise InputError(
            f"run_study: the study is {type(study).__name__}; it must be a file, a dictionary or a Study"
        )
    try:
        return resolve_study(split(study), Path(SOURCE))
    except (StudyError, InputError, TypeError) as error:
        raise InputError(f"study: {error}") from None


def _candidate(folder: Path, key: tuple[str, int, str], cells: Sequence[CellResult], law: str) -> Candidate:
    damping, restoring = types.candidate_parts(key[2])
    mode = next((cell for cell in cells if cell.place.kind == "mode"), None)
    found = None if mode is None or mode.outcome != OK else ModeContent.of(mode)
    estimates: dict[str, tuple[types.Estimate, ...]] = {}
    posteriors: dict[str, types.Posterior] = {}
    evidence: dict[str, types.Evidence] = {}
    for cell in cells:
        kind, name = cell.place.kind, cell.place.method
        if kind == "estimate":
            estimates[name] = tuple(
                _with_trace(name, stage, cell) for stage in EstimateContent.of(cell).stages
            )
        elif kind == "posterior":
            posteriors[name] = _posterior(folder, name, cell)
        elif kind == "evidence":
            known = EvidenceContent.of(cell).evidence
            evidence[name] = known or types.Evidence(key[2], name, outcome=cell.outcome)
    return Candidate(
        record=key[0],
        repeat=key[1],
        damping=damping,
        restoring=restoring or law,
        values=found.values if found else {},
        sd=found.sd if found else {},
        log_posterior=found.log_posterior if found else float("nan"),
        estimates=estimates,
        posteriors=posteriors,
        evidence=evidence,
        outcome=OK if mode is None else mode.outcome,
    )


def _with_trace(estimator: str, stage: types.Estimate, cell: CellResult) -> types.Estimate:
    prefix = f"{stage.stage}/"
    trace = {n.removeprefix(prefix): a for n, a in cell.arrays.items() if n.startswith(prefix)}
    return replace(stage, estimator=estimator, trace=trace)


def _posterior(folder: Path, sampler: str, cell: CellResult) -> types.Posterior:
    draws = cell.arrays.get("draws", np.empty((0, 0, 0)))
    likelihood, content = np.empty(draws.shape[:2]), PosteriorContent.of(cell)
    if content.file and (folder / content.file).is_file():
        import xarray as xr

        with xr.open_datatree(folder / content.file, engine="h5netcdf") as tree:
            likelihood = np.asarray(tree["/log_likelihood/record"].to_numpy()[..., 0])
    found = replace(content.posterior, draws=draws, log_likelihood=likelihood, summaries=content.summary)
    return replace(found, sampler=sampler, seconds=cell.seconds, outcome=cell.outcome)
