"""List the jobs of a study with their tasks, order them in stages, and choose which candidates are left out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import REFEREE
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.answering import ANSWER, SAMPLED_ANSWER, answer_key, compute_answer, shortlist
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.tasks import compute, task_keys
from bayesdamp.pipeline.records import StudyRecord, compute_signal
from bayesdamp.pipeline.tasks import Make, digest_of
from bayesdamp.plugins import use_modules
from bayesdamp.store import Store, TaskResult
from bayesdamp.store.contents import EvidenceContent
from bayesdamp.store.results import TaskName
from bayesdamp.types import OK, Evidence

FAR_BEHIND = 5.0
"""A candidate is far behind if its log evidence is at least this many nats below the largest: its Bayes factor against
the best candidate is then at most 1:148."""
FAR_IN_ANSWER = Status.PRUNED.because("much less probable than the best model in the answer")
NOT_SAMPLED = Status.NOT_SAMPLED.because("its evidence is not among the highest, so it was not sampled")


class CandidateSelection:
    """Choose which candidates of one record are evaluated further and sampled.

    A method that returns outcomes maps each candidate to the reason why it is left out; an empty string means it is
    kept.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.record = study, StudyRecord(study, spec, repeat, store)
        self.names, self.limit = study.compare(spec), study.models.prune

    def outcomes_after_answer(self) -> dict[str, str]:
        """Return the outcome of each candidate after the answer: those that are not in the `shortlist` are left out.

        Without a limit `prune` in the study, or without an answer, all are kept.
        """
        short = None if self.limit is None else shortlist(self.record, self.limit)
        is_in = {name: short is None or self.record.spec.parts(name) in short for name in self.names}
        return {name: "" if is_in[name] else FAR_IN_ANSWER for name in self.names}

    def outcomes_after_laplace(self) -> dict[str, str]:
        """Return the outcome of each candidate after Laplace's evidence.

        Those whose log evidence is at least the study's limit `prune` below the largest are left out, as are those
        that were pruned before. Candidates without a finite evidence are kept, and without a limit all.
        """
        outcomes = dict.fromkeys(self.names, "")
        if self.limit is None:
            return outcomes
        laplace = {name: self._evidence(name, "laplace") for name in self.names}
        logs = {name: e.log_evidence for name, e in laplace.items() if math.isfinite(e.log_evidence)}
        best = max(logs.values(), default=math.nan)
        limit = f"log Bayes factor against the best model at most −{self.limit:g} by Laplace's approximation"
        for name, evidence in laplace.items():
            if status_of(evidence.outcome) is Status.PRUNED:
                outcomes[name] = evidence.outcome
            elif best - logs.get(name, best) >= self.limit:
                outcomes[name] = Status.PRUNED.because(limit)
        return outcomes

    def choose_for_sampling(self) -> tuple[str, ...]:
        """Return the names of the candidates whose posterior is sampled.

        These are the candidates with the largest log evidence among those that were not pruned, the best first. The
        study sets their number (`posterior.best`); without a number these are all. Candidates whose evidence by a
        method other than Laplace's is unreliable are added if they are less than `FAR_BEHIND` (5 nats) behind the best,
        because bridge sampling and nested sampling, which check the evidence, start from draws.
        """
        log_evidences = self._log_evidences()
        count = self.study.posterior.best or len(log_evidences)
        order, top = tuple(log_evidences), max(log_evidences.values(), default=math.nan)
        methods = [method for method in self.study.evidence.methods if method != "laplace"]
        trusted = (Status.OK, Status.NOT_SAMPLED, Status.PRUNED)
        doubtful = (
            n
            for n in order[count:]
            if top - log_evidences[n] < FAR_BEHIND
            and any(status_of(self._evidence(n, method).outcome) not in trusted for method in methods)
        )
        return (*order[:count], *doubtful)

    def _log_evidences(self) -> dict[str, float]:
        """Return the log evidence (nats) of the candidates that were not pruned, by name, the best first.

        For each candidate, the evidence methods of the study are tried in their order, and Laplace's last; the first
        finite value is used. It is −∞ if no method gives a finite value.
        """
        order = [m for m in self.study.evidence.methods if m != "laplace"] + ["laplace"]
        log_evidences = {}
        for name, why in self.outcomes_after_laplace().items():
            if not why:
                values = (self._evidence(name, method).log_evidence for method in order)
                log_evidences[name] = next((v for v in values if math.isfinite(v)), -math.inf)
        return dict(sorted(log_evidences.items(), key=lambda item: -item[1]))

    def _evidence(self, name: str, method: str) -> Evidence:
        """Return the stored evidence of a candidate by a method; its log evidence is nan if there is none."""
        result = self.record.store.find(f"evidence/{self.record.name}/{name}/{method}", arrays=False)
        content = EvidenceContent.maybe(result)
        if content is not None and content.evidence is not None:
            return content.evidence
        return Evidence(name, method, outcome=OK if result is None else result.outcome)


