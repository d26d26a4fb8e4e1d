"""Stored results are complete or absent, floats are exact, and only one process writes."""

import json
import math
import signal
import subprocess
import sys
import time
from unittest.mock import Mock

import numpy as np
import pytest

from bayesdamp.store import files, results
from bayesdamp.store.files import TABLES, read_table, temporary_path, write_bytes, write_json, write_table
from bayesdamp.store.results import Store, TaskResult, provenance, sha256
from bayesdamp.types import InputError

NAME = "estimate/bench/0/viscous+coulomb/least_squares"
AWKWARD = [0.1, 1 / 3, math.pi * 1e-300, 5e-324, 1.7976931348623157e308, -0.0, math.inf, -math.inf, math.nan]


def result(name: str = NAME, key: str = "k1") -> TaskResult:
    arrays = {
        "draws": np.random.default_rng(1).normal(size=(2, 5, 3)),
        "values / odd name": np.array(AWKWARD),
        "counts": np.arange(4),
        "empty": np.zeros((0, 2)),
    }
    meta = {"floats": AWKWARD, "nested": {"a": [1, None, "é"]}, "np": np.float64(1 / 3), "whole": np.int64(7)}
    return TaskResult(name, key, meta, arrays, "ok", 1.25)


def bits(r: TaskResult) -> tuple:
    """Return a form of a result in which NaN and the sign of 0 count; JSON writes floats exactly."""
    arrays = {k: (v.dtype.str, v.shape, v.tobytes()) for k, v in r.arrays.items()}
    return r.name, r.key, r.outcome, r.seconds, json.dumps(r.meta, default=lambda v: v.item()), arrays


def test_a_result_counts_only_with_its_key(tmp_path):
    store = Store(tmp_path / "out")
    assert not store.has(NAME, "k1")
    assert store.names() == []
    with pytest.raises(KeyError, match="least_squares"):
        store.read(NAME)
    assert not (tmp_path / "out").exists()  # reading creates nothing
    store.write(result())
    assert [store.has(NAME, key) for key in ("k1", "k2")] == [True, False]
    store.write(result(key="k2"))
    assert [store.has(NAME, key) for key in ("k1", "k2")] == [False, True]


def test_a_name_cannot_leave_the_folder(tmp_path):
    for name in ("", "/abs", "a//b", "../up", "a/../b", "a/.hidden", "a\\b", "a/"):
        with pytest.raises(ValueError, match="not the name of a task"):
            Store(tmp_path).write(result(name))
    assert list(tmp_path.rglob("*.npz")) == []


