"""Use several cores in one process, for code that releases the interpreter's lock: compiled motions, linear algebra."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

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
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, work))
