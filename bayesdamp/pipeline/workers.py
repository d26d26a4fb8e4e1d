"""Run jobs (lists of tasks) in several processes, on this machine or on the workers of a Dask scheduler.

If a task kills its process (for example, because memory runs out), only the result of this task is lost.
"""

import logging
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from typing import TypeVar

from bayesdamp.machine import processes
from bayesdamp.types import InputError

Job = TypeVar("Job")
MOST_TRIES = 2
"""Number of times that a task is tried if it kills its process each time (conventional)."""
KILLED_OUTCOME = "failed: the process that computed it was killed twice, by a user or because memory ran out"


@contextmanager
def cluster(scheduler: str, say: Callable[[str], None]) -> Iterator[Executor]:
    """Connect to a Dask scheduler, and yield an executor that uses its workers.

    Parameters
    ----------
    scheduler
        Address of the scheduler.
    say
        Function that shows a message if the scheduler has no workers yet.

    Raises
    ------
    InputError
        dask.distributed is not installed, no scheduler answers, or the connection is lost.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler needs dask.distributed: install bayesdamp[cluster], or use --workers"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # a lost connection is reported below
    try:
        client = Client(scheduler, timeout=10)
    except Exception as error:  # a wrong address can raise any exception
        raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
    if not client.scheduler_info().get("workers"):
        wait_for = "waiting for one. Ctrl-C stops this, and the same command resumes the run"
        say(f"--scheduler {scheduler}: it has no worker; {wait_for}")
    with client:
        # Not pure: Dask must not reuse results, because the same task in another folder is another task.
        pool = client.get_executor(pure=False)
        try:
            yield pool
        except CancelledError:
            lost = "the connection to the scheduler or to all its workers is lost; the same command resumes the run"
            raise InputError(f"--scheduler {scheduler}: {lost}") from None
        finally:
            # Do not wait for running tasks: there may be no worker left to complete them.
            with suppress(Exception):
                pool.shutdown(wait=False)


@contextmanager
def open_pool(
    workers: int, scheduler: str | None, say: Callable[[str], None] = lambda _: None
) -> Iterator[Executor | None]:
    """Open a pool of new processes on this machine, or of the workers of a Dask scheduler.

    Yields the pool, which is closed at the end of the context. For one worker without a scheduler it yields None: the
    jobs then run in this process.

    workers: number of processes; it has no effect with a scheduler. scheduler: address of the Dask scheduler, or None.
    say: function that shows a message if the scheduler has no workers. Raises InputError for the reasons that `cluster`
    states.
    """
    if workers == 1 and scheduler is None:
        yield None
        return
    with processes(workers) if scheduler is None else cluster(scheduler, say) as pool:
        yield pool


def run_in_pool(
    jobs: Sequence[Job],
    pool: Executor,
    submit: Callable[[Job, Collection[str]], Future[None]],
    next_task: Callable[[Job, Collection[str]], str | None],
    give_up: Callable[[Job, str], None],
    done: Callable[[], None],
) -> None:
    """Run all jobs in a pool, and find the tasks that kill their process.

    When a process is killed, the whole pool breaks, and any job that was running may be the cause. These jobs are then
    run again, one at a time. A task that kills its process `MOST_TRIES` times is not tried again. Any other exception
    of a job is raised to the caller.

    Parameters
    ----------
    jobs
        The jobs, each with several tasks.
    pool
        The pool. If it has a `width` (number of processes), only this number of jobs is submitted at a time. So only
        few jobs must be run alone when the pool breaks.
    submit
        Function that submits a job to the pool and returns its future. Its second argument contains the names of
        tasks to leave out.
    next_task
        Function that returns the name of the first task of a job that has no result; None if there is none. Its second
        argument contains the names of tasks to leave out.
    give_up
        Function that stores, as the result of the named task of a job, that the task killed its process.
    done
        Function that is called without arguments when a job ends.
    """
    waiting, running = deque(jobs), dict[Future[None], Job]()
    width = getattr(pool, "width", len(waiting))
    unclear: list[Job] = []

    def run_alone(job: Job) -> None:
        """Run a job alone in the pool, to find the tasks that kill their process."""
        given_up: list[str] = []
        name = next_task(job, ())
        tries = Counter([name])
        while name is not None:
            try:
                return submit(job, tuple(given_up)).result()
            except Exception as fault:
                if not is_kill(fault):
                    raise
            restart(pool)
            name = next_task(job, given_up)
            tries[name] += 1
            if name is not None and tries[name] >= MOST_TRIES:
                give_up(job, name)
                given_up.append(name)

    try:
        while waiting or running:
            while waiting and len(running) < width and not unclear:
                job = waiting.popleft()
                try:
                    running[submit(job, ())] = job
                except BrokenExecutor:
                    unclear.append(job)
            ended = wait(running, return_when=FIRST_COMPLETED).done if running else ()
            for future in ended:
                job = running.pop(future)
                try:
                    future.result()
                    done()
                except Exception as fault:
                    if not is_kill(fault):
                        raise
                    unclear.append(job)
            if unclear and not running:
                restart(pool)
                for job in unclear:
                    run_alone(job)
                    done()
                unclear.clear()
    except BaseException:
        for future in running:
            future.cancel()
        raise


def restart(pool: Executor) -> None:
    """Start new processes in a broken pool of this machine. Do nothing for a pool of a Dask scheduler."""
    start_again = getattr(pool, "restart", None)
    if start_again is not None:
        start_again()


def is_kill(fault: Exception) -> bool:
    """Return whether an exception of a job means that its process was killed, on this machine or on a Dask worker."""
    return isinstance(fault, BrokenExecutor) or type(fault).__name__ == "KilledWorker"
