"""What a study has to do: its cells, the jobs that compute them, and in which order jobs may run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence.adopted import NESTED_CHECK
from bayesdamp.pipeline import pruning
from bayesdamp.pipeline.candidates.averaging import average, averages
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.cells import cells_of, compute
from bayesdamp.pipeline.envelopes import EnvelopeCell
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.many.many import joint_cells, populated, repeated
from bayesdamp.pipeline.records.answering import ANSWERED, SAMPLED, AnswerCell, answers
from bayesdamp.pipeline.records.records import SignalCell
from bayesdamp.plugins import use
from bayesdamp.store import Store
from bayesdamp.store.places import Place
from bayesdamp.types import OK


class Depth(StrEnum):
    """How far a run goes: to the answer from linear models, to its motions sampled, or to everything that the study
    asks of samplers and evidence."""

    ANSWER = "answer"
    SAMPLED = "sampled"
    WHOLE = "whole"


@dataclass(frozen=True)
class Cell:
    """One unit of work, by its name, such as `posterior/bench/0/viscous/nuts`."""

    name: str


@dataclass(frozen=True)
class Job:
    """What one worker does in a row: a record itself (model None), one candidate's branch on it, or, once all of these
    are done, what joins them: an
    "average" over models, a "specimen" of several records (signal is then its name), the "population" of all specimens.

    part: of a record "read", "answer" or "sampled"; of a branch "look" (estimates, mode, Laplace's evidence), "weigh"
    (the other evidence) or "sample"; None for all of it.
    """

    signal: str
    repeat: int
    model: str | None = None
    joined: str = ""
    part: str | None = None


def cells(study: Study) -> list[Cell]:
    """Every cell of a study, in an order in which they could run. Nothing is computed."""
    use(study.plugins)
    store = Store(Path("."))
    found: list[Cell] = []
    for job in jobs_of(study):
        found += [Cell(name) for name in work_of(study, store, job)]
    return found


def within(job: Job, depth: Depth) -> bool:
    """Whether a run of this depth comes to a job."""
    last = {Depth.ANSWER: ("read", ANSWERED), Depth.SAMPLED: ("read", ANSWERED, SAMPLED)}.get(depth)
    return last is None or (job.part in last and job.model is None)


def side_by_side(jobs: list[Job], depth: Depth) -> int:
    """How many jobs of a run could be under way at once: candidates, or records, each of which is answered by threads
    of one process."""
    records = len({(job.signal, job.repeat) for job in jobs})
    return max(records, sum(job.model is not None for job in jobs)) if depth is Depth.WHOLE else records


def jobs_of(study: Study) -> list[Job]:
    """Every job of a study, records first."""
    # Repeat by repeat over all signals, so that a run which is cut off has a little of everything.
    most = max(s.repeats for s in study.signals)
    records = [(s, r) for r in range(most) for s in study.signals if r < s.repeats]
    parts = ("read", *((ANSWERED, SAMPLED) if answers(study) else ()))
    # The one task of an envelope reads it too.
    first = [
        Job(s.name, r, part=part)
        for part in parts
        for s, r in records
        if part == ANSWERED or not s.is_envelope
    ]
    last = [Job(s.name, 0, joined="average") for s in study.signals if averages(study, s)]
    last += [Job(name, 0, joined="specimen") for name in repeated(study)]
    last += [Job("specimens", 0, joined="population")] if populated(study) else []
    return [*first, *(Job(s.name, r, m) for s, r in records for m in study.compare(s)), *last]


def spec_of(study: Study, name: str) -> SignalSpec:
    """The signal of this name."""
    return next(s for s in study.signals if s.name == name)


def work_of(study: Study, store: Store, job: Job) -> dict[str, tuple[str, Callable[[str, str], None]]]:
    """The cells of a job: name to key and what computes it."""
    if job.joined in ("specimen", "population"):
        return joint_cells(study, store, None if job.joined == "population" else job.signal)
    spec = spec_of(study, job.signal)
    if job.joined:
        branches = [cells_of(Branch(study, spec, job.repeat, m, store)) for m in study.compare(spec)]
        key = task_key("averaged", branches)
        return {f"averaged/{spec.name}/{job.repeat}": (key, partial(average, study, spec, store))}
    if job.model is None:
        return _of_record(study, spec, store, job)
    branch = Branch(study, spec, job.repeat, job.model, store)
    return {
        name: (key, partial(compute, branch))
        for name, key in cells_of(branch).items()
        if job.part is None or job.part == _part(name)
    }


def _of_record(
    study: Study, spec: SignalSpec, store: Store, job: Job
) -> dict[str, tuple[str, Callable[[str, str], None]]]:
    """The cell of a record itself: the record as read, or the verdict on it."""
    if spec.is_envelope:
        envelope = EnvelopeCell(study, spec, store)
        return {envelope.name: (envelope.key, lambda *_: envelope.compute())}
    if job.part == "read":
        cell = SignalCell(study, spec, job.repeat, store)
        return {cell.name: (cell.key, lambda *_: cell.compute())}
    answer = AnswerCell(study, spec, job.repeat, store, sample=job.part == SAMPLED)
    return {answer.name: (answer.key, lambda *_: answer.compute())}


def _part(name: str) -> str:
    place = Place.of(name)
    kind, method = place.kind, place.method
    if kind == "sensitivity" and method != "savage_dickey":
        return "depend"
    if kind in ("posterior", "sensitivity") or method in ("bridge", NESTED_CHECK):
        return "sample"
    return "weigh" if kind == "curve" or (kind == "evidence" and method != "laplace") else "look"


def stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Jobs that may run side by side, stage by stage; what a stage holds may depend on what was found before it."""
    jobs = jobs_of(study)
    # Records first: every other task reads its record from the store.
    for part, last in (("read", None), (ANSWERED, Depth.ANSWER), (SAMPLED, Depth.SAMPLED)):
        yield [job for job in jobs if job.part == part and job.model is None]
        if depth is last:
            return
    if pruning.staged(study):
        yield from _staged(study, store)
    else:
        yield [job for job in jobs if job.model is not None]
    yield [job for job in jobs if job.joined in ("average", "specimen")]
    yield [job for job in jobs if job.joined == "population"]


def _staged(study: Study, store: Store) -> Iterator[list[Job]]:
    """The branches of a study that leaves candidates out as it goes."""
    records = [(s, r) for s in study.signals if not s.is_envelope for r in range(s.repeats)]
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
                cells = work_of(study, store, Job(s.name, r, name, part=part))
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
                cells = {n: key for n, (key, _) in work_of(study, store, job).items()}
                pruning.set_aside(
                    store, {n: k for n, k in cells.items() if Place.of(n).kind == "evidence"}, why
                )
            else:
                found.append(job)
    return found
