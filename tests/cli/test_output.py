"""Where the output goes nowhere: full, closed by its reader, or not there at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest

from bayesdamp.cli import app
from bayesdamp.cli.app import WRONG_INPUT

HELP = (sys.executable, "-m", "bayesdamp", "--help")
FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="Linux's full device")
def test_a_full_disk_behind_the_output_is_named():
    with FULL.open("w") as full:
        done = subprocess.run(HELP, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "the output: the disk is full; make room there, then run the same command again\n"


@pytest.fixture
def closed() -> Iterator[int]:
    """A pipe that nobody reads."""
    read, write = os.pipe()
    os.close(read)
    yield write
    os.close(write)


def test_a_reader_that_has_seen_enough_is_no_mistake(closed: int):
    for words in (("--help",), ("completion", "bash")):
        done = subprocess.run((*HELP[:-1], *words), stdout=closed, stderr=subprocess.PIPE, text=True)
        assert (done.returncode, done.stderr) == (141, "")
    for words in (("--nope",), ("--help",)):
        done = subprocess.run((*HELP[:-1], *words), stdout=closed, stderr=closed)
        assert done.returncode in (141, WRONG_INPUT)


def test_a_pipe_that_is_closed_elsewhere_is_a_fault(monkeypatch: pytest.MonkeyPatch, capsys):
    """Negative control: of a pipe that is none of the outputs it is not known why it is closed."""

    broken = Mock(side_effect=BrokenPipeError(errno.EPIPE, "Broken pipe"))
    monkeypatch.setattr(app, "build_parser", lambda _: broken)
    assert app.main(["doctor"]) == 1
    assert "internal error: BrokenPipeError" in capsys.readouterr().err


def test_without_an_output_a_command_does_what_it_does():
    """As of a service or a timer that has none. The shell closes it."""
    done = subprocess.run(("sh", "-c", 'exec "$@" >&-', "sh", *HELP), stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, "")
