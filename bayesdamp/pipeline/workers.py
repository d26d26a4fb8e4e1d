"""Processes that share the work of a run: on this machine, or of a Dask scheduler."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager, suppress

from bayesdamp.machine.processes import processes
from bayesdamp.types import InputError


@contextmanager
def cluster(scheduler: str, say: Callable[[str], None]) -> Iterator[Executor]:
    """The workers of a scheduler. say: told where there are none yet. Raises InputError where no scheduler answers, and
    once it is gone."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler needs dask.distributed: install bayesdamp[cluster], or use --workers"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it has to say of its end is said below
    try:
        client = Client(scheduler, timeout=10)
    except Exception as error:  # of an address that it does not know, whatever its parts raise
        raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
    if not client.scheduler_info().get("workers"):
        wait = (
            "it has no worker; waiting for one. Ctrl-C ends this, and the same command goes on where it was"
        )
        say(f"--scheduler {scheduler}: {wait}")
    with client:
        # not pure: the same task in another folder is another one
        pool = client.get_executor(pure=False)
        try:
            yield pool
        except CancelledError:
            lost = "the scheduler or all its workers are gone; the same command resumes"
            raise InputError(f"--scheduler {scheduler}: {lost}") from None
        finally:
            # What is under way is given up, not waited for: there may be nobody to do it.
            with suppress(Exception):
                pool.shutdown(wait=False)


@contextmanager
def pool_of(
    workers: int, scheduler: str | None, say: Callable[[str], None] = lambda _: None
) -> Iterator[Executor | None]:
    """Where jobs run: spawned processes on this machine, or those of a Dask scheduler; None for this process.

    say: told of a scheduler that has no workers. Raises InputError where there is no scheduler.
    """
    if workers == 1 and scheduler is None:
        yield None
        return
    with processes(workers) if scheduler is None else cluster(scheduler, say) as pool:
        yield pool
