"""Opening files: whatever a reader raises is one line, with its cause; one that crashes or hangs costs one line."""

from __future__ import annotations

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
from bayesdamp.records.opening import load_isolated, read_contents
from bayesdamp.records.readers.numpy_arrays import NumpyReader
from bayesdamp.types import InputError


@pytest.mark.parametrize(
    ("method", "said"), [("claims", "is damaged or not what its name says"), ("read", "damaged or cut off")]
)
@pytest.mark.parametrize(
    "error", [NotImplementedError("no 25.5"), RuntimeError(), RecursionError("deep")], ids=repr
)
def test_a_reader_that_fails(tmp_path, monkeypatch, method: str, said: str, error: BaseException) -> None:
    """Negative control: who interrupts is no damaged file."""
    path = tmp_path / "a.npy"
    np.save(path, np.eye(40))
    assert read_contents(path).columns
    monkeypatch.setattr(NumpyReader, method, Mock(side_effect=error))
    with pytest.raises(InputError, match=said) as caught:
        read_contents(path)
    assert (caught.value.where, caught.value.__cause__) == ("a.npy", error)
    assert len(str(caught.value)) < 300
    monkeypatch.setattr(NumpyReader, method, Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        read_contents(path)


def test_threads_that_read_leave_output_and_warnings_of_the_program_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reads that overlap end in another order than they began in."""
    before, read = (sys.stdout, list(warnings.filters)), NumpyReader.read

    def slow(self: NumpyReader, path: Path) -> Contents:
        # an error in tests, where the reader's filter is not in force
        warnings.warn("of no interest", stacklevel=1)
        time.sleep(0.01 if path.stem == "0" else 0.002)
        return read(self, path)

    monkeypatch.setattr(NumpyReader, "read", slow)
    paths = [tmp_path / f"{i}.npy" for i in range(4)]
    for path in paths:
        np.save(path, np.eye(40))
    with ThreadPoolExecutor(4) as pool:
        assert all(found.columns for found in pool.map(read_contents, 3 * paths))
    assert (sys.stdout, warnings.filters) == before


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


def test_what_goes_wrong_is_one_line(tmp_path):
    for load, said in (
        (crashing, r"x\.bin: its reader crashed \(SIGSEGV\); the file is damaged"),
        (failing, r"x\.bin: cannot be read \(KeyError: 'no such\\nthing'\); the file is damaged"),
        (refusing, r"^x\.bin: holds no record; give another$"),
        (hanging, r"x\.bin: its reader did not end within 1 s; the file is damaged"),
    ):
        with pytest.raises(InputError, match=said) as caught:
            load_isolated(load, tmp_path / "x.bin", 1.0 if load is hanging else 60.0)
        assert "\n" not in str(caught.value)
