"""Check what every command must do for any input: end soon, in one line, and leave no files."""

import contextlib
import io
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from bayesdamp.cli import main
from tests.bad_input.case import READ, REFUSED, nothing

LONGEST = 300
TIME_LIMIT = 30
"""Seconds within which a command on a small file ends."""


def judge(
    arguments: tuple[str, ...],
    name: str = "a.csv",
    write: Callable[[Path], object] = nothing,
    *,
    statuses: tuple[int, ...] = (READ, REFUSED),
    line: str = "",
    may_write: tuple[str, ...] = (),
) -> None:
    """Run a command on a file; FILE in the arguments is its path. Exit 0, or 2 with one short line and no new files.

    statuses: allowed exit statuses; line: a part of the line; may_write: files that the command may write if it ends
    with 0.
    """
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), _time_limit():
        path = Path(folder) / name
        write(path)
        before = set(Path(folder).rglob("*"))
        out, err = io.StringIO(), io.StringIO()
        words = [f"{path}{a[4:]}" if a == "FILE" or a.startswith("FILE/") else a for a in arguments]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(words)
        error, new = err.getvalue(), {p.name for p in set(Path(folder).rglob("*")) ^ before}
    assert status in statuses, f"exit {status}: {error}"
    assert "Traceback" not in error + out.getvalue(), error
    assert new <= (set(may_write) if status == READ else set()), f"left behind: {new}"
    if status:
        assert len(error.splitlines()) == 1, error
        assert 20 < len(error) < LONGEST, f"{len(error)} characters: {error[:400]}"
        assert error.strip().isprintable(), repr(error)
        assert "internal error" not in error, error
        assert line in error, error


@contextlib.contextmanager
def _time_limit() -> Iterator[None]:
    def late(*_: object) -> None:
        raise AssertionError(f"it has not ended after {TIME_LIMIT} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(TIME_LIMIT)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
