"""Processes that share the work of a run, and its progress."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bayesdamp.machine.processes import processes
from bayesdamp.pipeline.cluster import cluster

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


@contextmanager
def pool_of(
    workers: int,
    scheduler: str | None,
    running: Executor | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Iterator[Executor | None]:
    """Where jobs run; None for this process. running: a pool that is there already; say: told of a scheduler that has
    no workers."""
    if running is not None or (workers == 1 and scheduler is None):
        yield running
    else:
        with executor(workers, scheduler, say) as pool:
            yield pool


@contextmanager
def executor(
    workers: int, scheduler: str | None, say: Callable[[str], None] = lambda _: None
) -> Iterator[Executor]:
    """Spawned processes on this machine, or those of a Dask scheduler. Raises InputError where there is none."""
    with processes(workers) if scheduler is None else cluster(scheduler, say) as pool:
        yield pool


def progress_bar(console: Console) -> Progress:
    """What is shown while a run goes on."""
    # Not for workers, which show nothing.
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )
