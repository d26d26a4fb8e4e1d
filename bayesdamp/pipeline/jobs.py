"""The jobs of a study: the cells that each computes, their order, and the candidates that are left out on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence._method import NESTED_CHECK
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.answering import (
    ANSWERED,
    SAMPLED,
    answer_key,
    asks_for_answers,
    compute_answer,
    likelihood_of,
    shortlist,
)
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.cells import cells_of, compute
from bayesdamp.pipeline.candidates.weighing import compute_average, has_average
from bayesdamp.pipeline.records import compute_signal, signal_key
from bayesdamp.pipeline.specimens import Specimen, compute_joint, compute_population
from bayesdamp.pipeline.tasks import Make, digest, task_key
from bayesdamp.plugins import use
from bayesdamp.store import CellResult, Store
from bayesdamp.store.cells import Place
from bayesdamp.store.contents import EvidenceContent
from bayesdamp.types import OK, candidate_parts

FAR = 5.0
"""Nats behind the best, beyond which the sensitivity of a candidate that is not sampled is not computed."""
FAR_AT_ONCE = Status.PRUNED.because("far behind in the first weighing")
NOT_SAMPLED = Status.NOT_SAMPLED.because("not among the best by evidence")


class Contest:
    """The candidates on one record, some of which a study leaves out on its way."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.names, self.limit = study.compare(spec), study.models.prune

    def first_outcomes(self) -> dict[str, str]:
        """Return why the answer's weighing leaves a candidate out, or an empty sentence, by candidate."""
        short = None
        if self.limit is not None:
            law = likelihood_of(self.study) == "law"
            short = shortlist(self.store, self.spec.name, self.repeat, self.limit, law)
        outcomes = {}
        for name in self.names:
            damping, law = candidate_parts(name)
            is_out = short is not None and (damping, law or self.spec.restoring[0]) not in short
            outcomes[name] = FAR_AT_ONCE if is_out else ""
        return outcomes

    def laplace_outcomes(self) -> dict[str, str]:
        """Return why a candidate is not weighed beyond Laplace's evidence, or an empty sentence, by candidate."""
        logs = {name: self._log_evidence(name, "laplace") for name in self.names}
        best = max((value for value in logs.values() if math.isfinite(value)), default=math.nan)
        outcomes = {}
        for name in self.names:
            earlier = self._outcome(name, "laplace")
            outcomes[name] = earlier if status_of(earlier) is Status.PRUNED else ""
            is_far = self.limit is not None and math.isfinite(logs[name]) and best - logs[name] > self.limit
            if is_far and not outcomes[name]:
                limit = f"log Bayes factor to the best below −{self.limit:g} by Laplace's approximation"
                outcomes[name] = Status.PRUNED.because(limit)
        return outcomes

    def best_of(self) -> tuple[str, ...]:
        """Return the candidates whose posterior is sampled, the best first; all where the study sets no number.

        Besides the best these are candidates not far behind whose evidence is not to be trusted: bridge sampling and
        the referee start from draws.
        """
        count = self.study.posterior.best
        if count is None:
            return self.names
        heights = self._heights()
        order, top = tuple(heights), max(heights.values(), default=math.nan)
        methods = [method for method in self.study.evidence.methods if method != "laplace"]
        trusted = (Status.OK, Status.NOT_SAMPLED, Status.PRUNED)
        doubtful = (
            n
            for n in order[count:]
            if top - heights[n] < FAR
            and any(status_of(self._outcome(n, method)) not in trusted for method in methods)
        )
        return (*order[:count], *doubtful)

    def likely(self) -> tuple[str, ...]:
        """Return the candidates whose sensitivity is computed: the sampled ones, and all that are not far behind."""
        heights = self._heights()
        top = max(heights.values(), default=math.nan)
        near = (n for n, height in heights.items() if top - height < FAR)
        return tuple(dict.fromkeys([*self.best_of(), *near]))

    def _heights(self) -> dict[str, float]:
        """Return the log evidence of the candidates that are left, the best first."""
        order = [m for m in self.study.evidence.methods if m != "laplace"] + ["laplace"]
        heights = {}
        for name, why in self.laplace_outcomes().items():
            if not why:
                values = (self._log_evidence(name, method) for method in order)
                heights[name] = next((v for v in values if math.isfinite(v)), -math.inf)
        return dict(sorted(heights.items(), key=lambda item: -item[1]))

    def _cell(self, name: str, method: str) -> CellResult | None:
        return self.store.find(f"evidence/{self.spec.name}/{self.repeat}/{name}/{method}")

    def _outcome(self, name: str, method: str) -> str:
        cell = self._cell(name, method)
        return OK if cell is None else cell.outcome

    def _log_evidence(self, name: str, method: str) -> float:
        content = EvidenceContent.maybe(self._cell(name, method))
        return content.evidence.log_evidence if content and content.evidence else math.nan


