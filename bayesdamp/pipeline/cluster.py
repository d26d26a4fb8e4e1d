"""Processes of a Dask scheduler that share the work of a run."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 10.0
"""Seconds without a worker after which it is said that the run waits for one."""
EVERY = 2.0


@contextmanager
def cluster(scheduler: str, say: Callable[[str], None]) -> Iterator[Executor]:
    """The workers of a scheduler. say: told where there are none. Raises InputError where no scheduler answers, and
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
    with client, _watched(client, scheduler, say):
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
def _watched(client: Client, scheduler: str, say: Callable[[str], None]) -> Iterator[None]:
    """Say once, each time that all workers are gone, that the run waits: a queue may start others."""
    ended = threading.Event()

    def watch() -> None:
        seen, said = time.monotonic(), False
        while not ended.wait(EVERY):
            if client.scheduler_info().get("workers"):
                seen, said = time.monotonic(), False
            elif not said and time.monotonic() - seen > PATIENCE:
                said = True
                say(
                    f"--scheduler {scheduler}: it has no worker; waiting for one. Ctrl-C ends this, and the same "
                    "command goes on where it was"
                )

    watching = threading.Thread(target=watch, daemon=True)
    watching.start()
    try:
        yield
    finally:
        ended.set()
        watching.join()
