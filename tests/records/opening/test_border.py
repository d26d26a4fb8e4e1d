"""The border to files: whatever a reader raises is one line, with its cause."""

from __future__ import annotations

import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.files.contents import Contents
from bayesdamp.records.opening import contents
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
