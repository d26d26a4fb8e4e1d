"""An output that is full, closed by its reader, or missing."""

import errno
import os
import subprocess
import sys
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
        process = subprocess.run(HELP, stdout=full, stderr=subprocess.PIPE, text=True)
    line = "the output: the disk is full; make room there, then run the same command again\n"
    assert (process.returncode, process.stderr) == (2, line)


def test_a_reader_that_closes_the_output_is_not_an_error():
    read, closed = os.pipe()
    os.close(read)
    process = subprocess.run(HELP, stdout=closed, stderr=subprocess.PIPE, text=True)
    assert (process.returncode, process.stderr) == (141, "")
    for words in (("--nope",), ("--help",)):
        process = subprocess.run((*HELP[:-1], *words), stdout=closed, stderr=closed)
        assert process.returncode in (141, WRONG_INPUT)
    os.close(closed)


def test_another_closed_pipe_is_an_internal_error(monkeypatch: pytest.MonkeyPatch, capsys):
    """Control of the test above: this pipe is not an output of the command."""
    broken = Mock(side_effect=BrokenPipeError(errno.EPIPE, "Broken pipe"))
    monkeypatch.setattr(app, "build_parser", lambda _: broken)
    assert app.main(["doctor"]) == 1
    assert "internal error: BrokenPipeError" in capsys.readouterr().err


def test_a_command_works_without_an_output():
    """Services and timers may have none; here the shell closes it."""
    process = subprocess.run(("sh", "-c", 'exec "$@" >&-', "sh", *HELP), stderr=subprocess.PIPE, text=True)
    assert (process.returncode, process.stderr) == (0, "")