class Depth(StrEnum):
    """How far a run goes.

    ANSWER: to the answer from linear models. SAMPLED: to its motions sampled. WHOLE: to everything that the study asks
    of samplers and evidence.
    """

    ANSWER = "answer"
    SAMPLED = "sampled"
    WHOLE = "whole"


@dataclass(frozen=True)
class Job:
    """The tasks that one worker does in a row.

    model: the candidate, in a job of a branch; else None. part: of a record "read", "answer" or "sampled"; of a branch
    "look" (estimates, mode, Laplace's evidence), "weigh" (the other evidence), "sample" or "depend" (the sensitivity),
    None for all of it; else "average" over models, "specimen" of several records (signal is then its name), or
    "population" of all specimens.
    """

    signal: str
    repeat: int
    model: str | None = None
    part: str | None = None


def cells(study: Study) -> list[str]:
    """Return the names of a study's cells, in an order in which they could run. Nothing is computed."""
    use(study.plugins)
    store = Store(Path("."))
    return [name for job in jobs_of(study) for name in work_of(study, store, job)]


def is_within(job: Job, depth: Depth) -> bool:
    """Return whether a run of this depth does a job."""
    return depth is Depth.WHOLE or job.part in ("read", ANSWERED, depth)


def count_parallel_jobs(jobs: list[Job], depth: Depth) -> int:
    """Return how many jobs of a run could run at once.

    These are candidates, or records, each of which is answered by threads of one process.
    """
    records = len({(job.signal, job.repeat) for job in jobs})
    return max(records, sum(job.model is not None for job in jobs)) if depth is Depth.WHOLE else records


def jobs_of(study: Study) -> list[Job]:
    """Return every job of a study, records first."""
    # Repeat by repeat over all signals, so that a run which is cut off has a little of everything.
    most = max(s.repeats for s in study.signals)
    records = [(s, r) for r in range(most) for s in study.signals if r < s.repeats]
    parts = ("read", *((ANSWERED, SAMPLED) if asks_for_answers(study) else ()))
    # The one task of an envelope reads it too.
    jobs = [
        Job(s.name, r, part=part)
        for part in parts
        for s, r in records
        if part == ANSWERED or not s.is_envelope
    ]
    jobs += [Job(s.name, r, model) for s, r in records for model in study.compare(s)]
    jobs += [Job(s.name, 0, part="average") for s in study.signals if has_average(study, s)]
    if study.evidence.methods:
        jobs += [Job(name, 0, part="specimen") for name in study.repeated]
        jobs += [Job("specimens", 0, part="population")] if len(study.specimens) > 1 else []
    return jobs


