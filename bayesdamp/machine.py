"""Manage resources of the computer: cache folder, signals of the operating system, threads and processes."""

import atexit
import gc
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent import futures  # imports its pools only when they are used
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

END_SIGNALS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a run: SIGTERM and SIGHUP, if the operating system has them."""


def cache_folder() -> Path:
    """Return the folder for results that a machine computes only once, such as compiled ODE solvers.

    The folder may not exist yet. The environment variable `BAYESDAMP_CACHE` gives its path; by default it is the
    system's cache folder for programs.
    """
    from platformdirs import user_cache_dir

    return Path(os.environ.get("BAYESDAMP_CACHE") or user_cache_dir("bayesdamp"))


@contextmanager
def kill_as_interrupt() -> Iterator[None]:
    """Make the signals `END_SIGNALS`, which end a program, raise KeyboardInterrupt within this context.

    SIGTERM comes from `kill`, SIGHUP from a terminal that is closed. Signals that are already handled or ignored, as
    under `nohup`, are not changed. Outside the main thread this context does nothing.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    defaults = [end for end in END_SIGNALS if signal.getsignal(end) is signal.SIG_DFL]
    for end in defaults:
        signal.signal(end, interrupt)
    try:
        yield
    finally:
        for end in defaults:
            signal.signal(end, signal.SIG_DFL)


def interruptible(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a function that Numba compiled, so that a signal during a call raises KeyboardInterrupt.

    Python handles the signal while Numba converts the result of the function. Numba then replaces the KeyboardInterrupt
    by a SystemError, which would not stop a run. Instead of any SystemError, the wrapper raises the exception that
    caused it.
    """

    @wraps(function)
    def call(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except SystemError as error:
            cause: BaseException = error
            while cause.__cause__ is not None:
                cause = cause.__cause__
            raise cause from None

    return call


T = TypeVar("T")
R = TypeVar("R")

MAX_THREADS = 8
"""Largest number of threads in `at_once`; more threads would only wait for the interpreter's lock (conventional)."""


def cores() -> int:
    """Return the number of (logical) processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def at_once(function: Callable[[T], R], items: Iterable[T], slow: bool = True) -> list[R]:
    """Apply `function` to each item in parallel threads; return the results in the order of the items.

    There are at most `MAX_THREADS` threads. The calls are made one after another in this thread if there is only one
    core or item, if `slow` is False, or if this is a process of a pool or a thread other than the main one, because
    these share the cores. If calls fail, the exception of the first failed item, in the order of the items, is raised.
    """
    work = list(items)
    shares = multiprocessing.parent_process() or threading.current_thread() is not threading.main_thread()
    threads = min(cores(), MAX_THREADS, len(work)) if slow and not shares else 1
    if threads < 2:
        return [function(item) for item in work]
    with futures.ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, work))


OBJECTS_PER_COLLECTION = 500_000
"""Number of new objects after which Python collects garbage. A comparison of models on one record makes 350,000. With
Python's default, 700, the collections take a tenth of the time of a short run with JAX (measured)."""


def collect_garbage_rarely() -> None:
    """Let Python collect garbage only after `OBJECTS_PER_COLLECTION` new objects, and not when the process ends.

    A collection at the end would take up to 0.3 s.
    """
    gc.set_threshold(OBJECTS_PER_COLLECTION)
    atexit.register(gc.freeze)


class Processes(Executor):
    """A pool of spawned processes that can be restarted.

    If one process is killed, the whole pool stops working; `restart` then replaces it. width: number of processes.
    """

    def __init__(self, width: int) -> None:
        self.width = width
        self._start()

    def _start(self) -> None:
        self._pool = futures.ProcessPoolExecutor(
            self.width, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
        )

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Schedule the call `fn(*args, **kwargs)` in a process of the pool, and return the future of its result.

        If a process was killed, this method raises BrokenExecutor until `restart` is called. The futures of all calls
        that had not ended raise it too.
        """
        return self._pool.submit(fn, *args, **kwargs)

    def restart(self) -> None:
        """Replace all processes by new ones; calls that are running or waiting are aborted."""
        self.end()
        self._start()

    def end(self) -> None:
        """End the processes immediately; calls that are running or waiting are aborted."""
        for process in list((self._pool._processes or {}).values()):
            process.terminate()
        self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def processes(workers: int) -> Iterator[Processes]:
    """Start a pool of `workers` processes for a context, yield it, and end it afterwards.

    Processes are spawned, not forked, because a library may have started threads. Each uses one OpenMP thread, because
    they share the cores. At the end the environment variables of this process are as before. Within the context, the
    signals `END_SIGNALS` raise KeyboardInterrupt (`kill_as_interrupt`).
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
    """Prepare a process of the pool; `parent` is the id of the process that started it.

    The process ends itself if its parent ends, so that a killed run leaves no processes, and it ignores Ctrl-C.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    collect_garbage_rarely()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles Ctrl-C
    threading.Thread(target=watch, daemon=True).start()
