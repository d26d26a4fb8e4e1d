"""What holds for all tests."""

from __future__ import annotations

import gc
import resource
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

MUCH = 2 * 2**30
"""Bytes of memory of a test process from which what JAX has traced and compiled is dropped: two processes of the suite
hold to a machine of 8 GiB then."""


@pytest.fixture(autouse=True, scope="module")
def _memory_is_given_back() -> Iterator[None]:
    yield
    jax = sys.modules.get("jax")
    if jax is not None and _held() > MUCH:
        jax.clear_caches()
        gc.collect()


def _held() -> int:
    """Bytes of memory of this process; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[1])
    except OSError:
        return 0
    return pages * resource.getpagesize()
