"""List the jobs of a study with their tasks, order the jobs in stages, and leave out improbable models.

A task is one computation with a stored result. A job is a list of tasks that one process computes (see `run`). A
candidate is a model: a sum of damping terms under a restoring law.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence._method import REFEREE
from bayesdamp.pipeline.answering import ANSWER, SAMPLED_ANSWER, answer_key, compute_answer, rank_candidates
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.tasks import compute, task_keys
from bayesdamp.pipeline.records import StudyRecord, compute_signal
from bayesdamp.pipeline.tasks import Task, digest_of
from bayesdamp.plugins import use_modules
from bayesdamp.store.results import Store, TaskName, TaskResult
from bayesdamp.types import OK, Status

FAR_IN_ANSWER = Status.PRUNED.because("much less probable than the best model in the answer")
NOT_SAMPLED = Status.NOT_SAMPLED.because("its evidence is not among the highest, so it was not sampled")


def choose_candidates(record: StudyRecord) -> tuple[Sequence[str], Sequence[str]]:
    """Choose the candidates (models) of a record to evaluate, and those of them to sample; return both lists of names.

    The log evidences in the answer on the record decide, with two settings of the study:

    - A candidate is evaluated if its log evidence is less than `models.prune` (in nats) below the largest one
      (see `rank_candidates`). If `prune` is None, all are.
    - The `posterior.best` candidates with the largest log evidences are also sampled. If `best` is None, all that are
      evaluated are sampled.

    If the study sets neither limit, or if the record has no answer, all candidates are evaluated and sampled. If a
    limit is set and the outcome of the record is not OK, none is.
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
    """The step after which a run ends.

    ANSWER: the comparison of damping models by linear approximations. SAMPLED: in addition, sampling of the posteriors
    of the most probable models. WHOLE: in addition, all samplers and evidence methods that the study names.
    """

    ANSWER = "answer"
    SAMPLED = "sampled"
    WHOLE = "whole"


@dataclass(frozen=True)
class Job:
    """A list of tasks that one process computes one after another.

    They are all tasks of one model on one record, or tasks that concern the record and no single model.

    signal: name of the signal.
    repeat: number of the repeat of a simulated signal, from 0.
    model: name of the model (candidate); None if the job is a task on the whole record.
    task_group: which tasks on the whole record; None if the job concerns a model. "read": simulate or read the record,
    and store it. "answer": in addition, compare the damping models by linear approximations. "sampled": in addition,
    sample the posteriors of the most probable models. What has been done before is not done again.
    is_sampled: for a model, whether the job includes its posteriors, and the evidence by nested sampling and by methods
    that need posterior draws.
    """

    signal: str
    repeat: int
    model: str | None = None
    task_group: str | None = None
    is_sampled: bool = True


def task_names(study: Study) -> list[str]:
    """Return the names of all tasks of a study, in an order in which they could be computed.

    Nothing is computed. A run may leave out some of the tasks, such as those of improbable models.
    """
    use_modules(study.plugins)
    store = Store(Path("."))
    return list(dict.fromkeys(task.name for job in jobs_of(study) for task in tasks_of(study, store, job)))


def is_within(job: Job, depth: Depth) -> bool:
    """Return whether a job belongs to a run that ends after the step `depth`."""
    return depth is Depth.WHOLE or job.task_group in ("read", ANSWER, depth)


def count_parallel_jobs(jobs: list[Job], depth: Depth) -> int:
    """Return how many jobs of a run can be computed at the same time, each in its own process.

    For `Depth.WHOLE` this is the number of jobs on single models or the number of records, whichever is larger.
    Otherwise it is the number of records, because one process uses several threads for one record.
    """
    records = len({(job.signal, job.repeat) for job in jobs})
    return max(records, sum(job.model is not None for job in jobs)) if depth is Depth.WHOLE else records