class Depth(StrEnum):
    """The last step of a run.

    ANSWER: the answer by linear approximations. SAMPLED: the answer with the posteriors of the most probable models
    sampled. WHOLE: all samplers and evidence methods that the study names.
    """

    ANSWER = "answer"
    SAMPLED = "sampled"
    WHOLE = "whole"


@dataclass(frozen=True)
class Job:
    """Tasks that one process computes one after another.

    signal: name of the signal.
    repeat: number of the repeat of a simulated signal, from 0.
    model: the candidate; None if the job concerns the whole record.
    task_group: its tasks. For a record: "read", "answer" or "sampled". For a candidate: "fit" (estimates, mode and
    Laplace's evidence), "evidence" (by the other methods), "sample", or None for all of these.
    """

    signal: str
    repeat: int
    model: str | None = None
    task_group: str | None = None


def task_names(study: Study) -> list[str]:
    """Return the names of all tasks of a study, in an order in which they could be computed.

    Nothing is computed. A run may leave out some of the tasks, such as those of pruned candidates.
    """
    use_modules(study.plugins)
    store = Store(Path("."))
    return [name for job in jobs_of(study) for name in tasks_of(study, store, job)]


def is_within(job: Job, depth: Depth) -> bool:
    """Return whether a run whose last step is `depth` includes a job."""
    return depth is Depth.WHOLE or job.task_group in ("read", ANSWER, depth)


def count_parallel_jobs(jobs: list[Job], depth: Depth) -> int:
    """Return how many jobs of a run can use a process of their own at the same time.

    In a whole run it is the number of candidates or that of records, whichever is larger; otherwise that of records,
    because one process answers a record with several threads.
    """
    records = len({(job.signal, job.repeat) for job in jobs})
    return max(records, sum(job.model is not None for job in jobs)) if depth is Depth.WHOLE else records


def jobs_of(study: Study) -> list[Job]:
    """Return all jobs of a study; the jobs that read records come first.

    They include the jobs of candidates that a run may leave out.
    """
    # Repeat by repeat over all signals: an interrupted run then has results for every signal.
    most = max(s.repeats for s in study.signals)
    records = [(s, r) for r in range(most) for s in study.signals if r < s.repeats]
    task_groups = ("read", *((ANSWER, SAMPLED_ANSWER) if study.has_answers else ()))
    # An envelope is read by its answer task.
    jobs = [
        Job(s.name, r, task_group=task_group)
        for task_group in task_groups
        for s, r in records
        if task_group == ANSWER or not s.is_envelope
    ]
    return jobs + [Job(s.name, r, model) for s, r in records for model in study.compare(s)]


def tasks_of(study: Study, store: Store, job: Job) -> dict[str, tuple[str, Make]]:
    """Return the tasks of a job: by name, the key of the task and the function that computes it."""
    spec = next(s for s in study.signals if s.name == job.signal)
    record = StudyRecord(study, spec, job.repeat, store)
    if job.model is not None:
        candidate = StudyCandidate(study, spec, job.repeat, job.model, store)
        return {
            name: (key, partial(compute, candidate, name))
            for name, key in task_keys(candidate).items()
            if job.task_group is None or job.task_group == _task_group_of(name)
        }
    if spec.is_envelope:
        from bayesdamp.pipeline.envelopes import compute_envelope, envelope_key  # imports slowly

        return {f"{ANSWER}/{record.name}": (envelope_key(record), partial(compute_envelope, study, spec))}
    if job.task_group == "read":
        return {f"signal/{record.name}": (record.key, partial(compute_signal, record))}
    kind = SAMPLED_ANSWER if job.task_group == SAMPLED_ANSWER else ANSWER
    return {f"{kind}/{record.name}": (answer_key(record, kind), partial(compute_answer, record, kind))}


def _task_group_of(name: str) -> str:
    """Return the `task_group` of the candidate's job that contains the task of this name."""
    parts = TaskName.of(name)
    kind, method = parts.kind, parts.method
    if kind == "posterior" or method == REFEREE:
        return "sample"
    if kind == "evidence" and EVIDENCES.get(method).needs_draws:
        return "sample"
    return "evidence" if kind == "evidence" and method != "laplace" else "fit"


def stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Iterate over the stages of a run, which are lists of jobs. A stage may depend on results of earlier stages.

    Each stage is listed when it is requested, from the results that are stored then: run its jobs before requesting the
    next one. A stage can be empty.
    """
    jobs = jobs_of(study)
    # Every other task reads its record from the store.
    for task_group in ("read", ANSWER, SAMPLED_ANSWER):
        yield [job for job in jobs if job.task_group == task_group and is_within(job, depth)]
    if depth is not Depth.WHOLE:
        return
    yield from _candidate_stages(study, store)


def _candidate_stages(study: Study, store: Store) -> Iterator[list[Job]]:
    """Iterate over the stages (lists of jobs) of candidates.

    Each stage has only the candidates that remain after the stages before. For a candidate that is pruned, the reason
    is stored as the result of its evidence tasks; for one that is not sampled, it replaces the results of an earlier
    run.
    """
    selects = study.models.prune is not None or study.posterior.best is not None
    selections = [
        CandidateSelection(study, spec, repeat, store)
        for spec, repeat in study.records
        if not (selects and not spec.is_envelope and store.read(f"signal/{spec.name}/{repeat}").outcome != OK)
    ]

    def job_of(selection: CandidateSelection, name: str, task_group: str) -> Job:
        return Job(selection.record.spec.name, selection.record.repeat, name, task_group)

    def leave_out(job: Job, why: str, only: Callable[[str], bool]) -> None:
        """Store the reason `why` as the result of those tasks of a job whose names satisfy `only`."""
        for name, (key, _) in tasks_of(study, store, job).items():
            if only(name) and not store.has(name, aside := digest_of(why, key)):
                store.write(TaskResult(name, aside, outcome=why))

    for outcomes_of, task_group, has_tasks in (
        (CandidateSelection.outcomes_after_answer, "fit", True),
        (CandidateSelection.outcomes_after_laplace, "evidence", bool(study.evidence.methods)),
    ):
        stage = []
        for selection in selections:
            for name, why in outcomes_of(selection).items():
                job = job_of(selection, name, task_group)
                if why:
                    leave_out(job, why, lambda task: TaskName.of(task).kind == "evidence")
                elif has_tasks:
                    stage.append(job)
        yield stage
    stage = []
    for selection in selections:
        chosen = selection.choose_for_sampling()
        stage += [job_of(selection, name, "sample") for name in chosen]
        stored = set(store.names())
        for name in set(selection.names) - set(chosen):
            leave_out(job_of(selection, name, "sample"), NOT_SAMPLED, stored.__contains__)
    yield stage if study.has_answers else []
