"""Jobs spread over processes; one that is killed costs the task that killed it, and no more."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import TypeVar

Job = TypeVar("Job")
TRIES = 2
"""How often a task is tried whose process is killed."""
KILLED = "failed: the process that computed it was killed, twice (by hand, or for want of memory)"


def spread(
    jobs: Sequence[Job],
    pool: Executor,
    submit: Callable[[Job, Collection[str]], Future[list[str]]],
    under_way: Callable[[Job, Collection[str]], str | None],
    give_up: Callable[[Job, str], None],
    done: Callable[[list[str]], None],
) -> None:
    """Run all jobs and hand the names of each one's tasks to `done`.

    pool: where `submit` runs a job, without the tasks named. under_way: the first task of a job, but for those named,
    that has no result; give_up: stores that a task's process was killed. A pool with a `width` gets no more jobs at a
    time than it has processes, so that few are suspects when it breaks; these are then run one by one.
    """
    waiting, running = deque(jobs), dict[Future[list[str]], Job]()
    width = getattr(pool, "width", len(waiting))
    suspects: list[Job] = []

    def alone(job: Job) -> list[str]:
        """Run a job that was there when a process was killed, with the pool to itself: what is killed now is killed by
        it."""
        given_up: list[str] = []
        tries = {under_way(job, ()): 1}
        while True:
            try:
                return submit(job, tuple(given_up)).result()
            except Exception as fault:
                if not _killed(fault):
                    raise
            restart(pool)
            name = under_way(job, given_up)
            if name is None:
                return given_up
            tries[name] = tries.get(name, 0) + 1
            if tries[name] >= TRIES:
                give_up(job, name)
                given_up.append(name)

    try:
        while waiting or running:
            while waiting and len(running) < width and not suspects:
                job = waiting.popleft()
                try:
                    running[submit(job, ())] = job
                except BrokenExecutor:
                    suspects.append(job)
            ended = wait(running, return_when=FIRST_COMPLETED).done if running else ()
            for future in ended:
                job = running.pop(future)
                try:
                    done(future.result())
                except Exception as fault:
                    if not _killed(fault):
                        raise
                    suspects.append(job)
            if suspects and not running:
                restart(pool)
                for job in suspects:
                    done(alone(job))
                suspects.clear()
    except BaseException:
        for future in running:
            future.cancel()
        raise


def restart(pool: Executor) -> None:
    """New processes, where the pool is one of this machine and was broken."""
    again = getattr(pool, "restart", None)
    if again is not None:
        again()


def _killed(fault: Exception) -> bool:
    """Whether the process of a task was killed, here or on a Dask worker."""
    return isinstance(fault, BrokenExecutor) or type(fault).__name__ == "KilledWorker"