def jobs_of(study: Study) -> list[Job]:
    """Return all jobs of a study; the jobs on single models come last.

    An envelope has a single job, its answer; none if the study has no samplers and evidence methods. A run may leave
    out some of the jobs on single models.
    """
    # First repeat 0 of all signals, then repeat 1, and so on: an interrupted run then has results for every signal.
    most = max(s.repeats for s in study.signals)
    records = [(s, r) for r in range(most) for s in study.signals if r < s.repeats]
    jobs = [
        Job(s.name, r, task_group=task_group)
        for task_group in ((ANSWER, SAMPLED_ANSWER) if study.has_answers else ("read",))
        for s, r in records
        if task_group == ANSWER or not s.is_envelope
    ]
    return jobs + [Job(s.name, r, model) for s, r in records for model in study.compare(s)]


def spec_of(study: Study, job: Job) -> SignalSpec:
    """Return the settings of the signal of a job."""
    return next(spec for spec in study.signals if spec.name == job.signal)


def tasks_of(study: Study, store: Store, job: Job) -> list[Task]:
    """Return the tasks of a job, in the order in which they are computed."""
    spec = spec_of(study, job)
    record = StudyRecord(study, spec, job.repeat, store)
    if job.model is not None:
        candidate = StudyCandidate(study, spec, job.repeat, job.model, store)
        return [
            Task(name, key, partial(compute, candidate, name))
            for name, key in task_keys(candidate).items()
            if job.is_sampled or not _needs_sampling(name)
        ]
    if spec.is_envelope:
        from bayesdamp.pipeline.envelopes import compute_envelope, envelope_key  # imports slowly

        return [Task(f"{ANSWER}/{record.name}", envelope_key(record), partial(compute_envelope, study, spec))]
    tasks = [Task(f"signal/{record.name}", record.key, partial(compute_signal, record))]
    for kind in {"read": (), ANSWER: (ANSWER,)}.get(job.task_group or "", (ANSWER, SAMPLED_ANSWER)):
        name, key = f"{kind}/{record.name}", answer_key(record, kind)
        tasks.append(Task(name, key, partial(compute_answer, record, kind)))
    return tasks


def _needs_sampling(name: str) -> bool:
    """Return whether the task with this name is computed only for models whose posterior is sampled."""
    kind, method = TaskName.of(name).kind, TaskName.of(name).method
    is_from_draws = kind == "evidence" and (method == REFEREE or EVIDENCES.get(method).needs_draws)
    return kind == "posterior" or is_from_draws


def stages(
    study: Study, store: Store, depth: Depth = Depth.WHOLE, answer_first: bool = True
) -> Iterator[list[Job]]:
    """Iterate over the stages of a run, which are lists of jobs. A stage may depend on results of earlier stages.

    The jobs of a stage depend on the results that are stored when the iterator is asked for it. So run the jobs of each
    stage before asking for the next one. A stage can be empty.

    depth: step after which the stages end. answer_first: whether models are compared by linear approximations on all
    records before any record is sampled. If False, each record is sampled when its models have been compared, and the
    comparison is not computed twice.
    """
    jobs = jobs_of(study)
    sampled = {job.signal for job in jobs if job.task_group == SAMPLED_ANSWER and is_within(job, depth)}
    for task_group in ("read", ANSWER, SAMPLED_ANSWER):
        later = sampled if task_group == ANSWER and not answer_first else ()
        yield [
            j for j in jobs if j.task_group == task_group and is_within(j, depth) and j.signal not in later
        ]
    if depth is Depth.WHOLE:
        yield _candidate_jobs(study, store)


def _candidate_jobs(study: Study, store: Store) -> list[Job]:
    """Return the jobs on the candidates (models) to evaluate, and store why tasks of candidates are left out.

    Of a candidate that is not sampled, the tasks that need sampling are left out; of one that is not evaluated, all.

    The reason is stored in place of a result in two cases: for every evidence task of a candidate that is not
    evaluated, and for every task that is left out now but has a result from an earlier run.
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
            for task in tasks_of(study, store, whole):
                replaces = task.name in stored and (_needs_sampling(task.name) or not is_kept)
                is_shown = TaskName.of(task.name).kind == "evidence" and not is_kept
                if (replaces or is_shown) and not store.has(task.name, aside := digest_of(why, task.key)):
                    store.write(TaskResult(task.name, aside, outcome=why))
    return jobs
