"""Run a study on one or several processes, and resume an interrupted run.

- *task*: one computation. Its result is stored under a name, such as `mode/bench/0/viscous` (`store.results.TaskName`),
  and with a key: the hash of everything that the result depends on. If a result with the same key is stored, the task
  is not computed again.
- *job*: a list of tasks that one process computes one after another, such as all tasks of one damping model on one
  record.
- *stage*: a list of jobs that do not depend on each other. A run computes its stages in order (`jobs.stages`).
"""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Collection
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from bayesdamp.config import Recording, Study
from bayesdamp.interface.first_words import no_free_decay
from bayesdamp.interface.signal import Signal
from bayesdamp.machine import cores
from bayesdamp.physics.oscillator import reference_of
from bayesdamp.pipeline.answering import ANSWER, SAMPLED_ANSWER, stored_answer
from bayesdamp.pipeline.jobs import (
    Depth,
    Job,
    count_parallel_jobs,
    is_within,
    jobs_of,
    spec_of,
    stages,
    tasks_of,
)
from bayesdamp.pipeline.progress import Progress, describe_stage, progress_bar
from bayesdamp.pipeline.records import StudyRecord, keep_free_decay, read_free_decay, take_free_decay
from bayesdamp.pipeline.tables import write_tables, write_verdicts
from bayesdamp.pipeline.tasks import Task, compute_and_store, digest_of
from bayesdamp.pipeline.workers import KILLED_OUTCOME, is_kill, open_pool, restart, run_in_pool
from bayesdamp.plugins import use_modules
from bayesdamp.records.oscillation.features import features
from bayesdamp.sources import package_digest
from bayesdamp.store.results import Store, TaskName, TaskResult
from bayesdamp.types import InputError, Status, status_of
from bayesdamp.verdict.types import Verdict

if TYPE_CHECKING:
    from rich.console import Console

DONE, SOME_FAILED = 0, 3
"""Exit statuses of a run: `DONE` if no task failed, `SOME_FAILED` if at least one did."""
_ONE_AT_A_TIME = threading.Lock()
"""Lock that lets a process run only one job at a time, also on a Dask worker with several threads."""


def run_study(
    study: Study,
    out: Path,
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    console: Console | None = None,
    depth: Depth = Depth.WHOLE,
    on_verdict: Callable[[Verdict], None] | None = None,
    quiet: bool = False,
    checked: bool = False,
    pool: Executor | None = None,
) -> int:
    """Compute those results of a study that are not stored in its folder yet, and write tables and report.

    Parameters
    ----------
    study
        The study. Every record is read before anything is written, except with `checked`.
    out
        Folder of the run.
    workers
        Number of processes on this machine; by default one for each core, but no more than jobs can run at the same
        time.
    scheduler
        Address of a Dask scheduler, whose workers are used instead of processes on this machine.
    fresh
        Whether to delete the stored results and compute everything again.
    console
        Console that shows progress and failed tasks; by default standard error.
    depth
        Last step of the run, such as `Depth.ANSWER` for the answers alone.
    on_verdict
        Function that is called with the verdict on the first repeat of each signal: once when the models have been
        compared on all records by linear approximations, and again after sampling. If the study compares no models, it
        is called after the records are read. If it is None, each record is sampled as soon as its models have been
        compared, which is faster.
    quiet
        Whether to show failed tasks only.
    checked
        If true, the caller has already read every record, and the records are not read again before the run begins.
    pool
        Executor that runs the tasks, instead of new processes or a scheduler.

    Returns
    -------
    int
        The exit status: 0, or 3 if a task failed.

    Raises
    ------
    InputError
        The study or one of its files is wrong.
    """
    from rich.console import Console

    use_modules(study.plugins)
    console = console or Console(stderr=True)
    if not checked:
        read_records(study)
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        jobs = jobs_of(study)
        workers = workers or max(1, min(cores(), count_parallel_jobs(jobs, depth)))
        within = [job for job in jobs if is_within(job, depth)]
        names = dict.fromkeys(task.name for job in within for task in tasks_of(study, store, job))
        shown = Console(quiet=True) if quiet else console
        with (
            progress_bar(shown) as bar,
            nullcontext(pool) if pool else open_pool(workers, scheduler, console.print) as pool,
        ):
            progress = Progress(bar)
            for stage in stages(study, store, depth, answer_first=on_verdict is not None):
                if not stage:
                    continue
                progress.begin(describe_stage(study, stage), stage)
                _run_jobs(study, store, stage, pool, progress.advance)
                # Write the answer now, in case a later stage fails.
                if stage[0].task_group is not None:
                    current = Store(out, _current_keys(study, store))
                    _report_verdicts(study, current, on_verdict)
                    write_verdicts(study, current)
            progress.begin("drawing the report", ())
            write_tables(study, Store(out, _current_keys(study, store)))
            from bayesdamp.report.sections import render  # imports Jinja

            try:
                render(out, pool)
            except Exception as fault:
                if pool is None or not is_kill(fault):
                    raise
                restart(pool)
                render(out)
        results = ((n, store.find(n, arrays=False)) for n in names)
        failed = [(n, r.outcome) for n, r in results if r and status_of(r.outcome) is Status.FAILED]
        for name, outcome in failed:
            console.print(f"{name}: {outcome}", style="red", highlight=False)
        return SOME_FAILED if failed else DONE


