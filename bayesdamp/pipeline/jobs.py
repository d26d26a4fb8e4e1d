"""What a study has to do: its cells, the jobs that compute them, their order, and what is left out as it goes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence.adopted import NESTED_CHECK
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.candidates.averaging import average, averages
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.cells import cells_of, compute
from bayesdamp.pipeline.keys import digest, task_key
from bayesdamp.pipeline.many.joining import joined
from bayesdamp.pipeline.many.populating import populate
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.pipeline.records.answering import (
    ANSWERED,
    SAMPLED,
    AnswerCell,
    answers,
    likelihood_of,
    shortlist,
)
from bayesdamp.pipeline.records.records import RecordCell, SignalCell
from bayesdamp.pipeline.tasks import Make
from bayesdamp.plugins import use
from bayesdamp.store import CellResult, Store
from bayesdamp.store.cells import Place
from bayesdamp.store.contents import EvidenceContent
from bayesdamp.types import OK, candidate_parts

FAR = 5.0
"""Nats behind the best, beyond which a candidate that is not sampled is not looked at under other circumstances."""
FAR_AT_ONCE = Status.PRUNED.because("far behind in the first weighing")
NOT_SAMPLED = Status.NOT_SAMPLED.because("not among the best by evidence")


class Contest:
    """The candidates on one record, as a study leaves some of them out on its way."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.names, self.limit = study.compare(spec), study.models.prune

    def listed(self) -> dict[str, str]:
        """All candidates, each with why the first weighing leaves it out, or an empty sentence."""
        short = None
        if self.limit is not None:
            law = likelihood_of(self.study) == "law"
            short = shortlist(self.store, self.spec.name, self.repeat, self.limit, law)
        found = {}
        for name in self.names:
            damping, law = candidate_parts(name)
            out = short is not None and (damping, law or self.spec.restoring[0]) not in short
            found[name] = FAR_AT_ONCE if out else ""
        return found

    def candidates_left(self) -> dict[str, str]:
        """All candidates, each with why it is not weighed further, or an empty sentence."""
        logs = {name: self._log_evidence(name, "laplace") for name in self.names}
        logs = {name: value for name, value in logs.items() if math.isfinite(value)}
        best = max(logs.values(), default=math.nan)
        found = {}
        for name in self.names:
            earlier = self._outcome(name, "laplace")
            if status_of(earlier) is Status.PRUNED:
                found[name] = earlier
            elif self.limit is not None and name in logs and best - logs[name] > self.limit:
                found[name] = Status.PRUNED.because(
                    f"log Bayes factor to the best below −{self.limit:g} by Laplace's approximation"
                )
            else:
                found[name] = ""
        return found

    def best_of(self) -> tuple[str, ...]:
        """The candidates whose posterior is sampled, the best first; all where the study sets no number.

        Beside the best they are those not far behind whose evidence is not to be trusted: bridge sampling and the
        referee start from draws.
        """
        count = self.study.posterior.best
        if count is None:
            return self.names
        found = self._heights()
        order, top = tuple(found), max(found.values(), default=math.nan)
        return (*order[:count], *(n for n in order[count:] if top - found[n] < FAR and self._is_doubtful(n)))

    def likely(self) -> tuple[str, ...]:
        """Those of which it is told what their evidence depends on: the sampled ones, and all that are not far
        behind."""
        found = self._heights()
        top = max(found.values(), default=math.nan)
        return tuple(
            dict.fromkeys([*self.best_of(), *(n for n, height in found.items() if top - height < FAR)])
        )

    def _heights(self) -> dict[str, float]:
        """The candidates that are left, the best first, with their log evidence."""
        order = [m for m in self.study.evidence.methods if m != "laplace"] + ["laplace"]

        def height(name: str) -> float:
            values = (self._log_evidence(name, method) for method in order)
            return next((v for v in values if math.isfinite(v)), -math.inf)

        left = ((n, height(n)) for n, why in self.candidates_left().items() if not why)
        return dict(sorted(left, key=lambda item: -item[1]))

    def _is_doubtful(self, name: str) -> bool:
        """Whether a method that has an error was tried on a candidate and is not to be trusted."""
        said = [self._outcome(name, method) for method in self.study.evidence.methods if method != "laplace"]
        return any(status_of(one) not in (Status.OK, Status.NOT_SAMPLED, Status.PRUNED) for one in said)

    def _cell(self, name: str, method: str) -> CellResult | None:
        return self.store.find(f"evidence/{self.spec.name}/{self.repeat}/{name}/{method}")

    def _outcome(self, name: str, method: str) -> str:
        cell = self._cell(name, method)
        return OK if cell is None else cell.outcome

    def _log_evidence(self, name: str, method: str) -> float:
        content = EvidenceContent.maybe(self._cell(name, method))
        return content.evidence.log_evidence if content and content.evidence else math.nan


def set_aside(store: Store, cells: Mapping[str, str], why: str) -> None:
    """Store a sentence in the place of each of these cells, by name and key."""
    for name, key in cells.items():
        if not store.has(name, aside := digest(why, key)):
            store.write(CellResult(name, aside, outcome=why))


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
