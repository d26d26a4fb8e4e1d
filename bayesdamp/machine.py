"""Resources of the computer that a run uses: its cache folder, signals, processes and threads."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures  # loads its pools where they are used
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

ENDS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a run, where the system has them."""


def cache_folder() -> Path:
    """Return the folder for what is computed once for a machine; it may not exist yet.

    It is `BAYESDAMP_CACHE`, or the system's folder for caches of programs.
    """
    from platformdirs import user_cache_dir

    return Path(os.environ.get("BAYESDAMP_CACHE") or user_cache_dir("bayesdamp"))


@contextmanager
def kill_as_interrupt() -> Iterator[None]:
    """Treat a signal that ends a run, or the closing of its terminal, like an interrupt from the keyboard.

    A signal that is already handled or ignored, as under `nohup`, stays so.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    defaults = [end for end in ENDS if signal.getsignal(end) is signal.SIG_DFL]
    for end in defaults:
        signal.signal(end, interrupt)
    try:
        yield
    finally:
        for end in defaults:
            signal.signal(end, signal.SIG_DFL)


T = TypeVar("T")
R = TypeVar("R")

MOST = 8
"""Threads beyond which all of them wait for the interpreter."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def at_once(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Return `function` of each item, in order, computed on as many cores as there are. Raises the first exception."""
    work = list(items)
    threads = min(cores(), MOST, len(work))
    if threads < 2:
        return [function(item) for item in work]
    with futures.ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, work))


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
        self._pool = futures.ProcessPoolExecutor(
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
