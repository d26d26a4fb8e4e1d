"""Processes that share a run's work: they begin early, and none is left when the run is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from bayesdamp.machine import kill_as_interrupt, processes

SCRIPT = """
import os, time
from bayesdamp.machine import processes

if __name__ == "__main__":
    with processes(2) as pool:
        print(*{f.result() for f in [pool.submit(os.getpid) for _ in range(20)]}, flush=True)
        for _ in range(4):
            pool.submit(time.sleep, 60)
        time.sleep(60)
"""


def alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def test_the_environment_is_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = dict(os.environ)
    with processes(1) as pool:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result(timeout=60) == "1"
    assert dict(os.environ) == before


def test_a_run_that_is_killed_leaves_no_process_and_no_complaint(tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(SCRIPT, encoding="utf-8")
    pipe = subprocess.PIPE
    run = subprocess.Popen([sys.executable, str(tmp_path / "run.py")], stdout=pipe, stderr=pipe, text=True)
    workers = [int(pid) for pid in run.stdout.readline().split()]
    assert workers
    assert all(map(alive, workers))
    run.send_signal(signal.SIGTERM)
    _, said = run.communicate(timeout=60)
    deadline = time.monotonic() + 30
    while any(map(alive, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert "KeyboardInterrupt" in said
    assert "leaked" not in said


def test_what_is_told_to_end_is_interrupted() -> None:
    """Negative controls: who was told to ignore it goes on; afterwards it ends a process as before."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        before = signal.signal(number, signal.SIG_DFL)  # who runs the tests may have them ignore it
        try:
            with pytest.raises(KeyboardInterrupt), kill_as_interrupt():
                signal.raise_signal(number)
            assert signal.getsignal(number) is signal.SIG_DFL
            signal.signal(number, signal.SIG_IGN)
            with kill_as_interrupt():
                os.kill(os.getpid(), number)
                time.sleep(0.1)
        finally:
            signal.signal(number, before)