def test_a_damaged_result_is_absent_or_unchanged(tmp_path):
    """Truncated at every 37th byte it is absent; with every third byte changed it is absent, or read bit for bit."""
    store = Store(tmp_path)
    store.write(result())
    path = tmp_path / "cells" / f"{NAME}.npz"
    whole = path.read_bytes()
    assert bits(store.read(NAME)) == bits(result())
    for length in {*range(0, len(whole), 37), len(whole) - 1}:
        path.write_bytes(whole[:length])
        assert not store.has(NAME, "k1"), length
    absent = 0
    for place in range(0, len(whole), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 0x5A
        path.write_bytes(damaged)
        try:
            assert bits(store.read(NAME)) == bits(result()), place
        except KeyError:
            absent += 1
    assert absent > 0.5 * len(whole) / 3


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    store = Store(tmp_path)
    store.write(result())

    monkeypatch.setattr(files.os, "fsync", Mock(side_effect=OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        store.write(result(key="k2"))
    assert store.has(NAME, "k1")
    assert [p for p in tmp_path.rglob("*") if p.suffix == ".tmp"] == []


WRITER = """
import sys, numpy as np
from pathlib import Path
from bayesdamp.store.results import Store, TaskResult
store = Store(Path(sys.argv[1]))
with store.lock():
    print("locked", flush=True)
    i = 0
    while True:
        i += 1
        array = np.full(300_000, float(i))
        store.write(TaskResult("a/b", str(i), {"i": i}, {"x": array}))
"""


def complete(version: TaskResult) -> int:
    """Check that a result of WRITER is complete, and return its number."""
    assert np.all(version.arrays["x"] == version.meta["i"])
    return version.meta["i"]


def test_a_killed_process_leaves_a_complete_file_and_no_lock(tmp_path):
    store = Store(tmp_path)
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    with process, process.stdout:
        assert process.stdout.readline() == "locked\n"
        versions: set[int] = set()
        end = time.monotonic() + 20
        while len(versions) < 5 and time.monotonic() < end:
            if store.names():
                versions.add(complete(store.read("a/b")))
        with pytest.raises(InputError, match=rf"process {process.pid}\) is writing here"), store.lock():
            pass
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert len(versions) >= 5
    complete(store.read("a/b"))
    for written in ("cells/a/b.npz", "run.json"):
        temporary_path(tmp_path / written).write_bytes(b"half")
    with store.lock():
        assert not list(tmp_path.rglob("*.tmp"))
        assert store.names() == ["a/b"]


def test_a_folder_that_cannot_be_written_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write a run here"), Store(tmp_path / "file" / "run").lock():
        pass


def test_a_table_is_read_exactly(tmp_path):
    columns = TABLES["estimates.csv"]
    numbers = [*AWKWARD, *np.exp(np.random.default_rng(2).normal(0, 100, 200)).tolist()]
    text = {"signal": "60", "model": "viscous+coulomb", "outcome": 'the word "no", twice\nand left'}
    rows = [{**text, "repeat": i, "value": v, "stderr": np.float64(v)} for i, v in enumerate(numbers)]
    write_table(tmp_path / "estimates.csv", columns, rows)
    absent = {"truth": math.nan, "evaluations": None}
    for row, stored in zip(rows, read_table(tmp_path / "estimates.csv"), strict=True):
        assert tuple(stored) == columns
        expected = row | absent | {"stderr": row["value"]}
        assert {name: repr(stored[name]) for name in expected} == {n: repr(v) for n, v in expected.items()}


def test_a_cell_that_is_not_a_number_is_refused_with_its_place(tmp_path):
    (tmp_path / "estimates.csv").write_text("signal,value\na,1.0\nb,1,\nc,x\n")
    with pytest.raises(InputError, match=r"estimates\.csv, line 4, column value: 'x' is not a number"):
        read_table(tmp_path / "estimates.csv")


def test_json_is_strict_and_exact(tmp_path):
    content = {"x": 1 / 3, "nan": math.nan, "inf": -math.inf, "a": np.arange(2), "p": (1, 2)}
    write_json(tmp_path / "run.json", content)

    back = json.loads((tmp_path / "run.json").read_text(), parse_constant=Mock(side_effect=AssertionError))
    assert back == {"x": 1 / 3, "nan": None, "inf": "-inf", "a": [0, 1], "p": [1, 2]}


def test_provenance_has_versions_machine_and_digests_of_inputs(tmp_path):
    write_bytes(tmp_path / "in.txt", b"abc")
    origin_of_run = provenance({"in.txt": tmp_path / "in.txt"})
    abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert origin_of_run["inputs"] == {"in.txt": abc}
    assert {"numpy", "scipy", "jax", "arviz-stats"} <= set(origin_of_run["versions"])
    assert origin_of_run["machine"]["cpus"] >= 1
    assert origin_of_run["revision"]
    assert set(provenance(packages=["numpy", "no-such-package"])["versions"]) == {"numpy"}
    write_bytes(tmp_path / "in.txt", b"abd")
    assert sha256(tmp_path / "in.txt") != abc


def test_an_installed_copy_reports_its_version(tmp_path, monkeypatch):
    """Not the commit of another project's checkout around it."""
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    copy = tmp_path / "site-packages" / "bayesdamp" / "store" / "results.py"
    write_bytes(copy, b"")
    monkeypatch.setattr(results, "__file__", str(copy))
    assert provenance()["revision"].startswith("version ")
