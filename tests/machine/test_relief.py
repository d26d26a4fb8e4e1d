"""Compiled programs are dropped where a process has too many pieces of memory."""

from __future__ import annotations

from pathlib import Path

import jax
import numpy as np
import pytest
from jax import numpy as jnp

from bayesdamp.machine import relief

pytestmark = pytest.mark.skipif(
    not relief.PIECES.exists(), reason="only Linux counts a process's memory like this"
)


def pieces() -> int:
    return len(relief.PIECES.read_bytes().splitlines())


def allowed(folder: Path, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    (folder / "most").write_text(f"{count}\n")
    monkeypatch.setattr(relief, "MOST", folder / "most")


def test_where_there_are_many_they_are_given_back_and_come_again(tmp_path, monkeypatch) -> None:
    """Negative control: where the system allows more, nothing is dropped."""
    programs = [jax.jit(lambda x, k=k: jnp.cumsum(jnp.sin(k * x)) + k) for k in range(30)]
    before = [np.asarray(f(np.arange(20.0 + k))) for k, f in enumerate(programs)]
    many = pieces()
    allowed(tmp_path, monkeypatch, 10 * many)
    assert not relief.relieve(every=0.0)
    assert pieces() >= many
    allowed(tmp_path, monkeypatch, many)
    assert relief.relieve(every=0.0)
    assert pieces() < many - 300
    for k, f in enumerate(programs):
        np.testing.assert_array_equal(f(np.arange(20.0 + k)), before[k])


def test_it_is_not_asked_too_often(tmp_path, monkeypatch) -> None:
    allowed(tmp_path, monkeypatch, 10**9)
    relief.relieve(every=0.0)
    allowed(tmp_path, monkeypatch, 1)
    assert not relief.relieve()


def test_a_system_that_does_not_say_is_left_alone(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(relief, "MOST", tmp_path / "none")
    assert not relief.relieve(every=0.0)
