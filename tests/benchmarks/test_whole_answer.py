"""What a user waits for: `compare` from the command to its verdict and to its end, by a stopwatch, on a fresh
installation and a used one; and how that grows with samples, cycles, what is weighed, records and workers."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from tests.benchmarks.ledger import ratio, table
from tests.benchmarks.timing import in_turns
from validation.contest.peers import ours, script
from validation.contest.records import simulate_record

SAMPLES, CYCLES = 5_000, 70
"""The largest record for which the times below are promised."""
FRESH, USED, PROVEN, OF_THREE = 25.0, 10.0, 60.0, 90.0
"""Seconds to the verdict of one record, on a fresh installation and a used one, to the end of its sampling, and to the
end of three repeats'."""
STIFFNESS, NOISE = 20.0, 1e-3
CONTEST_SEED, CONTEST_RECORDS = 2711, 10
SIMPLE = ("--restoring", "linear", "--damping", "viscous")


@dataclass(frozen=True)
class Waited:
    """Seconds to the verdict and to the end, and CPU seconds of all processes."""

    answer: float
    end: float
    cpu: float


@lru_cache
def folder() -> TemporaryDirectory[str]:
    """Where records, answers and caches go; removed at the end."""
    return TemporaryDirectory(prefix="bayesdamp-bench-")


@lru_cache
def record(samples: int = SAMPLES, cycles: int = CYCLES, number: int = 0) -> Path:
    """A pendulum with friction that ends at a fifth of its first amplitude, as a file."""
    w = np.sqrt(STIFFNESS)
    t = np.linspace(0.0, 2 * np.pi * cycles / w, samples)
    zeta = np.log(4.0) / t[-1]
    p = {
        "zeta": zeta, "mu_c": 0.02 * zeta * w, "stiffness": STIFFNESS, "rest_angle": 0.0, "theta0": 0.3 + 0.01 * number,
        "omega0": 0.0, "epsilon": 0.01,
    }  # fmt: skip
    y = simulate(Oscillator(("viscous", "coulomb"), "pendulum"), p, t)
    y = y + NOISE * np.random.default_rng(number).standard_normal(t.size)
    path = Path(folder().name) / f"record_{samples}_{cycles}_{number}.csv"
    np.savetxt(path, np.column_stack([t, y]), delimiter=",", header="time (s),angle (rad)", comments="")
    return path


@lru_cache
def compared(records: tuple[Path, ...], options: tuple[str, ...] = (), fresh: bool = False) -> Waited:
    """`compare` of records in a process of its own. fresh: with nothing compiled, as after an installation."""
    home = Path(folder().name)
    caches = {"BAYESDAMP_CACHE": home / "fresh", "NUMBA_CACHE_DIR": home / "fresh"} if fresh else {}
    out = home / f"answer_{time.monotonic_ns()}"
    asked = [sys.executable, "-m", "bayesdamp", "compare", *map(str, records), "--out", str(out), *options]
    env = {**os.environ, "PYTHONUNBUFFERED": "1", **{name: str(path) for name, path in caches.items()}}
    before, began = _cpu(), time.perf_counter()
    with subprocess.Popen(
        asked, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as run:
        first = run.stdout.readline()  # what is read and shown on the way is on the other stream
        answer = time.perf_counter() - began
        run.stdout.read()
    assert run.returncode == 0
    assert "damping ratio" in first
    return Waited(answer, time.perf_counter() - began, _cpu() - before)


def _cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def repeats(count: int) -> tuple[Path, ...]:
    return tuple(record(number=i) for i in range(count))


def test_one_record_and_three() -> None:
    runs = {
        "one record, nothing compiled yet": compared(repeats(1), ("--quick",), fresh=True),
        "one record, used installation": compared(repeats(1)),
        "three repeats": compared(repeats(3), ("--repeats",)),
    }
    fresh, alone, three = runs.values()
    ratio("a record's verdict, fresh installation: 25 s / ours", FRESH / fresh.answer, 1.0)
    ratio("a record's verdict, used installation: 10 s / ours", USED / alone.answer, 1.0)
    ratio("a record's sampling and report: 60 s / ours", PROVEN / alone.end, 1.0)
    ratio("three repeats to their end: 90 s / ours", OF_THREE / three.end, 1.0)
    show(f"What a user waits for, {SAMPLES:,} samples and {CYCLES} cycles, by a stopwatch", runs)


def test_growth() -> None:
    base = compared((record(),), ("--quick",))
    runs = {
        f"{SAMPLES:,} samples, {CYCLES} cycles": base,
        "1,000 samples": compared((record(1_000),), ("--quick",)),
        "50,000 samples": compared((record(50_000),), ("--quick",)),
        "10 cycles": compared((record(cycles=10),), ("--quick",)),
        "300 cycles": compared((record(cycles=300),), ("--quick",)),
        "one law, one damping": compared((record(),), ("--quick", *SIMPLE)),
        "3 records, 1 worker": compared(repeats(3), ("--quick", "--workers", "1")),
        "3 records, 2 workers": compared(repeats(3), ("--quick", "--workers", "2")),
    }
    ratio("3 records: 1 worker / 2", runs["3 records, 1 worker"].end / runs["3 records, 2 workers"].end)
    show("How the wait for a verdict grows, one change at a time", runs)


def show(title: str, runs: dict[str, Waited]) -> None:
    rows = [[name, *(f"{seconds:.1f}" for seconds in (r.answer, r.end, r.cpu))] for name, r in runs.items()]
    table(title, ["what", "s to the verdict", "s to the end", "CPU s"], rows)


def test_beside_a_script() -> None:
    """`compare` without sampling and the script of 130 lines that an engineer would write, in one process."""
    rows, ratios = [], []
    for number in range(CONTEST_RECORDS):
        record = simulate_record(CONTEST_SEED, number)
        arguments = (record.signal.t, record.signal.y, record.amplitudes)
        answers = (partial(answer, *arguments) for answer in (script.answer, ours.answer))
        its, own = in_turns(*answers, rounds=2)
        ratios.append(its / own)
        rows.append([record.name, f"{its:.2f}", f"{own:.2f}", f"{its / own:.2f}"])
    ratio("CPU seconds of an answer, median of ten records: script / ours", float(np.median(ratios)))
    ratio("CPU seconds of an answer, slowest of ten records: script / ours", min(ratios))
    table(
        "CPU seconds of an answer beside a script of 130 lines", ["record", "script", "ours", "ratio"], rows
    )
