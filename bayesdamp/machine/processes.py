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

from bayesdamp.machine.signals import kill_as_interrupt

GARBAGE = 100_000
"""New objects from which Python looks for garbage: every 700, as by default, takes a tenth of a short run, as the
hundred thousands that JAX has made are gone through again and again."""


class Processes(Executor):
    """Spawned processes that can be replaced once one of them was killed, which breaks them all.

    width: how many there are.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        spawn = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self.width, mp_context=spawn, initializer=_begin, initargs=(os.getpid(),))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As any executor. Raises BrokenExecutor where a process was killed, until `restart`."""
        return self._pool.submit(fn, *args, **kwargs)

    def restart(self) -> None:
        """New processes in place of these."""
        self.end()
        self._pool = self._started()

    def end(self) -> None:
        """Finished tasks are stored: those under way are given up, and nothing waits for JAX to tidy up."""
        for process in list((self._pool._processes or {}).values()):
            process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def processes(workers: int) -> Iterator[Processes]:
    """Spawned processes.

    Spawned, not forked (a library may have started threads), and one thread each: the processes share the cores.
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
    """Let a worker end as soon as the run that started it is gone: a killed run leaves nothing that computes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    gc.set_threshold(GARBAGE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    threading.Thread(target=watch, daemon=True).start()
