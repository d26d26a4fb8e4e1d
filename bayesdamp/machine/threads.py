"""Work on several cores of one process, for code that lets go of the interpreter: compiled motions, linear algebra."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

MOST = 8
"""Threads beyond which the interpreter itself is what all wait for."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def at_once(function: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """`function` of each item, in order, on as many cores as there are. The first exception is raised."""
    given = list(items)
    threads = min(cores(), MOST, len(given))
    if threads < 2:
        return [function(item) for item in given]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, given))
