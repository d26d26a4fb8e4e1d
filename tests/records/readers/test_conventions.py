"""Packed numbers and missing samples of netCDF and HDF5, by the Climate and Forecast conventions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bayesdamp.records.read import read_record
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError

T = np.arange(400) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)
HOLES = np.arange(5, 400, 37)


def written(path: Path, stored: np.ndarray, **attributes: Any) -> RawRecord:
    import h5py

    with h5py.File(path, "w") as file:
        file["time"], file["angle"] = T, stored
        file["angle"].attrs.update(attributes)
    return read_record(path)


def test_packed_numbers_are_refused(tmp_path: Path) -> None:
    stored = np.round(Y / 1e-4).astype("i2")
    for attribute in ("scale_factor", "add_offset"):
        with pytest.raises(InputError, match="the numbers of 'angle' are packed"):
            written(tmp_path / "a.h5", stored, **{attribute: 0.5})
    np.testing.assert_array_equal(written(tmp_path / "b.h5", stored).y, stored)


def test_missing_samples_are_no_values(tmp_path: Path) -> None:
    stored = np.round(Y / 1e-4).astype("i2")
    stored[HOLES] = -9999
    for name in ("_FillValue", "missing_value"):
        with pytest.raises(InputError, match=r"sample 5 .*not a finite number"):
            written(tmp_path / "a.h5", stored, **{name: np.int16(-9999)})
        assert written(tmp_path / "b.h5", stored, **{name: np.int16(-9998)}).y.min() == -9999
