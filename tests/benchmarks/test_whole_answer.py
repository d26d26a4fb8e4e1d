"""The cost of a whole answer: `compare` from its start to the verdict and to its end, and how the cost grows with
samples, cycles, candidates and records."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from bayesdamp.physics.oscillator import Oscillator, simulate
from tests.benchmarks.page import add_table

SAMPLES, CYCLES = 5_000, 70
"""The largest record for which the bars below are promised."""
FRESH, USED, WHOLE, THREE = 25.0, 10.0, 60.0, 90.0
"""Seconds to the verdict of one record after an installation and later, to its end, and to the end of three repeats."""
MILLION = 1_000_000
STIFFNESS, NOISE = 20.0, 1e-3

LAUNCHER = """
import json, resource, subprocess, sys
status = subprocess.run(sys.argv[1:], stderr=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""
"""A small process starts the command: to a process's peak memory Linux adds that of the process that forked it."""


@dataclass(frozen=True)
class Cost:
    """Seconds to the verdict and to the end, CPU seconds of all processes, and peak memory of the largest in MiB."""

    verdict: float
    end: float
    cpu: float
    memory: float


@cache
def folder() -> TemporaryDirectory[str]:
    """Return the folder of records, answers and caches, which is removed at the end."""
    return TemporaryDirectory(prefix="bayesdamp-bench-")


@cache
def record(samples: int = SAMPLES, cycles: int = CYCLES, number: int = 0) -> Path:
    """Write a pendulum with friction that decays to a fifth of its first amplitude, and return the file."""
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
    header = "time (s),angle (rad)"
    np.savetxt(path, np.column_stack([t, y]), fmt="%.10g", delimiter=",", header=header, comments="")
    return path


def compare(*records: Path, options: str = "--quick", fresh: bool = False) -> Cost:
    """Run `compare` in a process of its own. fresh: with nothing compiled, as after an installation."""
    home = Path(folder().name)
    caches = {name: str(home / "fresh") for name in ("BAYESDAMP_CACHE", "NUMBA_CACHE_DIR") if fresh}
    out = home / f"answer_{time.monotonic_ns()}"
    command = ["-m", "bayesdamp", "compare", *map(str, records), "--out", str(out), *options.split()]
    start = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-c", LAUNCHER, sys.executable, *command], text=True, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONUNBUFFERED": "1", **caches},
    ) as process:  # fmt: skip
        first = process.stdout.readline()
        verdict = time.perf_counter() - start
        rest = process.stdout.read()
    end = time.perf_counter() - start
    status, cpu, memory = json.loads(rest.splitlines()[-1])
    assert status == 0
    assert "damping ratio" in first
    return Cost(verdict, end, cpu, memory)


def add_costs(title: str, costs: Mapping[str, Cost], ratios: dict[str, float]) -> None:
    rows = [
        [name, f"{c.verdict:.1f}", f"{c.end:.1f}", f"{c.cpu:.1f}", f"{c.memory:.0f}"]
        for name, c in costs.items()
    ]
    header = ["what", "s to the verdict", "s to the end", "CPU s", "peak MiB"]
    add_table(title, header, rows, ratios, dict.fromkeys(ratios, 1.0))


def test_one_record_and_three() -> None:
    three_records = [record(number=i) for i in range(3)]
    fresh = compare(record(), fresh=True)
    used = compare(record(), options="")
    three = compare(*three_records, options="--repeats")
    ratios = {
        "verdict of a record, fresh installation: 25 s / ours": FRESH / fresh.verdict,
        "verdict of a record, used installation: 10 s / ours": USED / used.verdict,
        "a record with sampling and report: 60 s / ours": WHOLE / used.end,
        "three repeats to their end: 90 s / ours": THREE / three.end,
    }
    costs = {"one record, nothing compiled, --quick": fresh, "one record": used, "three repeats": three}
    add_costs(f"Seconds by a stopwatch, {SAMPLES:,} samples and {CYCLES} cycles", costs, ratios)


def test_growth() -> None:
    three_records = [record(number=i) for i in range(3)]
    costs = {
        f"{SAMPLES:,} samples, {CYCLES} cycles": compare(record()),
        "1,000 samples": compare(record(1_000)),
        "50,000 samples": compare(record(50_000)),
        "10 cycles": compare(record(cycles=10)),
        "300 cycles": compare(record(cycles=300)),
        "1,000,000 samples, 1,000 cycles": compare(record(MILLION, 1_000)),
        "1,000,000 samples, 30,000 cycles": compare(record(MILLION, 30_000)),
        "one law, one damping": compare(record(), options="--quick --restoring linear --damping viscous"),
        "3 records, 1 worker": compare(*three_records, options="--quick --workers 1"),
        "3 records, 2 workers": compare(*three_records, options="--quick --workers 2"),
    }
    ratios = {"memory for 1,000,000 samples: 1 GiB / ours": 1024 / max(c.memory for c in costs.values())}
    add_costs("Growth of the cost with --quick, one change at a time", costs, ratios)
