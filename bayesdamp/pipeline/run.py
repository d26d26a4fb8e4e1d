"""Running a study: its cells on one or several processes, resumed where they were cut off."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Collection
from concurrent.futures import BrokenExecutor, Executor
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from bayesdamp.config import Recording, Study
from bayesdamp.interface.no_free_decay import no_free_decay
from bayesdamp.machine import cores
from bayesdamp.outcomes import Status, status_of
from bayesdamp.physics.oscillator import reference_of
from bayesdamp.pipeline.answering import ANSWERED, SAMPLED, asks_for_answers, verdict_of
from bayesdamp.pipeline.jobs import Depth, Job, count_parallel_jobs, is_within, jobs_of, stages, work_of
from bayesdamp.pipeline.progress import progress_on, words_of
from bayesdamp.pipeline.records import read_free_decay, signal_of
from bayesdamp.pipeline.tables import write_tables, write_verdicts
from bayesdamp.pipeline.tasks import digest, perform
from bayesdamp.pipeline.workers import KILLED, pool_of, restart, spread
from bayesdamp.plugins import use
from bayesdamp.records.oscillation.features import features
from bayesdamp.sources import package_digest
from bayesdamp.store import CellResult, Store
from bayesdamp.store.cells import Place
from bayesdamp.types import InputError
from bayesdamp.verdict.types import Verdict

if TYPE_CHECKING:
    from rich.console import Console

DONE, WRONG_CELLS = 0, 3
_ONE_AT_A_TIME = threading.Lock()
"""A process runs one job at a time, also where a Dask worker has several threads."""


def run_study(
    study: Study,
    out: Path,
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    console: Console | None = None,
    depth: Depth = Depth.WHOLE,
    answered: Callable[[Verdict], None] | None = None,
    quiet: bool = False,
    checked: bool = False,
) -> int:
    """Run the cells of a study that a folder lacks, and write tables and report.

    Parameters
    ----------
    study
        What to run. Every record is read before anything is written, except with `checked`.
    out
        The run's folder.
    workers
        Processes on this machine, None for as many as there are cores.
    scheduler
        Address of a Dask scheduler that is used in their place.
    fresh
        Whether to compute everything again.
    console
        For progress and failed cells.
    depth
        Where to stop.
    answered
        Called with each record's verdict as soon as there is one, and again once its motions are sampled.
    quiet
        Whether to show only failed cells.
    checked
        Whether the caller has found the free decay in every record already.

    Returns
    -------
    int
        The exit status, 0, or 3 with failed cells.

    Raises
    ------
    InputError
        The input is wrong.
    """
    from rich.console import Console

    use(study.plugins)
    console = console or Console(stderr=True)
    if not checked:
        read_records(study)
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        jobs = jobs_of(study)
        wanted = [job for job in jobs if is_within(job, depth)]
        workers = workers or max(1, min(cores(), count_parallel_jobs(jobs, depth)))
        names = [name for job in wanted for name in work_of(study, store, job)]
        shown = Console(quiet=True) if quiet else console
        with progress_on(shown) as progress, pool_of(workers, scheduler, console.print) as pool:
            if pool is not None and depth is Depth.WHOLE:
                pool.submit(_prepare)
                threading.Thread(target=_prepare, daemon=True).start()
            for stage in stages(study, store, depth):
                if not stage:
                    continue
                progress.begin(words_of(study, stage), stage)
                _run_jobs(study, store, stage, pool, lambda _: progress.advance())
                if stage[0].part == "read" and not asks_for_answers(study):
                    _report_verdicts(study, store, answered)
                if stage[0].part in (ANSWERED, SAMPLED):  # an answer is kept whatever comes later
                    current = Store(out, _current(study, store))
                    _report_verdicts(study, current, answered)
                    write_verdicts(study, current)
            progress.begin("drawing the report", ())
            write_tables(study, Store(out, _current(study, store)))
            from bayesdamp.report.render import render  # imports Matplotlib

            try:
                render(out, None if scheduler else pool)
            except BrokenExecutor:
                assert pool is not None
                restart(pool)
                render(out)
        cells = ((n, store.find(n, arrays=False)) for n in names)
        failed = [(n, c.outcome) for n, c in cells if c and status_of(c.outcome) is Status.FAILED]
        for name, outcome in failed:
            console.print(f"{name}: {outcome}", style="red", highlight=False)
        return WRONG_CELLS if failed else DONE


def read_records(study: Study) -> None:
    """Read every file and its system once, so that faults show before anything is written. Raises InputError."""
    for spec in study.signals:
        source = spec.source
        if not isinstance(source, Recording):
            continue
        if spec.is_envelope:
            from bayesdamp.pipeline.envelopes import check_recording  # imports slowly

            check_recording(study, spec)
            continue
        _, signal = read_free_decay(source, spec.name)
        try:
            for system in (spec.system, *spec.alternatives):
                reference_of(system, features(signal))
        except InputError as error:
            raise InputError(error.what, f"signal[{spec.name}].system") from None


def _run_job(
    study: Study | bytes, folder: Path, job: Job, given_up: Collection[str] = (), code: str = ""
) -> list[str]:
    """Compute the cells of a job that the folder lacks, and return the names of all its cells.

    A cell that fails is stored with its fault.

    Parameters
    ----------
    study
        Pickled once for all jobs where they run elsewhere (one of a thousand records takes 30 ms each time).
    folder
        The run's.
    job
        To do.
    given_up
        Cells that are not tried again.
    code
        Digest of the package of the command, where that is another process: its keys stand for its own code.
    """
    if code and code != package_digest():
        raise InputError("a worker runs another version of bayesdamp than this command; restart the workers")
    study = _unpickled(study) if isinstance(study, bytes) else study
    store, names = Store(folder), []
    # One thread for sums of linear algebra: their order, and the last digits, would depend on how many there are.
    with _ONE_AT_A_TIME, threadpool_limits(1, "blas"):
        use(study.plugins)
        for name, (key, make) in work_of(study, store, job).items():
            if name not in given_up and not _is_done(store, name, key):
                perform(store, name, key, make)
            names.append(name)
    return names


_unpickled: Callable[[bytes], Study] = lru_cache(maxsize=1)(pickle.loads)


def _is_done(store: Store, name: str, key: str) -> bool:
    """Return whether a cell has its result; one that failed is tried again, and so is what depends on it."""
    cell = store.find(name)  # with its arrays: a damaged one counts as absent
    return (
        cell is not None
        and cell.key == key
        and status_of(cell.outcome) not in (Status.FAILED, Status.NOT_COMPUTED)
    )


def _report_verdicts(study: Study, store: Store, answered: Callable[[Verdict], None] | None) -> None:
    """Call `answered` with the verdict on each record.

    Of a study that asks for none, these are the verdicts on measured records that are not a free decay.
    """
    if answered is None:
        return
    for spec in study.signals:
        verdict = None
        if asks_for_answers(study):
            verdict = verdict_of(store, spec.name, 0)
        elif isinstance(spec.source, Recording) and not spec.is_envelope:
            verdict = no_free_decay(signal_of(store.read(f"signal/{spec.name}/0")))
        if verdict is not None:
            answered(verdict)


def _run_jobs(
    study: Study,
    store: Store,
    jobs: list[Job],
    pool: Executor | None,
    advance: Callable[[list[str]], None],
) -> None:
    if pool is None:
        for job in jobs:
            advance(_run_job(study, store.folder, job))
        return
    folder, code = store.folder.resolve(), package_digest()
    pickled = pickle.dumps(study)

    def under_way(job: Job, given_up: Collection[str]) -> str | None:
        cells = {n: key for n, (key, _) in work_of(study, store, job).items() if n not in given_up}
        return next((n for n, key in cells.items() if not _is_done(store, n, key)), None)

    def give_up(job: Job, name: str) -> None:
        store.write(CellResult(name, work_of(study, store, job)[name][0], outcome=KILLED))

    spread(
        jobs,
        pool,
        lambda job, given_up: pool.submit(_run_job, pickled, folder, job, given_up, code),
        under_way,
        give_up,
        advance,
    )


def _prepare() -> None:
    """Import modules that are needed later, while the first record leaves processes idle."""
    for name in ("bayesdamp.report.render", "bayesdamp.inference.samplers.nuts", "arviz_base"):
        import_module(name)


def _current(study: Study, store: Store) -> dict[str, str]:
    """Return the keys of the stored cells that answer this study, by name, without those of an earlier question."""
    current = {}
    places = [(name, Place.of(name).kind) for name in store.names()]
    stored = [name for name, kind in places if kind not in ("signal", ANSWERED, SAMPLED)]
    for job in jobs_of(study):
        # Keys of candidates cost more than all else here, and most runs have none of their cells.
        path = f"{job.signal}/{job.repeat}/{job.model or ''}"
        is_of_candidates = job.model is not None or job.part == "average"
        if is_of_candidates and not any(path in f"{name}/" for name in stored):
            continue
        for name, (key, _) in work_of(study, store, job).items():
            cell = store.find(name, arrays=False)
            if cell is not None and cell.key in (key, digest(cell.outcome, key)):
                current[name] = cell.key
    return current
