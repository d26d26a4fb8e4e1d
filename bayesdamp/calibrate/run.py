"""Run a calibration: simulate and analyse records, and write tables and report.

A series is a set of simulated records of one kind, such as those that are drawn from one damping model. Its records are
divided into chunks of a few successive records. A task simulates and analyses one chunk, and its result is stored, so
that an interrupted calibration resumes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import ModuleType

from rich.console import Console

from bayesdamp.calibrate import ranks, recovery, tables
from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.machine import cores
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.progress import progress_bar
from bayesdamp.pipeline.tasks import Task, compute_and_store, task_key
from bayesdamp.pipeline.workers import open_pool
from bayesdamp.plugins import use_modules
from bayesdamp.store.files import SCHEMA, write_json, write_table
from bayesdamp.store.results import RanksContent, Store, TaskResult, provenance
from bayesdamp.types import OK, Status, status_of

RECOVERY = "recovery"
"""Name of the series of simulated records that tests the probabilities of models (model recovery)."""
DONE, SOME_FAILED = 0, 3
"""Exit statuses: `DONE` if everything is computed, `SOME_FAILED` if the program failed on some records."""


@dataclass(frozen=True)
class RecordSeries:
    """A series of simulated records, which tests posteriors of one damping model or the probabilities of all models.

    records: number of records, which is rounded up to whole tasks. model: the model whose posteriors are tested; empty
    if the probabilities of all models of the study are tested.
    """

    records: int
    model: str = ""

    @property
    def name(self) -> str:
        """Name of the series, such as "ranks/viscous" for a model."""
        return f"ranks/{self.model}" if self.model else RECOVERY

    @property
    def module(self) -> ModuleType:
        """The module that computes the tasks of the series: `ranks` or `recovery`."""
        return ranks if self.model else recovery

    def task(self, study: Study, first: int) -> Task:
        """Return the task that begins with record number `first` of this series.

        A name is, for example, `ranks/viscous/000016`. The key is a digest of all settings and sources on which the
        result depends; a stored result with this key is not computed again.
        """
        terms = {t: None for s in study.signals for m in study.dampings(s) for t in m.split("+")}
        laws = dict.fromkeys(law for s in study.signals for law in s.restoring)
        # Plug-ins are looked up by name, not imported, so their source is added to the key.
        sources = [*map(TERMS.source, terms), *map(LAWS.source, laws), *map(NOISES.source, study.noises)]
        sources += [*map(SAMPLERS.source, study.calibration.samplers), EVIDENCES.source("importance")]
        key = task_key("calibration", self.name, first, self.module.key_parts(study), sources)
        compute = partial(self.module.compute_chunk, study, self.model or RECOVERY, first)
        return Task(f"{self.name}/{first:06d}", key, compute)


def run_calibration(
    study: Study,
    out: Path,
    *,
    records: int | None = None,
    models: bool = False,
    workers: int | None = None,
    fresh: bool = False,
    report: bool = True,
    console: Console | None = None,
) -> int:
    """Compute the results that the folder `out` does not contain yet, and write tables and report into this folder.

    If no task succeeds, neither tables nor report are written.

    Parameters
    ----------
    study
        The study.
    out
        The folder of the results.
    records
        Number of simulated records, instead of the study's: for each model, or with `models` for all models together.
        It is rounded up to whole tasks (`RECORDS_PER_TASK` of `ranks` and `recovery`).
    models
        If True, test the probabilities of models (model recovery). If False, test the posteriors of parameters.
    workers
        Number of processes; by default the number of cores.
    fresh
        Whether stored results of tasks in `out` are deleted first, so that everything is computed again.
    report
        Whether report.html is written.
    console
        Where progress is shown; by default stderr.

    Returns
    -------
    int
        The exit status: 0, or 3 if the program failed on some records or tasks. The verdict "wrong" of a test is a
        result, not a failure.

    Raises
    ------
    InputError
        If the study cannot be calibrated, if `out` contains files that no run wrote, or if another run is writing
        there; then nothing is computed. Also if no record of a model can be simulated (`Generator.draw`); results that
        are already stored stay there.
    """
    console = console or Console(stderr=True)
    if records is not None:
        study = replace(
            study,
            calibration=study.calibration.model_copy(update={"records": records}),
            recovery=study.recovery.model_copy(update={"records": records}),
        )
    if models:
        recovery.check(study)
        every = [RecordSeries(study.recovery.records)]
    else:
        ranks.check(study)
        every = [RecordSeries(study.calibration.records, m) for m in study.compare(study.signals[0])]
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        results = compute_series(study, every, store, workers, console)
        failed = [c for chunks in results.values() for c in chunks if status_of(c.outcome) is Status.FAILED]
        whole = {name: [c for c in chunks if c.outcome == OK] for name, chunks in results.items()}
        whole = {name: chunks for name, chunks in whole.items() if chunks}
        if whole:
            _write(study, store, whole, models)
            if report:
                from bayesdamp.report.sections import render

                render(out)
        lines = [f"{chunk.name}: {chunk.outcome}" for chunk in failed]
        for name, content in ((n, RanksContent.of(c)) for n, chunks in whole.items() for c in chunks):
            each = zip(content.outcomes, *content.sampler_outcomes.values())
            for number, outcomes in enumerate(each, content.first):
                wrong = [o for o in outcomes if status_of(o) is Status.FAILED]
                lines += [f"{name}, record {number}: {outcome}" for outcome in wrong]
        for line in lines:
            console.print(line, style="red", highlight=False)
        return SOME_FAILED if lines else DONE


def _write(study: Study, store: Store, results: Mapping[str, Sequence[TaskResult]], models: bool) -> None:
    """Write run.json and the tables of a calibration into the folder of the store.

    models: True for a model recovery, whose table is recovery.csv; False for a test of posteriors, whose tables are
    calibration.csv and ranks.csv. results: results of the successful tasks by the name of their series.
    """
    if models:
        columns, rows = tables.recovery_table(results[RECOVERY])
        write_table(store.folder / "recovery.csv", columns, rows)
        summary = tables.recovery_summary(results[RECOVERY])
    else:
        rows = tables.calibration_rows(study, results)
        write_table(store.folder / "calibration.csv", tables.COLUMNS, rows)
        write_table(store.folder / "ranks.csv", tables.RANK_COLUMNS, tables.rank_rows(study, results))
        summary = tables.calibration_summary(study, results, rows)
    info = {
        "name": study.name,
        "description": study.description,
        "seed": study.seed,
        "kind": "model recovery" if models else "calibration",
        "schema": SCHEMA,
        "study": study.resolved(),
        **provenance(),
        "result": summary,
    }
    write_json(store.folder / "run.json", info)


def compute_series(
    study: Study, every: Sequence[RecordSeries], store: Store, workers: int | None, console: Console
) -> dict[str, list[TaskResult]]:
    """Compute the tasks of every series of simulated records, and return their results by the name of the series.

    The results of a series are in the order of its records. Stored results are read instead of computed. workers:
    number of processes; None for one on each core.
    """
    results: dict[str, list[TaskResult]] = {s.name: [] for s in every}
    tasks = [(s, first) for s in every for first in range(0, s.records, s.module.RECORDS_PER_TASK)]
    with progress_bar(console) as progress, open_pool(workers or cores(), None) as pool:
        bar = progress.add_task("simulating records", total=len(tasks))
        compute = partial(_compute_task, study, store.folder.resolve())
        for (series, _), chunk in zip(tasks, (pool.map if pool else map)(compute, *zip(*tasks)), strict=True):
            results[series.name].append(chunk)
            progress.advance(bar)
    return results


def _compute_task(study: Study, folder: Path, series: RecordSeries, first: int) -> TaskResult:
    """Return the result of one task; compute and store it first if necessary.

    This is necessary if the store in `folder` does not contain the result, if the stored result has another key, or if
    the program failed in it. first: number of the task's first record in the series.
    """
    use_modules(study.plugins)
    store, task = Store(folder), series.task(study, first)
    stored = store.find(task.name)
    if stored is None or stored.key != task.key or status_of(stored.outcome) is Status.FAILED:
        compute_and_store(store, task)
    return store.read(task.name)
