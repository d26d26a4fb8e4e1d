"""Processes that share the work of a run, on this machine or of a Dask scheduler.

A process that is killed costs the task that killed it, and no more.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from typing import TypeVar

from bayesdamp.machine import processes
from bayesdamp.types import InputError

Job = TypeVar("Job")
TRIES = 2
"""How often a task is tried whose process is killed."""
KILLED = "failed: the process that computed it was killed, twice (by hand, or for want of memory)"


@contextmanager
def cluster(scheduler: str, say: Callable[[str], None]) -> Iterator[Executor]:
    """Use the workers of a Dask scheduler.

    Parameters
    ----------
    scheduler
        Its address.
    say
        Called with a message where the scheduler has no workers yet.

    Raises
    ------
    InputError
        No scheduler answers, or it is gone before the end.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler needs dask.distributed: install bayesdamp[cluster], or use --workers"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the end of a scheduler is reported below
    try:
        client = Client(scheduler, timeout=10)
    except Exception as error:  # for an address that it does not know, whatever its parts raise
        raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
    if not client.scheduler_info().get("workers"):
        wait_for = "waiting for one. Ctrl-C stops this, and the same command resumes"
        say(f"--scheduler {scheduler}: it has no worker; {wait_for}")
    with client:
        # not pure: the same task in another folder is another task
        pool = client.get_executor(pure=False)
        try:
            yield pool
        except CancelledError:
            lost = "the scheduler or all its workers are gone; the same command resumes"
            raise InputError(f"--scheduler {scheduler}: {lost}") from None
        finally:
            # Running tasks are given up, without waiting: there may be no worker left to do them.
            with suppress(Exception):
                pool.shutdown(wait=False)


@contextmanager
def pool_of(
    workers: int, scheduler: str | None, say: Callable[[str], None] = lambda _: None
) -> Iterator[Executor | None]:
    """Use spawned processes on this machine, or those of a Dask scheduler; None stands for this process.

    say: called with a message where a scheduler has no workers. Raises InputError where there is no scheduler.
    """
    if workers == 1 and scheduler is None:
        yield None
        return
    with processes(workers) if scheduler is None else cluster(scheduler, say) as pool:
        yield pool


def spread(
    jobs: Sequence[Job],
    pool: Executor,
    submit: Callable[[Job, Collection[str]], Future[list[str]]],
    under_way: Callable[[Job, Collection[str]], str | None],
    give_up: Callable[[Job, str], None],
    done: Callable[[list[str]], None],
) -> None:
    """Run all jobs and call `done` with the names of each one's tasks.

    Parameters
    ----------
    jobs
        Of several tasks each.
    pool
        Where `submit` runs a job. A pool with a `width` gets no more jobs at a time than it has processes, so that
        there are few suspects when it breaks; these are then run one by one.
    submit
        Starts a job, without the tasks named.
    under_way
        Returns the first task of a job that has no result, without the tasks named.
    give_up
        Stores that a task's process was killed.
    done
        Called once for each job.
    """
    waiting, running = deque(jobs), dict[Future[list[str]], Job]()
    width = getattr(pool, "width", len(waiting))
    suspects: list[Job] = []

    def run_alone(job: Job) -> list[str]:
        """Run a suspect with the pool to itself: a process that is killed now is killed by this job."""
        given_up: list[str] = []
        tries = {under_way(job, ()): 1}
        while True:
            try:
                return submit(job, tuple(given_up)).result()
            except Exception as fault:
                if not _is_kill(fault):
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
                    if not _is_kill(fault):
                        raise
                    suspects.append(job)
            if suspects and not running:
                restart(pool)
                for job in suspects:
                    done(run_alone(job))
                suspects.clear()
    except BaseException:
        for future in running:
            future.cancel()
        raise


def restart(pool: Executor) -> None:
    """Start new processes, where the pool is of this machine and was broken."""
    start_again = getattr(pool, "restart", None)
    if start_again is not None:
        start_again()


def _is_kill(fault: Exception) -> bool:
    """Return whether the process of a task was killed, here or on a Dask worker."""
    return isinstance(fault, BrokenExecutor) or type(fault).__name__ == "KilledWorker"
