"""Time whole commands, each in its own process: to the first words, to the verdict and to the end."""

import json
import os
import subprocess
import sys
import time
from functools import cache, partial
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
COLUMNS = ("first words, s", "verdict, s", "end, s", "CPU, s", "memory, MB")
FIRST, VERDICT, END, CPU, MEMORY = COLUMNS
"""What is measured of a command. Memory is the peak of its largest process."""
RECORDS = 10
"""Number of records in the comparison with the script: two of each group of the contest."""

USUAL = {"PYTHONUNBUFFERED": "1", "PYTHONDONTWRITEBYTECODE": ""}
"""Variables of the environment. An installation stores the compiled bytecode of modules, so a command must find it."""

LAUNCHER = """
import json, resource, subprocess, sys, time
print(time.monotonic(), flush=True)
status = subprocess.run(sys.argv[1:], stderr=subprocess.STDOUT).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""
"""A small process starts the command: to a process's peak memory Linux adds that of the process that forked it. It
prints the time at which it starts the command, because its own start must not count."""


@cache
def folder() -> TemporaryDirectory[str]:
    """Return the folder of records, answers and caches, which is removed at the end."""
    return TemporaryDirectory(prefix="bayesdamp-bench-")


def record(samples: int = 5_000, cycles: int = 70, number: int = 0, lost: float = 0.0) -> str:
    """Write a pendulum with friction that decays to a fifth of its first amplitude; return the path of the file.

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
    table = np.column_stack([t, y])[np.abs(t / t[-1] - 0.5) >= lost / 2]
    path = Path(folder().name) / f"record_{samples}_{cycles}_{number}_{lost}.csv"
    np.savetxt(path, table, fmt="%.10g", delimiter=",", header="time (s),angle (rad)", comments="")
    return str(path)


def measure(command: str, *records: str, fresh: bool = False, again: bool = True) -> list[float]:
    """Run a command twice, or once if not `again`; return the least of each of its `COLUMNS`.

    fresh: with nothing compiled, as after an installation.
    """
    home, (name, *options) = Path(folder().name), command.split()
    caches = {name: str(home / f"fresh_{again}") for name in ("BAYESDAMP_CACHE", "NUMBA_CACHE_DIR") if fresh}
    if name == "compare":
        options += ["--out", str(home / f"answer_{time.monotonic_ns()}")]
    first, verdict = np.nan, np.nan
    with subprocess.Popen(
        [sys.executable, "-c", LAUNCHER, sys.executable, "-m", "bayesdamp", name, *records, *options],
        text=True, stdout=subprocess.PIPE, env=os.environ | caches | USUAL,
    ) as process:  # fmt: skip
        start = float(process.stdout.readline())
        for line in process.stdout:
            now = time.monotonic() - start
            first = now if "It oscillates" in line and np.isnan(first) else first
            verdict = now if ": Viscous + Coulomb" in line and np.isnan(verdict) else verdict
    status, cpu, memory = json.loads(line)
    assert status == 0
    once = [first, verdict, now, cpu, memory]
    return once if not again else list(np.fmin(once, measure(command, *records, fresh=fresh, again=False)))


def test_commands() -> None:
    """Of each bar of a command, by column, the page shows the ratio of the bar to what was measured."""
    runs, several = [record(number=i) for i in range(10)], [record(1_000, 20, i) for i in range(20)]
    hours, hole = record(1_000_000, 30_000), record(1_000_000, 30_000, lost=0.05)
    bars = {FIRST: 1.0, VERDICT: 2.0, END: 3.0, CPU: 4.0, MEMORY: 400.0}
    costs = {
        "--help": (measure("--help"), {CPU: 0.2}),
        "look": (measure("look", record()), {CPU: 0.6}),
        "with sampling": (measure("compare", record()), {END: 5.0}),
        "55 s at 1 kHz, with sampling": (measure("compare", record(55_000, 40)), {END: 15.0}),
        "ten runs of a rig, with sampling": (measure("compare --repeats", *runs), {END: 30.0}),
        "nothing compiled": (measure("compare --quick", record(), fresh=True), {VERDICT: 20.0}),
        "5,000 samples, 70 cycles": (measure("compare --quick", record()), bars),
        "1,000 samples": (measure("compare --quick", record(1_000)), {}),
        "50,000 samples": (measure("compare --quick", record(50_000)), {}),
        "10 cycles": (measure("compare --quick", record(cycles=10)), {}),
        "300 cycles": (measure("compare --quick", record(cycles=300)), {}),
        "one model": (measure("compare --quick --restoring linear --damping viscous", record()), {}),
        "a million samples, 1,000 cycles": (measure("compare --quick", record(1_000_000, 1_000)), {}),
        "a million samples, 30,000 cycles": (measure("compare --quick", hours), {END: 30.0}),
        "the same without 5 % of it": (measure("compare --quick", hole), {END: 30.0}),
        "20 records of 1,000 samples": (measure("compare --quick --workers 1", *several), {CPU: 20.0}),
        "the same, two workers": (measure("compare --quick --workers 2", *several), {CPU: 20.0}),
    }
    rows = [[what, *("" if np.isnan(c) else f"{c:.3g}" for c in cost)] for what, (cost, _) in costs.items()]
    ratios = {
        f"{what}: {bar:g} {column.split()[-1]} / {column.split(',')[0]}": bar / cost[COLUMNS.index(column)]
        for what, (cost, own) in costs.items()
        for column, bar in own.items()
    }
    assert np.all(np.isfinite(list(ratios.values())))
    title = "Commands; unless stated otherwise, compare --quick of a record of 5,000 samples and 70 cycles"
    add_table(title, ["what", *COLUMNS], rows, ratios, dict.fromkeys(ratios, 1.0))


def test_an_engineers_script() -> None:
    rows, ratios = [], {}
    for case in (simulate_record(815, number) for number in range(RECORDS)):
        ours = partial(bd.compare, case.signal, sample=False)
        ours, script = in_turns(ours, partial(answer, case.signal, case.amplitudes), rounds=2)
        rows.append([case.name, f"{ours:.2f}", f"{script:.2f}"])
        ratios[f"{case.name}: script / ours"] = script / ours
    title = "CPU seconds of compare without sampling, beside an engineer's script"
    add_table(title, ["record", "ours", "script"], rows, ratios, dict.fromkeys(ratios, 1.0))
