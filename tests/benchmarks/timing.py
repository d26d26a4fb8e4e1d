"""Times as ratios: CPU seconds of both sides in one process of one thread, in turns, the best of several."""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds(run: Callable[[], object], least: float = 0.02) -> float:
    """CPU seconds a call, from as many calls as fill `least` seconds."""
    began = time.process_time()
    calls = 0
    while (spent := time.process_time() - began) < least:
        run()
        calls += 1
    return spent / calls


def in_turns(*runs: Callable[[], object], rounds: int = 15) -> list[float]:
    """Best CPU seconds a call of each, measured in turns so that a busy machine hits all of them."""
    for run in runs:
        run()
    measured = [[seconds(run) for run in runs] for _ in range(rounds)]
    return [min(column) for column in zip(*measured, strict=True)]
