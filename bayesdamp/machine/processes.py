"""Processes of this machine that share the work of a run."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from bayesdamp.machine import kill_as_interrupt

GARBAGE = 100_000
"""New objects after which Python collects garbage: every 700, the default, takes a tenth of a short run, because the
hundred thousand objects of JAX are traversed again and again."""


class Processes(Executor):
    """Spawned processes that can be replaced after one of them was killed, which breaks them all.

    width: their number.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self._start()

    def _start(self) -> None:
        self._pool = ProcessPoolExecutor(
            self.width, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
        )

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule a call, as any executor. Raises BrokenExecutor after a process was killed, until `restart`."""
        return self._pool.submit(fn, *args, **kwargs)

    def restart(self) -> None:
        """Replace the processes by new ones."""
        self.end()
        self._start()

    def end(self) -> None:
        """End the processes at once: finished tasks are stored, and running ones are given up."""
        for process in list((self._pool._processes or {}).values()):
            process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def processes(workers: int) -> Iterator[Processes]:
    """Start processes, and end them afterwards.

    They are spawned, not forked (a library may have started threads), and have one thread each: they share the cores.
    """
    before = dict(os.environ)
    os.environ["OMP_NUM_THREADS"] = "1"
    pool = Processes(workers)
    with kill_as_interrupt():
        try:
            yield pool
        finally:
            pool.end()
            os.environ.clear()
            os.environ.update(before)


def _begin(parent: int) -> None:
    """Prepare a process, which is to end as soon as the run that started it does: a killed run leaves none behind."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    gc.set_threshold(GARBAGE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=watch, daemon=True).start()
