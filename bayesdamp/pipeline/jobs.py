"""List the jobs of a study with their tasks, order them in stages, and choose which candidates are left out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import REFEREE
from bayesdamp.pipeline.answering import ANSWER, SAMPLED_ANSWER, answer_key, compute_answer, rank_candidates
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.tasks import compute, task_keys
from bayesdamp.pipeline.records import StudyRecord, compute_signal
from bayesdamp.pipeline.tasks import Make, digest_of
from bayesdamp.plugins import use_modules
from bayesdamp.store.results import Store, TaskName, TaskResult
from bayesdamp.types import OK, Status

FAR_IN_ANSWER = Status.PRUNED.because("much less probable than the best model in the answer")
NOT_SAMPLED = Status.NOT_SAMPLED.because("its evidence is not among the highest, so it was not sampled")


def choose_candidates(record: StudyRecord) -> tuple[Sequence[str], Sequence[str]]:
    """Return the names of the candidates of a record that are evaluated, and of those that are also sampled.

    The log evidences of the first answer decide. A candidate is evaluated if it is less than `models.prune` below the
    largest (see `rank_candidates`); the best `posterior.best` of these are sampled. If the study sets neither limit, or
    the record has no answer, all candidates are evaluated and sampled. If a limit is set and the outcome of the record
    is not OK, no candidate is evaluated or sampled.
    """
    study, names = record.study, record.study.compare(record.spec)
    prune, best = study.models.prune, study.posterior.best
    if not names or (prune is None and best is None):
        return names, names
    if record.result.outcome != OK:
        return (), ()
    ranked = [record.spec.candidate(*parts) for parts in rank_candidates(record, prune)]
    if not ranked:
        return names, names
    kept = ranked if prune is not None else [*ranked, *(name for name in names if name not in ranked)]
    return kept, kept[:best]


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
    task_group: the tasks of a job on the whole record: "read", "answer" or "sampled".
    is_sampled: whether the tasks of a candidate include its posteriors, and the evidence that needs draws or is the
    referee's.
    """

    signal: str
    repeat: int
    model: str | None = None
    task_group: str | None = None
    is_sampled: bool = True


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

    In a whole run it is the number of candidates or the number of records, whichever is larger. Otherwise it is the
    number of records, because one process answers a record with several threads.
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
            if job.is_sampled or not _needs_sampling(name)
        }
    if spec.is_envelope:
        from bayesdamp.pipeline.envelopes import compute_envelope, envelope_key  # imports slowly

        return {f"{ANSWER}/{record.name}": (envelope_key(record), partial(compute_envelope, study, spec))}
    if job.task_group == "read":
        return {f"signal/{record.name}": (record.key, partial(compute_signal, record))}
    kind = SAMPLED_ANSWER if job.task_group == SAMPLED_ANSWER else ANSWER
    return {f"{kind}/{record.name}": (answer_key(record, kind), partial(compute_answer, record, kind))}


def _needs_sampling(name: str) -> bool:
    """Return whether the task of a candidate with this name is computed only if the candidate is sampled."""
    kind, method = TaskName.of(name).kind, TaskName.of(name).method
    is_from_draws = kind == "evidence" and (method == REFEREE or EVIDENCES.get(method).needs_draws)
    return kind == "posterior" or is_from_draws


def stages(study: Study, store: Store, depth: Depth = Depth.WHOLE) -> Iterator[list[Job]]:
    """Iterate over the stages of a run, which are lists of jobs. A stage may depend on results of earlier stages.

    Each stage is listed when it is requested, from the results that are stored then: run its jobs before requesting the
    next one. A stage can be empty.
    """
    jobs = jobs_of(study)
    # Every other task reads its record from the store.
    for task_group in ("read", ANSWER, SAMPLED_ANSWER):
        yield [job for job in jobs if job.task_group == task_group and is_within(job, depth)]
    if depth is Depth.WHOLE:
        yield _candidate_jobs(study, store)


def _candidate_jobs(study: Study, store: Store) -> list[Job]:
    """Return the jobs of the candidates that are evaluated, and store why the tasks of the others are left out.

    The reason is stored as the result of each evidence task of a pruned candidate. It also replaces the results of an
    earlier run that evaluated or sampled a candidate.
    """
    jobs, stored = list[Job](), set(store.names())
    for spec, repeat in study.records:
        kept, sampled = choose_candidates(StudyRecord(study, spec, repeat, store))
        for name in study.compare(spec) if kept else ():
            whole, is_kept = Job(spec.name, repeat, name), name in kept
            if is_kept:
                jobs.append(replace(whole, is_sampled=name in sampled))
            if name in sampled:
                continue
            why = NOT_SAMPLED if is_kept else FAR_IN_ANSWER
            for task, (key, _) in tasks_of(study, store, whole).items():
                replaces = task in stored and (_needs_sampling(task) or not is_kept)
                is_shown = TaskName.of(task).kind == "evidence" and not is_kept
                if (replaces or is_shown) and not store.has(task, aside := digest_of(why, key)):
                    store.write(TaskResult(task, aside, outcome=why))
    return jobs
