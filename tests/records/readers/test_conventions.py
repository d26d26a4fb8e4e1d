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


def test_scale_and_offset_are_applied_and_noted(tmp_path: Path) -> None:
    stored = np.round((Y - 0.5) / 1e-4).astype("i2")
    raw = written(tmp_path / "a.h5", stored, scale_factor=1e-4, add_offset=0.5)
    np.testing.assert_allclose(raw.y, Y, atol=1e-4)
    assert any("scale_factor" in note and "add_offset" in note for note in raw.provenance.notes)
    raw = written(tmp_path / "b.h5", stored)
    np.testing.assert_array_equal(raw.y, stored)
    assert raw.provenance.notes == ()


@pytest.mark.parametrize("name", ["_FillValue", "missing_value"])
def test_missing_samples_are_left_out_and_noted(tmp_path: Path, name: str) -> None:
    stored = np.round(Y / 1e-4).astype("i2")
    stored[HOLES] = -9999
    raw = written(tmp_path / "a.h5", stored, scale_factor=1e-4, **{name: np.int16(-9999)})
    np.testing.assert_allclose(raw.y, np.delete(Y, HOLES), atol=1e-4)
    np.testing.assert_array_equal(raw.t, np.delete(T, HOLES))
    assert any(f"{HOLES.size} missing" in note for note in raw.provenance.notes)
    assert raw.provenance.more["incomplete_rows"] == HOLES.size
    raw = written(tmp_path / "b.h5", stored, scale_factor=1e-4)
    assert raw.y.min() == pytest.approx(-0.9999)


def test_a_nan_that_no_attribute_announces_is_refused_as_ever(tmp_path: Path) -> None:
    y = Y.copy()
    y[HOLES] = np.nan
    raw = written(tmp_path / "a.h5", y, _FillValue=np.nan)
    np.testing.assert_array_equal(raw.y, np.delete(Y, HOLES))
    with pytest.raises(InputError, match="not a finite number"):
        written(tmp_path / "b.h5", y)


@pytest.mark.parametrize("value", ["a word", [1.0, 2.0], np.nan])
def test_attributes_that_are_no_scale(tmp_path: Path, value: Any) -> None:
    if value is np.nan:
        with pytest.raises(InputError):
            written(tmp_path / "a.h5", Y, scale_factor=value)
        return
    np.testing.assert_array_equal(written(tmp_path / "a.h5", Y, scale_factor=value).y, Y)


def test_what_xarray_packs(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    dask = pytest.importorskip("dask")
    y = Y.copy()
    y[HOLES] = np.nan
    times = np.datetime64("2024-01-01T00:00:00") + (T * 1e6).round().astype("timedelta64[us]")
    data = xarray.Dataset({"angle": ("time", y, {"units": "rad"})}, {"time": times})
    packing = {"dtype": "i2", "scale_factor": 1e-4, "add_offset": 0.1, "_FillValue": -9999}
    with dask.config.set(
        scheduler="synchronous"
    ):  # a client that another test closed may be the default still
        data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf", encoding={"angle": packing})
    raw = read_record(tmp_path / "a.nc")
    np.testing.assert_allclose(raw.y, np.delete(Y, HOLES), atol=1e-4)
    assert raw.t is not None
    np.testing.assert_allclose(raw.t, np.delete(T, HOLES), atol=1e-9)
    assert raw.unit == "rad"
