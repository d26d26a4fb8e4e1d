"""Compiled programs are dropped where a process has too many pieces of memory."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np
import pytest
from jax import numpy as jnp

from bayesdamp.machine import cache_eviction

pytestmark = pytest.mark.skipif(
    not cache_eviction.PIECES.exists(), reason="only Linux counts a process's memory like this"
)


def pieces() -> int:
    return len(cache_eviction.PIECES.read_bytes().splitlines())


def allowed(folder: Path, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    (folder / "most").write_text(f"{count}\n")
    monkeypatch.setattr(cache_eviction, "MOST", folder / "most")


def test_where_there_are_many_they_are_given_back_and_come_again(tmp_path, monkeypatch) -> None:
    """Negative control: where the system allows more, nothing is dropped."""
    programs = [jax.jit(lambda x, k=k: jnp.cumsum(jnp.sin(k * x)) + k) for k in range(30)]
    before = [np.asarray(f(np.arange(20.0 + k))) for k, f in enumerate(programs)]
    many = pieces()
    allowed(tmp_path, monkeypatch, 10 * many)
    assert not cache_eviction.evict_programs(every=0.0)
    assert pieces() >= many
    allowed(tmp_path, monkeypatch, many)
    assert cache_eviction.evict_programs(every=0.0)
    assert pieces() < many - 300
    for k, f in enumerate(programs):
        np.testing.assert_array_equal(f(np.arange(20.0 + k)), before[k])


def test_it_is_not_asked_too_often(tmp_path, monkeypatch) -> None:
    allowed(tmp_path, monkeypatch, 10**9)
    cache_eviction.evict_programs(every=0.0)
    allowed(tmp_path, monkeypatch, 1)
    assert not cache_eviction.evict_programs()


def test_a_system_that_does_not_say_is_left_alone(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(cache_eviction, "MOST", tmp_path / "none")
    assert not cache_eviction.evict_programs(every=0.0)
