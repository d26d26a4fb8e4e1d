"""Where the output goes nowhere: full, closed by its reader, or not there at all."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HELP = (sys.executable, "-m", "bayesdamp", "--help")
FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="Linux's full device")
def test_a_full_disk_behind_the_output_is_named():
    with FULL.open("w") as full:
        done = subprocess.run(HELP, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr == "the output: the disk is full; make room there, then run the same command again\n"


def test_a_reader_that_has_gone_is_named():
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(HELP, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert done.returncode == 2
    assert done.stderr.startswith("what reads the output has closed it")
    assert done.stderr.count("\n") == 1


def test_without_an_output_a_command_does_what_it_does():
    """As of a service or a timer that has none. The shell closes it: a fork after JAX has started is an error."""
    done = subprocess.run(("sh", "-c", 'exec "$@" >&-', "sh", *HELP), stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (0, "")
