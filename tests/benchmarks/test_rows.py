"""What one record costs against its rows, up to a million: CPU seconds and peak memory of `compare`, from the file to
the answer, reading and cleaning by themselves."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import bayesdamp as bd
from tests.benchmarks.ledger import ratio, table

MILLION = 1_000_000
SIZES = tuple((rows, 1_000) for rows in (10_000, 30_000, 100_000, 300_000, MILLION))
LONGER = ((100_000, 3_000), (300_000, 9_000), (MILLION, 30_000))
"""Rows and cycles."""


@dataclass(frozen=True)
class Cost:
    """CPU seconds of all of `compare --quick`, and of reading and cleaning; peak memory in bytes, of the former."""

    rows: int
    cycles: int
    whole: float
    cleaning: float
    memory: float


def record(folder: Path, rows: int, cycles: int) -> Path:
    """A linear oscillator at 1 Hz that ends at a twentieth of its first amplitude, in closed form, as a file."""
    t = np.linspace(0.0, cycles, rows)
    y = 10.0 * np.exp(-np.log(20.0) * t / cycles) * np.cos(2 * np.pi * t)
    y += 0.05 * np.random.default_rng(rows + cycles).standard_normal(rows)
    path = folder / f"{rows}_{cycles}.csv"
    head = "time (s),angle (deg)"
    np.savetxt(path, np.column_stack([t, y]), fmt="%.9g", delimiter=",", header=head, comments="")
    return path


USED = """
import json, resource, subprocess, sys
quiet = subprocess.DEVNULL
status = subprocess.run(sys.argv[1:], stdout=quiet, stderr=quiet).returncode
of = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([status, of.ru_utime + of.ru_stime, 1024.0 * of.ru_maxrss]))
"""
"""Of a child that a small process starts: Linux counts as its peak what the process that it is forked from holds."""


def run(path: Path, *asked: str) -> tuple[float, float]:
    """CPU seconds and peak memory in bytes of a command on a record, with all that it started."""
    command = [sys.executable, "-m", "bayesdamp", *asked, str(path), "--out", str(path.with_suffix(""))]
    said = subprocess.run([sys.executable, "-c", USED, *command], check=True, capture_output=True, text=True)
    status, seconds, memory = json.loads(said.stdout)
    assert status == 0
    return seconds, memory


def cost(folder: Path, rows: int, cycles: int) -> Cost:
    """Of one record."""
    path = record(folder, rows, cycles)
    began = time.process_time()
    bd.read(path).signal()
    cleaning = time.process_time() - began
    whole, memory = run(path, "compare", "--quick")
    return Cost(rows, cycles, whole, cleaning, memory)


def test_rows(tmp_path: Path) -> None:
    cost(tmp_path, 1_000, 100)  # compiles
    found = [cost(tmp_path, *size) for size in SIZES]
    longer = [cost(tmp_path, *size) for size in LONGER]
    few, many = found[2], found[4]
    assert len({one.memory for one in found}) > 1  # not that of what started them
    assert many.rows == 10 * few.rows
    linear, most = 10 * few.cleaning / many.cleaning, max(c.memory for c in (*found, *longer))
    ratio("1,000,000 rows: ten times 100,000's read and cleaned / ours", linear, 1.0)
    ratio("1,000,000 rows: 1 GiB / ours, imports among it", 2.0**30 / most, 1.0)
    table(
        "What a record costs against its rows",
        ["rows", "cycles", "CPU s", "of it, read and cleaned", "peak MiB"],
        [
            [f"{c.rows:,}", f"{c.cycles:,}", f"{c.whole:.1f}", f"{c.cleaning:.2f}", f"{c.memory / 2**20:.0f}"]
            for c in (*found, *longer)
        ],
    )
