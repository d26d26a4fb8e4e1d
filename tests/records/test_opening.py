"""Errors of readers, also crashes and readers that do not end, are reported in one line."""

import os
import signal
import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from bayesdamp.records.files.contents import Contents
from bayesdamp.records.read import load_isolated, read_contents
from bayesdamp.records.readers.numpy_arrays import NumpyReader
from bayesdamp.types import InputError


@pytest.mark.parametrize(
    ("method", "message"),
    [("claims", "is damaged or not what its name says"), ("read", "damaged or cut off")],
)
@pytest.mark.parametrize(
    "error", [NotImplementedError("no 25.5"), RuntimeError(), RecursionError("deep")], ids=repr
)
def test_an_error_of_a_reader_is_one_line(tmp_path, monkeypatch, method, message, error) -> None:
    """Negative control: an interrupt by the user is not reported as a damaged file."""
    path = tmp_path / "a.npy"
    np.save(path, np.eye(40))
    assert read_contents(path).columns
    monkeypatch.setattr(NumpyReader, method, Mock(side_effect=error))
    with pytest.raises(InputError, match=message) as caught:
        read_contents(path)
    assert (caught.value.where, caught.value.__cause__) == ("a.npy", error)
    assert len(str(caught.value)) < 300
    monkeypatch.setattr(NumpyReader, method, Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        read_contents(path)


def test_reading_in_threads_does_not_change_output_and_warnings_of_the_program(tmp_path, monkeypatch) -> None:
    """The reads overlap, and end in another order than they began."""
    before, read = (sys.stdout, list(warnings.filters)), NumpyReader.read

    def slow(self: NumpyReader, path: Path) -> Contents:
        warnings.warn("of no interest", stacklevel=1)  # an error in tests, unless the reader's filter applies
        time.sleep(0.01 if path.stem == "0" else 0.002)
        return read(self, path)

    monkeypatch.setattr(NumpyReader, "read", slow)
    paths = [tmp_path / f"{i}.npy" for i in range(4)]
    for path in paths:
        np.save(path, np.eye(40))
    with ThreadPoolExecutor(4) as pool:
        assert all(contents.columns for contents in pool.map(read_contents, 3 * paths))
    assert (sys.stdout, warnings.filters) == before


def crashing(path: Path) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def failing(path: Path) -> dict[str, np.ndarray]:
    raise KeyError("no such\nthing")


def refusing(path: Path) -> dict[str, np.ndarray]:
    raise InputError(f"{path.name}: holds no record; give another")


def hanging(path: Path) -> None:
    time.sleep(60)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (crashing, r"x\.bin: its reader crashed \(SIGSEGV\); the file may be damaged"),
        (failing, r"x\.bin: cannot be read \(KeyError: 'no such\\nthing'\); the file may be damaged"),
        (refusing, r"^x\.bin: holds no record; give another$"),
        (hanging, r"x\.bin: its reader did not end within 1 s; the file may be damaged"),
    ],
)
def test_a_reader_that_crashes_or_hangs_is_reported_in_one_line(tmp_path, load, message):
    with pytest.raises(InputError, match=message) as caught:
        load_isolated(load, tmp_path / "x.bin", 1.0 if load is hanging else 60.0)
    assert "\n" not in str(caught.value)
