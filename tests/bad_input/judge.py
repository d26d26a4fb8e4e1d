"""What every command owes to its user, whatever he gives it."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from bayesdamp.cli import main
from tests.bad_input.case import READ, REFUSED, nothing

LONGEST = 300
PATIENCE = 30
"""Seconds within which a command on a small file ends."""


def judge(
    arguments: tuple[str, ...],
    name: str = "a.csv",
    write: Callable[[Path], object] = nothing,
    *,
    ends: tuple[int, ...] = (READ, REFUSED),
    said: str = "",
    made: tuple[str, ...] = (),
) -> int:
    """Run a command on a file; FILE in the arguments is its path. Exit 0, or 2 with one short line and nothing left.

    ends: exit statuses that are right; said: a part of the line; made: files that the command may make where it ends
    with 0. Gives the exit status.
    """
    with tempfile.TemporaryDirectory() as folder, _within(Path(folder)):
        path = Path(folder) / name
        write(path)
        before = set(Path(folder).rglob("*"))
        out, err = io.StringIO(), io.StringIO()
        words = [f"{path}{a[4:]}" if a == "FILE" or a.startswith("FILE/") else a for a in arguments]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(words)
        line, left = err.getvalue(), {p.name for p in set(Path(folder).rglob("*")) ^ before}
    assert status in ends, f"exit {status}: {line}"
    assert "Traceback" not in line + out.getvalue(), line
    assert left <= (set(made) if status == READ else set()), f"left behind: {left}"
    if status:
        assert len(line.splitlines()) == 1, line
        assert 20 < len(line) < LONGEST, f"{len(line)} characters: {line[:400]}"
        assert line.strip().isprintable(), repr(line)
        assert "internal error" not in line, line
        assert said in line, line
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
