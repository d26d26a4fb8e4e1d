"""Processes that share the work of a run, its progress, and the compiled programs that they keep."""

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
from pathlib import Path

import jax
from platformdirs import user_cache_dir
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bayesdamp.programs import keep_in
from bayesdamp.types import InputError

GARBAGE = 100_000
"""New objects from which Python looks for garbage: every 700, as by default, takes a tenth of a short run, as the
hundred thousands that JAX has made are gone through again and again."""


@contextmanager
def pool_of(workers: int, scheduler: str | None) -> Iterator[Executor | None]:
    """Where jobs run; None for this process."""
    if workers == 1 and scheduler is None:
        yield None
    else:
        with executor(workers, scheduler) as pool:
            yield pool


@contextmanager
def executor(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """Spawned processes on this machine, or those of a Dask scheduler. Raises InputError where there is none."""
    if scheduler is not None:
        try:
            from distributed import Client  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise InputError(
                "--scheduler needs dask.distributed: install bayesdamp[cluster], or use --workers"
            ) from None
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            raise InputError(f"--scheduler {scheduler}: no Dask scheduler answers there ({error})") from None
        with client, client.getexecutor() as pool:
            yield pool
        return
    # Spawned, not forked (JAX has started), and one thread each: the processes share the cores.
    before = dict(os.environ)
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["XLA_FLAGS"] = f"{before.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip()
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_end_with_parent,
        initargs=(os.getpid(),),
    )
    try:
        yield pool
    finally:
        # Finished cells are stored: those under way are given up, and nothing waits for JAX to tidy up.
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        os.environ.clear()
        os.environ.update(before)


def _end_with_parent(parent: int) -> None:
    """Let a worker end as soon as the run that started it is gone: a killed run leaves nothing that computes."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    gc.set_threshold(GARBAGE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    threading.Thread(target=watch, daemon=True).start()


def progress_bar(console: Console) -> Progress:
    """What is shown while a run goes on."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def cache_compilations() -> None:
    """Keep traced and compiled programs in the user's cache folder, shared by all runs."""
    folder = user_cache_dir("bayesdamp")
    keep_in(Path(folder) / "traced")
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.02)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
