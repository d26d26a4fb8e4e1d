"""What every command owes to its user, whatever he gives it."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bayesdamp.cli import main

LONGEST = 300
PATIENCE = 30
"""Seconds within which a look at a small file ends."""


def judge(
    arguments: tuple[str, ...], name: str = "", content: bytes = b"", made: tuple[str, ...] = ()
) -> int:
    """Run a command on a file; FILE in the arguments is its path. Exit 0, or 2 with one short line and nothing left.

    made: files that the command may make where it ends with 0. Gives the exit status.
    """
    with tempfile.TemporaryDirectory() as folder, _within(Path(folder)):
        path = Path(folder) / name
        if name:
            path.write_bytes(content)
        before = set(os.listdir(folder))
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main([str(path) if a == "FILE" else a for a in arguments])
        said, left = err.getvalue(), set(os.listdir(folder)) - before
    assert status in (0, 2), f"exit {status}: {said}"
    assert "Traceback" not in said + out.getvalue(), said
    assert left <= (set(made) if status == 0 else set()), f"left behind: {left}"
    if status:
        assert len(said.splitlines()) == 1, said
        assert 20 < len(said) < LONGEST + len(folder), f"{len(said)} characters: {said[:400]}"
        assert said.strip().isprintable(), repr(said)
        assert "internal error" not in said, said
    return status


@contextlib.contextmanager
def _within(folder: Path) -> Iterator[None]:
    def late(*_: object) -> None:
        raise AssertionError(f"it has not ended after {PATIENCE} s")

    here, before = os.getcwd(), signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    os.chdir(folder)
    try:
        yield
    finally:
        signal.alarm(0)
        os.chdir(here)
        signal.signal(signal.SIGALRM, before)