def read_records(study: Study) -> None:
    """Check every recorded file of a study and its settings, before anything is written. Return nothing.

    A record of an oscillation is read, and the settings of its oscillator (`system`) are checked. An envelope is read,
    and the sums of damping terms to compare on it are checked. Simulated signals are not checked. Raises InputError for
    the first file, setting or sum that is wrong.
    """
    for spec in study.signals:
        source = spec.source
        if not isinstance(source, Recording):
            continue
        if spec.is_envelope:
            from bayesdamp.pipeline.envelopes import check_recording  # imports slowly

            check_recording(study, spec)
            continue
        signal = read_free_decay(source, spec.name)
        try:
            for system in (spec.system, *spec.alternatives):
                reference_of(system, features(signal))
        except InputError as error:
            raise InputError(error.what, f"signal[{spec.name}].system") from None


def _run_job(
    study: Study | bytes,
    folder: Path,
    job: Job,
    given_up: Collection[str] = (),
    code: str = "",
    decay: Signal | None = None,
) -> None:
    """Compute the tasks of a job that have no result yet, and store their results.

    If a task fails, the first line of its error message is stored in its outcome, and the other tasks are still
    computed. Only an InputError of a task, or a full disk (OSError), ends the job and is raised. InputError is also
    raised if this process runs other code than the process that started the run.

    Parameters
    ----------
    study
        The study; or its pickled bytes, which other processes get: it is pickled only once for all jobs (pickling a
        study of a thousand records takes 30 ms).
    folder
        Folder of the run.
    job
        The job.
    given_up
        Names of tasks that are not computed, because they killed their process before.
    code
        Digest of the package's code in the process that started the run; "" if the job runs in that process. Keys
        depend on the code, so a worker must run the same code.
    decay
        The free decay of the job's record, if the process that started the run has read it.
    """
    if code and code != package_digest():
        raise InputError("a worker runs another version of bayesdamp than this command; restart the workers")
    study = _unpickle(study) if isinstance(study, bytes) else study
    store = Store(folder)
    if decay is not None and isinstance(source := spec_of(study, job).source, Recording):
        keep_free_decay(source, job.signal, decay)
    # One BLAS thread: the number of threads changes the order of sums and so the last digits.
    with _ONE_AT_A_TIME, threadpool_limits(1, "blas"):
        use_modules(study.plugins)
        for task in tasks_of(study, store, job):
            if task.name not in given_up and not _is_done(store, task):
                compute_and_store(store, task)


_unpickle: Callable[[bytes], Study] = lru_cache(maxsize=1)(pickle.loads)


def _is_done(store: Store, task: Task) -> bool:
    """Return whether an undamaged result of a task is stored under its key, so that it need not be computed again.

    Return False for a task that failed, or was not computed because another task failed.
    """
    result = store.find(task.name)  # with its arrays, because a result with damaged arrays counts as missing
    return (
        result is not None
        and result.key == task.key
        and status_of(result.outcome) not in (Status.FAILED, Status.NOT_COMPUTED)
    )


def _report_verdicts(study: Study, store: Store, on_verdict: Callable[[Verdict], None] | None) -> None:
    """Call `on_verdict`, unless it is None, with each verdict on the first repeat of a signal.

    A study without samplers and evidence methods compares no models: it has verdicts only on measured records that are
    not a free decay.
    """
    if on_verdict is None:
        return
    for spec in study.signals:
        record, verdict = StudyRecord(study, spec, 0, store), None
        if study.has_answers:
            answer = stored_answer(record)
            verdict = answer and answer.verdict
        elif isinstance(spec.source, Recording) and not spec.is_envelope:
            verdict = no_free_decay(record.signal)
        if verdict is not None:
            on_verdict(verdict)


def _run_jobs(
    study: Study, store: Store, jobs: list[Job], pool: Executor | None, advance: Callable[[], None]
) -> None:
    """Run the jobs of a stage in the pool, or in this process if `pool` is None; call `advance` when a job ends."""
    if pool is None:
        for job in jobs:
            _run_job(study, store.folder, job)
            advance()
        return
    folder, code = store.folder.resolve(), package_digest()
    pickled = pickle.dumps(study)

    def next_task(job: Job, given_up: Collection[str]) -> str | None:
        undone = (t for t in tasks_of(study, store, job) if t.name not in given_up and not _is_done(store, t))
        return next((task.name for task in undone), None)

    def give_up(job: Job, name: str) -> None:
        key = next(task.key for task in tasks_of(study, store, job) if task.name == name)
        store.write(TaskResult(name, key, outcome=KILLED_OUTCOME))

    def submit(job: Job, given_up: Collection[str]) -> Future[None]:
        source = spec_of(study, job).source
        decay = take_free_decay(source, job.signal) if isinstance(source, Recording) else None
        return pool.submit(_run_job, pickled, folder, job, given_up, code, decay)

    run_in_pool(jobs, pool, submit, next_task, give_up, advance)


def _current_keys(study: Study, store: Store) -> dict[str, str]:
    """Return the keys of the stored results that are up to date, by task name.

    Results of an earlier version of the study or of the program are not included. A stored reason why a model was left
    out counts as a result.
    """
    current = {}
    kinds = [(name, TaskName.of(name).kind) for name in store.names()]
    stored = [name for name, kind in kinds if kind not in ("signal", ANSWER, SAMPLED_ANSWER)]
    for job in jobs_of(study):
        # Computing the keys of the tasks of single models is slow, and most runs have no results of such tasks.
        prefix = f"{job.signal}/{job.repeat}/{job.model}"
        if job.model is not None and not any(prefix in f"{name}/" for name in stored):
            continue
        for task in tasks_of(study, store, job):
            result = store.find(task.name, arrays=False)
            if result is not None and result.key in (task.key, digest_of(result.outcome, task.key)):
                current[task.name] = result.key
    return current