def work_of(study: Study, store: Store, job: Job) -> dict[str, tuple[str, Make]]:
    """Return the cells of a job: by name, the key and the function that computes it."""
    if job.part == "population":
        keys = {n: Specimen(study, n, specs, store).key for n, specs in study.specimens.items()}
        return {
            "population/specimens": (task_key("population", keys), partial(compute_population, study, store))
        }
    if job.part == "specimen":
        specimen = Specimen(study, job.signal, study.specimens[job.signal], store)
        return {f"joint/{job.signal}": (specimen.key, partial(compute_joint, specimen))}
    spec = next(s for s in study.signals if s.name == job.signal)
    record = f"{spec.name}/{job.repeat}"
    if job.part == "average":
        branches = [cells_of(Branch(study, spec, job.repeat, m, store)) for m in study.compare(spec)]
        name = f"averaged/{record}"
        return {name: (task_key("averaged", branches), partial(compute_average, study, spec, store, name))}
    if job.model is not None:
        branch = Branch(study, spec, job.repeat, job.model, store)
        return {
            name: (key, partial(compute, branch, name))
            for name, key in cells_of(branch).items()
            if job.part is None or job.part == _part_of(name)
        }
    if spec.is_envelope:
        from bayesdamp.pipeline.envelopes import compute_envelope, envelope_key  # imports slowly

        key, make = envelope_key(study, spec, store), partial(compute_envelope, study, spec)
        return {f"{ANSWERED}/{record}": (key, make)}
    if job.part == "read":
        key, make = (
            signal_key(study, spec, job.repeat, store),
            partial(compute_signal, study, spec, job.repeat),
        )
        return {f"signal/{record}": (key, make)}
    kind = SAMPLED if job.part == SAMPLED else ANSWERED
    key = answer_key(study, spec, job.repeat, store, kind)
    return {f"{kind}/{record}": (key, partial(compute_answer, study, spec, job.repeat, store, kind))}


def _part_of(name: str) -> str:
    """Return the part of a branch's jobs that a cell belongs to."""
    place = Place.of(name)
    kind, method = place.kind, place.method
    if kind == "sensitivity" and method != "savage_dickey":
        return "depend"
    if kind in ("posterior", "sensitivity") or method in ("bridge", NESTED_CHECK):
        return "sample"
    return "weigh" if kind == "evidence" and method != "laplace" else "look"


def stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Iterate over the stages of a run: jobs that may run at once. A stage may depend on the results before it."""
    jobs = jobs_of(study)
    # Records first: every other task reads its record from the store.
    for part in ("read", ANSWERED, SAMPLED):
        yield [job for job in jobs if job.part == part and is_within(job, depth)]
    if depth is not Depth.WHOLE:
        return
    if study.models.prune is not None or study.posterior.best is not None:
        yield from _pruned_stages(study, store)
    else:
        yield [job for job in jobs if job.model is not None]
    yield [job for job in jobs if job.part in ("average", "specimen")]
    yield [job for job in jobs if job.part == "population"]


def _pruned_stages(study: Study, store: Store) -> Iterator[list[Job]]:
    """Iterate over the stages of the branches in a study that leaves candidates out on its way."""
    contests = [
        Contest(study, s, r, store)
        for s, r in study.records
        if not s.is_envelope and store.read(f"signal/{s.name}/{r}").outcome == OK
    ]

    def leave_out(job: Job, why: str, only: Callable[[str], bool]) -> None:
        """Store a sentence in place of a job's cells whose names are chosen by `only`."""
        for name, (key, _) in work_of(study, store, job).items():
            if only(name) and not store.has(name, aside := digest(why, key)):
                store.write(CellResult(name, aside, outcome=why))

    for judge, part in ((Contest.first_outcomes, "look"), (Contest.laplace_outcomes, "weigh")):
        stage = []
        for contest in contests:
            for name, why in judge(contest).items():
                job = Job(contest.spec.name, contest.repeat, name, part=part)
                if why:
                    leave_out(job, why, lambda cell: Place.of(cell).kind == "evidence")
                else:
                    stage.append(job)
        yield stage
    stage = []
    for part, choose in (("sample", Contest.best_of), ("depend", Contest.likely)):
        for contest in contests:
            chosen = choose(contest)
            stage += [Job(contest.spec.name, contest.repeat, name, part=part) for name in chosen]
            stored = set(store.names())
            for name in set(contest.names) - set(chosen):
                job = Job(contest.spec.name, contest.repeat, name, part=part)
                leave_out(job, NOT_SAMPLED, stored.__contains__)
    yield stage
