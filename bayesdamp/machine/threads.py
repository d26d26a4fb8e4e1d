"""Work on several cores of one process, for code that lets go of the interpreter: compiled motions, linear algebra."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"
_THREADS = re.compile(r"\s*--xla_cpu_multi_thread_eigen(=\S*)?(?=\s|$)")
T = TypeVar("T")
R = TypeVar("R")

MOST = 8
"""Threads beyond which the interpreter itself is what all wait for."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_one_order() -> None:
    """Let compiled programs that this process loads from now on sum in one order, whatever the number of cores.

    A result must not depend on which process computes it, nor on what its environment says of that. Without effect once
    JAX has compiled something, and where the environment names a file of flags.
    """
    flags = os.environ.get("XLA_FLAGS", "").strip()
    if not flags or flags.startswith("-"):  # all else XLA takes for a file's name, so that ours comes first
        os.environ["XLA_FLAGS"] = f"{ONE_THREAD} {_THREADS.sub('', flags).strip()}".strip()


def at_once(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """`function` of each item, in order, on as many cores as there are. The first exception is raised."""
    given = list(items)
    threads = min(cores(), MOST, len(given))
    if threads < 2:
        return [function(item) for item in given]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, given))
