"""Running a study: its cells on one or several processes, resumed where they were cut off."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from bayesdamp.config import Recording, SignalSpec, Study
from bayesdamp.inference.evidence.adopted import NESTED_CHECK
from bayesdamp.machine.cache_eviction import evict_programs
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline import pruning
from bayesdamp.pipeline.candidates.averaging import average, averages
from bayesdamp.pipeline.candidates.cells import Branch
from bayesdamp.pipeline.keys import digest, task_key
from bayesdamp.pipeline.many.many import joint_cells, populated, repeated
from bayesdamp.pipeline.progress import REPORT, Step, progress_on, step_of
from bayesdamp.pipeline.records.answering import ANSWERED, SAMPLED, AnswerCell, answers, verdict_of
from bayesdamp.pipeline.records.noise import NoiseCell, has_noise_cell
from bayesdamp.pipeline.records.records import SignalCell
from bayesdamp.pipeline.spread import KILLED, restart, spread
from bayesdamp.pipeline.tables.tables import write_tables
from bayesdamp.pipeline.tables.verdicts import write_verdicts
from bayesdamp.pipeline.workers import cache_compilations, pool_of
from bayesdamp.plugins import use
from bayesdamp.sources import package_digest
from bayesdamp.store import CellResult, Store
from bayesdamp.types import OK, InputError
from bayesdamp.verdict.types import Verdict

if TYPE_CHECKING:
    from rich.console import Console

DONE, WRONG_CELLS = 0, 3
_ONE_AT_A_TIME = threading.Lock()
"""A process has one job under way, also where a Dask worker has several threads."""


class Depth(StrEnum):
    """How far a run goes: to the answer from linear models, to its motions sampled, or to everything that the study
    asks of samplers and evidence under exact laws."""

    ANSWER = "answer"
    SAMPLED = "sampled"
    WHOLE = "whole"


@dataclass(frozen=True)
class Cell:
    """One unit of work, by its name, such as `posterior/bench/0/viscous/nuts`."""

    name: str


@dataclass(frozen=True)
class Job:
    """What one worker does in a row: a record itself (model None), the fit of all its dampings under a law, the choice
    of its "noise" from these, one candidate's branch on it, or, once all of these are done, what joins them: an
    "average" over models, a "specimen" of several records (signal is then its name), the "population" of all specimens.

    part: of a record "read", "answer" or "sampled"; of a branch "look" (estimates, mode, Laplace's evidence), "weigh"
    (the other evidence) or "sample"; None for all of it.
    """

    signal: str
    repeat: int
    model: str | None = None
    joined: str = ""
    part: str | None = None
    law: str | None = None


def cells(study: Study) -> list[Cell]:
    """Every cell of a study, in an order in which they could run. Nothing is computed."""
    use(study.plugins)
    store = Store(Path("."))
    found: list[Cell] = []
    for job in _jobs(study):
        found += [Cell(name) for name in _work(study, store, job)]
    return found


def run_study(
    study: Study,
    out: Path,
    workers: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    console: Console | None = None,
    pool: Executor | None = None,
    depth: Depth = Depth.WHOLE,
    answered: Callable[[Verdict], None] | None = None,
    quiet: bool = False,
) -> int:
    """Run what `out` does not hold yet, write tables and report; the exit status (0, or 3 with failed cells).

    depth: where to stop; answered: told of each record's verdict as soon as it is there, and again once its motions
    are sampled; quiet: without progress, but not without what failed.
    workers: processes on this machine, None for as many as there are cores; scheduler: address of a Dask
    scheduler in their place; pool: where jobs run, in place of either.
    Raises InputError where the input is wrong; every record is read before anything is written.
    """
    from rich.console import Console

    use(study.plugins)
    console = console or Console(stderr=True)
    _read_inputs(study)
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        jobs = _jobs(study)
        wanted = [job for job in jobs if _within(job, depth)]
        workers = workers or max(1, min(len(os.sched_getaffinity(0)), _side_by_side(jobs, depth)))
        names = [name for job in wanted for name in _work(study, store, job)]
        with progress_on(Console(quiet=True) if quiet else console) as progress:
            with pool_of(workers, scheduler, pool) as pool:
                if pool is not None and depth is Depth.WHOLE:
                    pool.submit(_prepare)
                    threading.Thread(target=_prepare, daemon=True).start()
                for stage in _stages(study, store, depth):
                    if stage:
                        progress.begin(step_of(study, stage))
                    _run_jobs(study, store, stage, pool, lambda _: progress.advance())
                    if stage and stage[0].part in (ANSWERED, SAMPLED):
                        current = Store(out, _current(study, store))
                        _tell(study, current, answered)
                        if depth is not Depth.ANSWER:  # an answer is kept whatever becomes of the proof
                            write_verdicts(study, current)
                progress.begin(Step(REPORT, "drawing the report", 1))
                write_tables(study, Store(out, _current(study, store)))
                _render(out, None if scheduler else pool)
            progress.end()
        failed = [(n, c.outcome) for n, c in _results(store, names) if status_of(c.outcome) is Status.FAILED]
        for name, outcome in failed:
            console.print(f"{name}: {outcome}", style="red", highlight=False)
        return WRONG_CELLS if failed else DONE


def _within(job: Job, depth: Depth) -> bool:
    """Whether a run of this depth comes to a job."""
    last = {Depth.ANSWER: ("read", ANSWERED), Depth.SAMPLED: ("read", ANSWERED, SAMPLED)}.get(depth)
    return last is None or (job.part in last and job.model is None)


def _side_by_side(jobs: list[Job], depth: Depth) -> int:
    """How many jobs of a run could be under way at once: candidates, or records, each of which is answered by threads
    of one process."""
    if depth is Depth.WHOLE:
        return sum(job.model is not None for job in jobs)
    return sum(job.part == "read" for job in jobs)


def _jobs(study: Study) -> list[Job]:
    # Repeat by repeat over all signals, so that a run which is cut off has a little of everything.
    most = max(s.repeats for s in study.signals)
    records = [(s, r) for r in range(most) for s in study.signals if r < s.repeats]
    parts = ("read", *((ANSWERED, SAMPLED) if answers(study) else ()))
    first = [Job(s.name, r, part=part) for part in parts for s, r in records]
    noisy = [(s, r) for s, r in records if has_noise_cell(study)]
    first += [Job(s.name, r, law=law) for s, r in noisy for law in s.restoring]
    first += [Job(s.name, r, joined="noise") for s, r in noisy]
    last = [Job(s.name, 0, joined="average") for s in study.signals if averages(study, s)]
    last += [Job(name, 0, joined="specimen") for name in repeated(study)]
    last += [Job("specimens", 0, joined="population")] if populated(study) else []
    return [*first, *(Job(s.name, r, m) for s, r in records for m in study.compare(s)), *last]


def _spec(study: Study, name: str) -> SignalSpec:
    return next(s for s in study.signals if s.name == name)


def _work(study: Study, store: Store, job: Job) -> dict[str, tuple[str, Callable[[str, str], None]]]:
    """The cells of a job: name to key and what computes it."""
    if job.joined in ("specimen", "population"):
        return joint_cells(study, store, None if job.joined == "population" else job.signal)
    spec = _spec(study, job.signal)
    if job.law is not None or job.joined == "noise":
        noise = NoiseCell(study, spec, job.repeat, store)
        one = noise if job.law is None else noise.fits[job.law]
        return {one.name: (one.key, lambda *_: one.compute())}
    if job.joined:
        branches = [Branch(study, spec, job.repeat, m, store).cells() for m in study.compare(spec)]
        key = task_key("averaged", branches)
        return {f"averaged/{spec.name}/{job.repeat}": (key, partial(average, study, spec, store))}
    if job.model is None:
        return _of_record(study, spec, store, job)
    branch = Branch(study, spec, job.repeat, job.model, store)
    return {
        name: (key, branch.compute)
        for name, key in branch.cells().items()
        if job.part is None or job.part == _part(name)
    }


def _of_record(
    study: Study, spec: SignalSpec, store: Store, job: Job
) -> dict[str, tuple[str, Callable[[str, str], None]]]:
    """The cell of a record itself: the record as read, or the verdict on it."""
    if job.part == "read":
        cell = SignalCell(study, spec, job.repeat, store)
        return {cell.name: (cell.key, lambda *_: cell.compute())}
    answer = AnswerCell(study, spec, job.repeat, store, sample=job.part == SAMPLED)
    return {answer.name: (answer.key, lambda *_: answer.compute())}


def _part(name: str) -> str:
    kind, method = name.partition("/")[0], name.rpartition("/")[2]
    if kind == "sensitivity" and method != "savage_dickey":
        return "depend"
    if kind in ("posterior", "sensitivity") or method in ("bridge", NESTED_CHECK):
        return "sample"
    return "weigh" if kind == "curve" or (kind == "evidence" and method != "laplace") else "look"


def _read_inputs(study: Study) -> None:
    """Read every file once, so that a wrong one is told before anything is written."""
    from bayesdamp.pipeline.records.recorded import cleaned

    for spec in study.signals:
        source = spec.source
        if not isinstance(source, Recording):
            continue
        try:
            cleaned(source, spec.name)
        except InputError as error:
            text = str(error)
            where = "" if source.file in text or str(source.path) in text else f"{source.file}: "
            raise InputError(f"{where}{text}") from None


def _run_job(
    study: Study, folder: Path, job: Job, given_up: Collection[str] = (), code: str = ""
) -> list[str]:
    """Compute the cells of a job that the folder lacks; a cell that fails is stored with what went wrong.

    given_up: cells that are not to be tried again. code: the digest of the package that asks, where that is another
    process; results of other code would stand under its keys.
    """
    if code and code != package_digest():
        raise InputError("a worker runs another version of bayesdamp than this command; restart the workers")
    with _ONE_AT_A_TIME:
        use(study.plugins)
        return _computed(study, folder, job, given_up)


def _computed(study: Study, folder: Path, job: Job, given_up: Collection[str]) -> list[str]:
    cache_compilations()
    evict_programs()
    store = Store(folder)
    done = []
    for name, (key, compute) in _work(study, store, job).items():
        if name not in given_up and not _done(store, name, key):
            try:
                compute(name, key)
            except (InputError, KeyboardInterrupt):
                raise
            except Exception as fault:
                if os.environ.get("BAYESDAMP_DEBUG"):
                    raise
                first = str(fault).strip().splitlines()
                text = Status.FAILED.because(f"{type(fault).__name__}: {first[0] if first else ''}")
                store.write(CellResult(name, key, outcome=text))
        done.append(name)
    return done


def _done(store: Store, name: str, key: str) -> bool:
    """Whether a cell has its result; one that failed is tried again, and what depends on it."""
    try:
        found = store.read(name)
    except KeyError:
        return False
    return found.key == key and status_of(found.outcome) not in (Status.FAILED, Status.NOT_COMPUTED)


def _tell(study: Study, store: Store, answered: Callable[[Verdict], None] | None) -> None:
    for spec in study.signals if answered else ():
        verdict = verdict_of(store, spec.name, 0)
        if answered and verdict is not None:
            answered(verdict)


def _stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Jobs that may run side by side, stage by stage; what a stage holds may depend on what was found before it."""
    jobs = _jobs(study)
    # Records first: every other task reads its record from the store.
    for part, last in (("read", None), (ANSWERED, Depth.ANSWER), (SAMPLED, Depth.SAMPLED)):
        yield [job for job in jobs if job.part == part and job.model is job.law is None]
        if depth is last:
            return
    yield [job for job in jobs if job.law is not None]
    yield [job for job in jobs if job.joined == "noise"]
    if pruning.staged(study):
        yield from _staged(study, store)
    else:
        yield [job for job in jobs if job.model is not None]
    yield [job for job in jobs if job.joined in ("average", "specimen")]
    yield [job for job in jobs if job.joined == "population"]


def _staged(study: Study, store: Store) -> Iterator[list[Job]]:
    """The branches of a study that leaves candidates out as it goes."""
    records = [(s, r) for s in study.signals for r in range(s.repeats)]
    records = [(s, r) for s, r in records if store.read(f"signal/{s.name}/{r}").outcome == OK]
    # With one law alone there is none to leave out, and its candidates need not wait for one another.
    short = _kept(study, store, records, pruning.listed, "look")
    by_record = {(s.name, r): set(pruning.heads(study, s)) for s, r in records if len(s.restoring) > 1}
    yield [job for job in short if job.model in by_record.get((job.signal, job.repeat), {job.model})]
    yield _kept(study, store, records, pruning.laws_left, "look")
    yield _kept(study, store, records, pruning.candidates_left, "weigh")
    last: list[Job] = []
    for part, chosen in (("sample", pruning.best_of), ("depend", pruning.likely)):
        for s, r in records:
            left = chosen(study, s, r, store)
            last += [Job(s.name, r, name, part=part) for name in left]
            for name in set(study.compare(s)) - set(left):
                cells = _work(study, store, Job(s.name, r, name, part=part))
                stale = {n: key for n, (key, _) in cells.items() if n in store.names()}
                pruning.set_aside(store, stale, pruning.NOT_SAMPLED)
    yield last


def _kept(
    study: Study,
    store: Store,
    records: list[tuple[SignalSpec, int]],
    judge: Callable[[Study, SignalSpec, int, Store], dict[str, str]],
    part: str,
) -> list[Job]:
    """The jobs of the candidates that a judge leaves; the evidence of the others gets its sentence."""
    found = []
    for spec, repeat in records:
        for name, why in judge(study, spec, repeat, store).items():
            job = Job(spec.name, repeat, name, part=part)
            if why:
                cells = {n: key for n, (key, _) in _work(study, store, job).items()}
                pruning.set_aside(store, {n: k for n, k in cells.items() if n.startswith("evidence/")}, why)
            else:
                found.append(job)
    return found


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

    def under_way(job: Job, given_up: Collection[str]) -> str | None:
        cells = {n: key for n, (key, _) in _work(study, store, job).items() if n not in given_up}
        return next((n for n, key in cells.items() if not _done(store, n, key)), None)

    def give_up(job: Job, name: str) -> None:
        store.write(CellResult(name, _work(study, store, job)[name][0], outcome=KILLED))

    spread(
        jobs,
        pool,
        lambda job, given_up: pool.submit(_run_job, study, folder, job, given_up, code),
        under_way,
        give_up,
        advance,
    )


def _prepare() -> None:
    """Import what is needed later, while the first record leaves processes idle."""
    for name in ("bayesdamp.report", "bayesdamp.inference.samplers.nuts", "arviz_base"):
        import_module(name)


def _render(out: Path, pool: Executor | None) -> None:
    from bayesdamp.report import render

    try:
        render(out, pool)
    except BrokenExecutor:
        assert pool is not None
        restart(pool)
        render(out)


def _current(study: Study, store: Store) -> dict[str, str]:
    """Name to key of the stored cells that answer this study; those of an earlier question are not among them."""
    found = {}
    stored = store.names()
    for job in _jobs(study):
        # Keys of candidates cost more than all else here, and most runs have none of their cells.
        path = f"{job.signal}/{job.repeat}/{job.model or ''}"
        of_candidates = job.model is not None or job.joined == "average"
        if of_candidates and not any(path in f"{name}/" for name in stored if _of_candidate(name)):
            continue
        for name, (key, _) in _work(study, store, job).items():
            try:
                own, outcome = store.head(name)
            except KeyError:
                continue
            if own in (key, digest(outcome, key)):
                found[name] = own
    return found


def _of_candidate(name: str) -> bool:
    """Whether a cell is one of a candidate, or of the average over them."""
    return name.partition("/")[0] not in ("signal", ANSWERED, SAMPLED, "fitted", "noise")


def _results(store: Store, names: list[str]) -> Iterator[tuple[str, CellResult]]:
    for name in names:
        try:
            yield name, store.read(name)
        except KeyError:
            continue
