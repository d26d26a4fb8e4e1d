"""Units of times, packed numbers and missing samples, as a file declares them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from bayesdamp.records.read import read_record
from bayesdamp.records.record import Kind, findings
from bayesdamp.types import InputError
from tests.records.tables import T, Y, write_table


def hdf(path: Path, t: np.ndarray, unit: str, stored: np.ndarray = Y, **attributes: Any) -> None:
    """Write a file with attributes as in netCDF."""
    with h5py.File(path, "w") as file:
        file["time"], file["angle"] = t, stored
        file["time"].attrs["units"] = unit
        file["angle"].attrs.update(attributes)


def csv(path: Path, t: np.ndarray, unit: str) -> None:
    write_table(path, f"time ({unit}),angle", t, Y)


@pytest.mark.parametrize(("form", "write"), [("h5", hdf), ("csv", csv)])
def test_the_unit_of_times_is_read(tmp_path: Path, form: str, write: Callable[..., None]) -> None:
    """Control: an unknown unit gives a doubt with an option."""
    path = tmp_path / f"a.{form}"
    for unit, seconds in (("h", 3600.0), ("ps", 1e-12)):
        t = T if seconds >= 1 else T * 1e-6
        write(path, t / seconds, unit)
        raw = read_record(path)
        np.testing.assert_allclose(raw.t, t, rtol=1e-9, atol=1e-9 * t[1])  # type: ignore[arg-type]
        assert findings(raw, "rad", "angle") == ()
    write(path, T, "fortnights")
    (doubt,) = findings(read_record(path), "rad", "angle")
    assert doubt.kind is Kind.TIME_UNIT
    assert "'fortnights'" in doubt.sentence
    assert "--time-unit" in doubt.option


def test_times_since_a_date_are_read(tmp_path: Path) -> None:
    for unit, scale in (("milliseconds since 2024-01-01", 1e3), ("days since 1970-01-01 00:00", 1 / 86400)):
        hdf(tmp_path / "a.h5", T * scale, unit)
        np.testing.assert_allclose(read_record(tmp_path / "a.h5").t, T, atol=1e-9)  # type: ignore[arg-type]


def test_packed_numbers_and_missing_samples_are_refused(tmp_path: Path) -> None:
    """With the attributes of the Climate and Forecast conventions. Control: values that do not occur in the record."""
    path, stored = tmp_path / "a.h5", np.round(Y / 1e-4).astype("i2")
    stored[5::37] = -9999
    for name, value, message in (
        ("scale_factor", 0.5, "the numbers of 'angle' are packed"),
        ("add_offset", 0.5, "the numbers of 'angle' are packed"),
        ("_FillValue", np.int16(-9999), r"sample 5 .*not a finite number"),
        ("missing_value", np.int16(-9999), r"sample 5 .*not a finite number"),
    ):
        hdf(path, T, "s", stored, **{name: value})
        with pytest.raises(InputError, match=message):
            read_record(path)
    for control in ({}, {"_FillValue": np.int16(-9998)}, {"missing_value": np.int16(-9998)}):
        hdf(path, T, "s", stored, **control)
        np.testing.assert_array_equal(read_record(path).y, stored)


def test_times_in_days_since_an_epoch_are_read(tmp_path: Path) -> None:
    for name, begin in (("time (d)", 738000.25), ("Excel time (days)", 45000.5)):
        raw = read_record(write_table(tmp_path / "a.csv", f"{name},angle", begin + T / 86400, Y))
        np.testing.assert_allclose(raw.t, 86400 * (begin % 1) + T, atol=2e-5)  # type: ignore[arg-type]
        assert any(f"from day {begin // 1:.0f} on" in note and name in note for note in raw.provenance.notes)
        assert findings(raw, "rad", "angle") == ()
