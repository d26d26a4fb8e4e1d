"""Time whole commands, each in its own process: to the first words, to the verdict and to the end."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import bayesdamp as bd
from bayesdamp.physics.oscillator import Oscillator, simulate
from tests.benchmarks.page import add_table
from tests.benchmarks.timing import in_turns
from validation.contest.records import simulate_record
from validation.contest.script import answer

STIFFNESS, NOISE = 20.0, 1e-3
"""(2π × frequency)² of small oscillations in s⁻², and standard deviation of the noise in rad."""
COLUMNS = {"first words, s": 2, "verdict, s": 2, "end, s": 2, "CPU, s": 2, "memory, MB": 0}
"""Measured quantities of a command with their decimals. Memory is the peak of the largest process."""
RECORDS = 10
"""Number of records in the comparison with the script: two of each group of the contest."""

LAUNCHER = """
import json, resource, subprocess, sys
status = subprocess.run(sys.argv[1:], stderr=subprocess.STDOUT).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""
"""A small process starts the command: to a process's peak memory Linux adds that of the process that forked it."""


@cache
def folder() -> TemporaryDirectory[str]:
    """Return the folder of records, answers and caches, which is removed at the end."""
    return TemporaryDirectory(prefix="bayesdamp-bench-")


def record(samples: int = 5_000, cycles: int = 70, number: int = 0, lost: float = 0.0) -> str:
    """Write a pendulum with friction that decays to a fifth of its first amplitude; return the file's path.

    lost: fraction of the record that a gap in its middle removes.
    """
    w = np.sqrt(STIFFNESS)
    t = np.linspace(0.0, 2 * np.pi * cycles / w, samples)
    zeta = np.log(4.0) / t[-1]
    p = {
        "zeta": zeta, "mu_c": 0.02 * zeta * w, "stiffness": STIFFNESS, "rest_angle": 0.0, "theta0": 0.3 + 0.01 * number,
        "omega0": 0.0, "epsilon": 0.01,
    }  # fmt: skip
    y = simulate(Oscillator(("viscous", "coulomb"), "pendulum"), p, t)
    y = y + NOISE * np.random.default_rng(number).standard_normal(t.size)
    left = np.abs(t / t[-1] - 0.5) >= lost / 2
    path = Path(folder().name) / f"record_{samples}_{cycles}_{number}_{lost}.csv"
    table, header = np.column_stack([t, y])[left], "time (s),angle (rad)"
    np.savetxt(path, table, fmt="%.10g", delimiter=",", header=header, comments="")
    return str(path)


def measure(command: str, *records: str, fresh: bool = False) -> list[float]:
    """Run a command; return its `COLUMNS`. fresh: with nothing compiled, as after an installation."""
    home = Path(folder().name)
    caches = {name: str(home / "fresh") for name in ("BAYESDAMP_CACHE", "NUMBA_CACHE_DIR") if fresh}
    name, *options = command.split()
    out = [] if name in ("--help", "look") else ["--out", str(home / f"answer_{time.monotonic_ns()}")]
    start, seen = time.perf_counter(), {}
    with subprocess.Popen(
        [sys.executable, "-c", LAUNCHER, sys.executable, "-m", "bayesdamp", name, *records, *out, *options],
        text=True, stdout=subprocess.PIPE, env={**os.environ, "PYTHONUNBUFFERED": "1", **caches},
    ) as process:  # fmt: skip
        for line in process.stdout:
            for what, part in (
                ("first", "It oscillates"),
                ("verdict", ": equivalent damping ratio"),
                ("end", ""),
            ):
                if part in line and (what == "end" or what not in seen):
                    seen[what] = time.perf_counter() - start
    status, cpu, memory = json.loads(line)
    assert status == 0
    return [seen.get("first", np.nan), seen.get("verdict", np.nan), seen["end"], cpu, memory]


def add_costs(title: str, costs: Mapping[str, list[float]], bars: Mapping[str, Mapping[str, float]]) -> None:
    """Add a table of costs; of each bar (by row and column) the ratio bar / cost is shown."""
    rows = [
        [what, *("" if np.isnan(c) else f"{c:.{d}f}" for c, d in zip(cost, COLUMNS.values(), strict=True))]
        for what, cost in costs.items()
    ]
    places = list(COLUMNS)
    ratios = {
        f"{what}: {column} (bar {bar:g})": bar / costs[what][places.index(column)]
        for what, wanted in bars.items()
        for column, bar in wanted.items()
    }
    add_table(title, ["what", *COLUMNS], rows, ratios, dict.fromkeys(ratios, 1.0))


def test_commands() -> None:
    quick = dict(zip(COLUMNS, (1.0, 2.0, 3.0, 4.0, 400.0), strict=True))
    end, runs = {"end, s": 15.0}, [record(number=i) for i in range(10)]
    measured = {
        "--help": (measure("--help"), {"CPU, s": 0.2}),
        "look": (measure("look", record()), {"CPU, s": 0.6}),
        "one record, --quick": (measure("compare --quick", record()), quick),
        "one record, --quick, nothing compiled": (
            measure("compare --quick", record(), fresh=True),
            {"verdict, s": 20.0},
        ),
        "one record": (measure("compare", record()), {"end, s": 5.0}),
        "ten runs of one rig": (measure("compare --repeats", *runs), {"end, s": 30.0}),
        "55 s at 1 kHz": (measure("compare", record(55_000, 40)), end),
    }
    costs = {what: cost for what, (cost, _) in measured.items()}
    add_costs(
        "Commands, records of 5,000 samples and 70 cycles",
        costs,
        {what: bars for what, (_, bars) in measured.items()},
    )


def test_growth() -> None:
    several = [record(1_000, 20, i) for i in range(20)]
    costs = {
        "1,000 samples": measure("compare --quick", record(1_000)),
        "50,000 samples": measure("compare --quick", record(50_000)),
        "10 cycles": measure("compare --quick", record(cycles=10)),
        "300 cycles": measure("compare --quick", record(cycles=300)),
        "a million samples, 1,000 cycles": measure("compare --quick", record(1_000_000, 1_000)),
        "a million samples, 30,000 cycles": measure("compare --quick", record(1_000_000, 30_000)),
        "the same without 5 % of it": measure("compare --quick", record(1_000_000, 30_000, lost=0.05)),
        "one law, one damping": measure("compare --quick --restoring linear --damping viscous", record()),
        "20 records of 1,000 samples, 1 worker": measure("compare --quick --workers 1", *several),
        "20 records of 1,000 samples, 2 workers": measure("compare --quick --workers 2", *several),
    }
    bars = {
        what: {"end, s": 30.0} for what in ("a million samples, 30,000 cycles", "the same without 5 % of it")
    }
    bars |= {what: {"CPU, s": 20.0} for what in costs if what.startswith("20 records")}
    add_costs("Growth with --quick, one change at a time", costs, bars)


def test_an_engineers_script() -> None:
    cases = [simulate_record(815, number) for number in range(RECORDS)]
    rows, ratios = [], {}
    for number, c in enumerate(cases):
        ours, script = in_turns(
            lambda c=c: bd.compare(c.signal, sample=False),
            lambda c=c: answer(c.signal, c.amplitudes),
            rounds=2,
        )
        what = f"{c.name.split('-')[0]} {number}"
        rows.append([what, f"{ours:.2f}", f"{script:.2f}"])
        ratios[f"{what}: script / ours"] = script / ours
    add_table(
        "CPU seconds beside an engineer's script",
        ["record", "ours", "script"],
        rows,
        ratios,
        dict.fromkeys(ratios, 1.0),
    )
