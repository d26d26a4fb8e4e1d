"""Worker processes of a run: their environment, and their end when the run is killed."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from bayesdamp import machine
from bayesdamp.machine import at_once, kill_as_interrupt, processes

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


def test_workers_have_one_thread_and_the_environment_is_not_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    before = dict(os.environ)
    with processes(1) as pool:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result(timeout=60) == "1"
    assert dict(os.environ) == before


def threads(items: int, slow: bool = True) -> set[str]:
    return set(at_once(lambda _: (time.sleep(0.01), threading.current_thread().name)[1], range(items), slow))


def test_threads_are_used_only_if_they_do_not_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "cores", lambda: 2)
    assert len(threads(4)) == 2
    assert threads(4, slow=False) == threads(1) == {threading.current_thread().name}
    with ThreadPoolExecutor(1) as pool, processes(1) as others:
        assert [len(each.submit(threads, 4).result(timeout=60)) for each in (pool, others)] == [1, 1]


def test_a_run_that_is_killed_leaves_no_process(tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(SCRIPT, encoding="utf-8")
    pipe = subprocess.PIPE
    run = subprocess.Popen([sys.executable, str(tmp_path / "run.py")], stdout=pipe, stderr=pipe, text=True)
    workers = [int(pid) for pid in run.stdout.readline().split()]
    assert workers
    assert all(map(alive, workers))
    run.send_signal(signal.SIGTERM)
    _, error = run.communicate(timeout=60)
    deadline = time.monotonic() + 30
    while any(map(alive, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert "KeyboardInterrupt" in error
    assert "leaked" not in error


def test_a_signal_to_end_becomes_an_interrupt() -> None:
    """Controls: a signal that is ignored has no effect; afterwards the handler is that of before."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        before = signal.signal(number, signal.SIG_DFL)  # the tests may run with the signal ignored
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
