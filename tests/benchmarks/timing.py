"""CPU seconds of functions that are compared in one process of one thread."""

import time
from collections.abc import Callable

SHORTEST = 0.02
"""Seconds of a measurement: so short a function is called until they are over."""


def seconds(function: Callable[[], object]) -> float:
    """Return the CPU seconds of a call."""
    start, calls = time.process_time(), 0
    while (spent := time.process_time() - start) < SHORTEST:
        function()
        calls += 1
    return spent / calls


def in_turns(*functions: Callable[[], object], rounds: int) -> list[float]:
    """Return the least CPU seconds of a call of each, measured in turns so that a busy machine slows all of them."""
    for function in functions:
        function()
    measured = [[seconds(function) for function in functions] for _ in range(rounds)]
    return [min(column) for column in zip(*measured, strict=True)]
