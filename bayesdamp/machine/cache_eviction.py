"""Compiled programs are dropped before a process has more pieces of memory than the system lets it have.

Each compiled program takes a few, and Linux allows 65,530: some thirty records of different shapes, each under all
candidates.
"""

from __future__ import annotations

import gc
import time
from pathlib import Path

from bayesdamp.numerics.lazily import jax

PIECES, MOST = Path("/proc/self/maps"), Path("/proc/sys/vm/max_map_count")
SHARE = 0.5
"""Of the pieces that the system allows, from which programs are dropped: a record takes some two thousand more."""
EVERY = 15.0
"""Seconds between two counts, which take some hundredths of one."""


class _Last:
    counted = -EVERY


def evict_programs(every: float = EVERY) -> bool:
    """Drop all compiled programs where there are very many, and say whether that was done.

    Those that are needed again come from the cache on the disk. Nothing happens where the system does not say how many
    pieces there are, nor before `every` seconds have gone since the last count.
    """
    if time.monotonic() - _Last.counted < every:
        return False
    _Last.counted = time.monotonic()
    try:
        with PIECES.open("rb") as lines:
            crowded = sum(1 for _ in lines) > SHARE * int(MOST.read_text())
    except (OSError, ValueError):
        return False
    if crowded:
        jax.clear_caches()
        gc.collect()
    return crowded
