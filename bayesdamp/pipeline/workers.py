"""Processes that share the work of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from bayesdamp.machine.processes import processes
from bayesdamp.pipeline.cluster import cluster


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
