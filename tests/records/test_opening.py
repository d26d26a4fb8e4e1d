"""Opening files: whatever a reader raises is one line, with its cause; one that crashes or hangs costs one line."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from bayesdamp.records.files.contents import Contents
from bayesdamp.records.opening import contents, load_isolated
from bayesdamp.records.read import read_record
from bayesdamp.records.readers.numpy_arrays import NumpyReader
from bayesdamp.types import InputError

FAULTS = (
    NotImplementedError("no version 25.5"),
    RuntimeError(),
    KeyError("x"),
    RecursionError("deep"),
    OSError("cut"),
)


@pytest.mark.parametrize("error", FAULTS, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize(
    ("method", "said"), [("claims", "is damaged or not what its name says"), ("read", "damaged or cut off")]
)
def test_a_reader_that_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, said: str, error: Exception
) -> None:
    def fails(*_: object) -> None:
        raise error

    np.save(tmp_path / "a.npy", np.eye(40))
    assert contents(tmp_path / "a.npy").columns
    monkeypatch.setattr(NumpyReader, method, fails)
    with pytest.raises(InputError, match=said) as caught:
        contents(tmp_path / "a.npy")
    assert caught.value.where == "a.npy"
    assert caught.value.__cause__ is error
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("method", ["claims", "read"])
def test_who_interrupts_is_no_damaged_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    np.save(tmp_path / "a.npy", np.eye(40))
    monkeypatch.setattr(NumpyReader, method, interrupted)
    with pytest.raises(KeyboardInterrupt):
        contents(tmp_path / "a.npy")


def test_threads_that_read_leave_output_and_warnings_of_the_program_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reads that overlap end in another order than they began in."""
    before, read = (sys.stdout, list(warnings.filters)), NumpyReader.read

    def slow(self: NumpyReader, path: Path) -> Contents:
        warnings.warn(
            "of no interest", stacklevel=1
        )  # an error in tests, where the reader's filter is not in force
        time.sleep(0.01 if path.stem == "0" else 0.002)
        return read(self, path)

    monkeypatch.setattr(NumpyReader, "read", slow)
    paths = [tmp_path / f"{i}.npy" for i in range(4)]
    for path in paths:
        np.save(path, np.eye(40))
    with ThreadPoolExecutor(4) as pool:
        assert all(found.columns for found in pool.map(contents, 3 * paths))
    assert (sys.stdout, warnings.filters) == before


def vectors(path: Path) -> dict[str, np.ndarray]:
    return {"a.b": np.array([1.0, 1 / 3, np.nan]), path.name: np.arange(4), "none": np.empty(0)}


def crashing(path: Path) -> dict[str, np.ndarray]:
    os.kill(os.getpid(), signal.SIGSEGV)
    return {}


def failing(path: Path) -> dict[str, np.ndarray]:
    raise KeyError("no such\nthing")


def refusing(path: Path) -> dict[str, np.ndarray]:
    raise InputError(f"{path.name}: holds no record; give another")


def hanging(path: Path) -> dict[str, np.ndarray]:
    time.sleep(60)
    return {}


def chatty(path: Path) -> dict[str, np.ndarray]:
    print("reading ...")
    return vectors(path)


@pytest.mark.parametrize("load", [vectors, chatty])
def test_arrays_come_back_bit_for_bit(load, tmp_path):
    found = load_isolated(load, tmp_path / "x.bin")
    wanted = vectors(tmp_path / "x.bin")
    assert list(found) == list(wanted)
    for name, array in wanted.items():
        assert found[name].dtype == array.dtype
        assert found[name].tobytes() == array.tobytes()


@pytest.mark.parametrize(
    ("load", "said"),
    [
        (crashing, r"x\.bin: its reader crashed \(SIGSEGV\); the file is damaged"),
        (failing, r"x\.bin: cannot be read \(KeyError: 'no such\\nthing'\); the file is damaged"),
        (refusing, r"^x\.bin: holds no record; give another$"),
        (hanging, r"x\.bin: its reader did not end within 1 s; the file is damaged"),
    ],
)
def test_what_goes_wrong_is_one_line(load, said, tmp_path):
    with pytest.raises(InputError, match=said) as caught:
        load_isolated(load, tmp_path / "x.bin", 1.0 if load is hanging else 60.0)
    assert "\n" not in str(caught.value)


def test_a_damaged_matlab_file_is_read_or_refused(tmp_path):
    """Six files with a few wrong bytes, of both formats: each is read, or costs one line."""
    t = np.linspace(0.0, 10.0, 200)
    savemat(tmp_path / "old.mat", {"run": {"t": t, "x": np.cos(t)}})
    with h5py.File(tmp_path / "new.mat", "w") as file:
        file["run/t"], file["run/x"] = t, np.cos(t)
    rng, refused = np.random.default_rng(0), list[tuple[str, str]]()
    for name in ("old", "new"):
        whole = (tmp_path / f"{name}.mat").read_bytes()
        for i in range(3):
            wrong = bytearray(whole)
            for at in rng.integers(0, 600, 8):
                wrong[at] = rng.integers(0, 256)
            path = tmp_path / f"{name}{i}.mat"
            path.write_bytes(bytes(wrong))
            try:
                raw = read_record(path, time="run.t", value="run.x")
                assert raw.y.size
            except InputError as error:
                refused.append((path.name, str(error)))
    assert refused
    assert all(name in said and "\n" not in said for name, said in refused)
    # negative control: the files themselves are read
    for name in ("old", "new"):
        assert np.array_equal(read_record(tmp_path / f"{name}.mat", time="run.t", value="run.x").y, np.cos(t))
