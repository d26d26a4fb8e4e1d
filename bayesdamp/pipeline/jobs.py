"""What a study has to do: its cells, the jobs that compute them, and in which order jobs may run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import Study
from bayesdamp.inference.evidence.adopted import NESTED_CHECK
from bayesdamp.pipeline.candidates.averaging import average, averages
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.cells import cells_of, compute
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.many.joining import joined
from bayesdamp.pipeline.many.populating import populate
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.pipeline.pruning import NOT_SAMPLED, Contest, set_aside
from bayesdamp.pipeline.records.answering import ANSWERED, SAMPLED, AnswerCell, answers
from bayesdamp.pipeline.records.records import RecordCell, SignalCell
from bayesdamp.pipeline.tasks import Make
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


def cells(study: Study) -> list[str]:
    """The names of a study's cells, in an order in which they could run. Nothing is computed."""
    use(study.plugins)
    store = Store(Path("."))
    return [name for job in jobs_of(study) for name in work_of(study, store, job)]


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
    if study.evidence.methods:
        last += [Job(name, 0, joined="specimen") for name in study.repeated]
        last += [Job("specimens", 0, joined="population")] if len(study.specimens) > 1 else []
    return [*first, *(Job(s.name, r, m) for s, r in records for m in study.compare(s)), *last]


def work_of(study: Study, store: Store, job: Job) -> dict[str, tuple[str, Make]]:
    """The cells of a job: name to key and what computes it."""
    if job.joined == "population":
        keys = {n: Specimen(study, n, specs, store).key for n, specs in study.specimens.items()}
        return {"population/specimens": (task_key("population", keys), partial(populate, study, store))}
    if job.joined == "specimen":
        specimen = Specimen(study, job.signal, study.specimens[job.signal], store)
        return {f"joint/{job.signal}": (specimen.key, partial(joined, specimen))}
    spec = next(s for s in study.signals if s.name == job.signal)
    if job.joined:
        branches = [cells_of(Branch(study, spec, job.repeat, m, store)) for m in study.compare(spec)]
        name, key = f"averaged/{spec.name}/{job.repeat}", task_key("averaged", branches)
        return {name: (key, partial(average, study, spec, store, name))}
    if job.model is None:
        if spec.is_envelope:
            from bayesdamp.pipeline.envelopes import EnvelopeCell  # imports slowly

            cell: RecordCell = EnvelopeCell(study, spec, store)
        elif job.part == "read":
            cell = SignalCell(study, spec, job.repeat, store)
        else:
            cell = AnswerCell(study, spec, job.repeat, store, sample=job.part == SAMPLED)
        return {cell.name: (cell.key, cell.product)}
    branch = Branch(study, spec, job.repeat, job.model, store)
    return {
        name: (key, partial(compute, branch, name))
        for name, key in cells_of(branch).items()
        if job.part is None or job.part == _part(name)
    }


def _part(name: str) -> str:
    place = Place.of(name)
    kind, method = place.kind, place.method
    if kind == "sensitivity" and method != "savage_dickey":
        return "depend"
    if kind in ("posterior", "sensitivity") or method in ("bridge", NESTED_CHECK):
        return "sample"
    return "weigh" if kind == "evidence" and method != "laplace" else "look"


def stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Jobs that may run side by side, stage by stage; what a stage holds may depend on what was found before it."""
    jobs = jobs_of(study)
    # Records first: every other task reads its record from the store.
    for part, last in (("read", None), (ANSWERED, Depth.ANSWER), (SAMPLED, Depth.SAMPLED)):
        yield [job for job in jobs if job.part == part and job.model is None]
        if depth is last:
            return
    # What is computed may depend on what was found before.
    if study.models.prune is not None or study.posterior.best is not None:
        yield from _staged(study, store)
    else:
        yield [job for job in jobs if job.model is not None]
    yield [job for job in jobs if job.joined in ("average", "specimen")]
    yield [job for job in jobs if job.joined == "population"]


def _staged(study: Study, store: Store) -> Iterator[list[Job]]:
    """The branches of a study that leaves candidates out as it goes."""
    contests = [
        Contest(study, s, r, store)
        for s, r in study.records
        if not s.is_envelope and store.read(f"signal/{s.name}/{r}").outcome == OK
    ]

    def left_by(judge: Callable[[Contest], dict[str, str]], part: str) -> list[Job]:
        """The jobs of the candidates that a judge leaves; the evidence of the others gets its sentence."""
        found = []
        for contest in contests:
            for name, why in judge(contest).items():
                job = Job(contest.spec.name, contest.repeat, name, part=part)
                if why:
                    cells = work_of(study, store, job).items()
                    set_aside(store, {n: k for n, (k, _) in cells if Place.of(n).kind == "evidence"}, why)
                else:
                    found.append(job)
        return found

    yield left_by(Contest.listed, "look")
    yield left_by(Contest.candidates_left, "weigh")
    last: list[Job] = []
    for part, chosen in (("sample", Contest.best_of), ("depend", Contest.likely)):
        for contest in contests:
            left = chosen(contest)
            last += [Job(contest.spec.name, contest.repeat, name, part=part) for name in left]
            for name in set(contest.names) - set(left):
                cells = work_of(study, store, Job(contest.spec.name, contest.repeat, name, part=part))
                set_aside(store, {n: k for n, (k, _) in cells.items() if n in store.names()}, NOT_SAMPLED)
    yield last
