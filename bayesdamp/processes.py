"""Processes of this machine that share the work of a run."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from importlib import import_module

GARBAGE = 100_000
"""New objects from which Python looks for garbage: every 700, as by default, takes a tenth of a short run, as the
hundred thousands that JAX has made are gone through again and again."""


@contextmanager
def processes(workers: int, module: str = "") -> Iterator[Executor]:
    """Spawned processes; each begins at once to import a module where one is named.

    Spawned, not forked (JAX may have started), and one thread each: the processes share the cores.
    """
    before = dict(os.environ)
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["XLA_FLAGS"] = f"{before.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip()
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        initargs=(os.getpid(),),
    )
    with _kill_as_interrupt():
        try:
            for _ in range(workers if module else 0):
                pool.submit(_import, module)
            yield pool
        finally:
            _end(pool)
            os.environ.clear()
            os.environ.update(before)


def _end(pool: ProcessPoolExecutor) -> None:
    """Finished cells are stored: those under way are given up, and nothing waits for JAX to tidy up."""
    for process in list((pool._processes or {}).values()):
        process.terminate()
    pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _kill_as_interrupt() -> Iterator[None]:
    """A run that is killed ends its processes as one that is interrupted does."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _begin(parent: int) -> None:
    """Let a worker end as soon as the run that started it is gone: a killed run leaves nothing that computes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    gc.set_threshold(GARBAGE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    threading.Thread(target=watch, daemon=True).start()


def _import(module: str) -> None:
    import_module(module)
