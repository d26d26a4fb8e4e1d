"""Times that a file says to be in another unit than s, in every way that a format has of saying it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from bayesdamp.records.findings import Kind, findings
from bayesdamp.records.read import read_record
from tests.records.tables import write_table

T = np.arange(400) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)


def hdf(path: Path, t: np.ndarray, unit: str) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["time"], file["angle"] = t, Y
        file["time"].attrs["units"] = unit


def xlsx(path: Path, t: np.ndarray, unit: str) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    for row in [(f"time ({unit})", "angle"), *zip(t.tolist(), Y.tolist(), strict=True)]:
        book.active.append(row)
    book.save(path)


def csv(path: Path, t: np.ndarray, unit: str) -> None:
    write_table(path, f"time ({unit}),angle", t, Y)


WRITERS: dict[str, Callable[[Path, np.ndarray, str], None]] = {"h5": hdf, "xlsx": xlsx, "csv": csv}


def test_a_unit_of_times_is_taken(tmp_path: Path) -> None:
    for form, write in WRITERS.items():
        for unit, seconds in (("h", 3600.0), ("ps", 1e-12)):
            t = T if seconds >= 1 else T * 1e-6
            write(tmp_path / f"a.{form}", t / seconds, unit)
            raw = read_record(tmp_path / f"a.{form}")
            np.testing.assert_allclose(raw.t, t, rtol=1e-9, atol=1e-9 * t[1])  # type: ignore[arg-type]
            assert findings(raw, "rad", "angle") == ()
        write(tmp_path / f"a.{form}", T, "fortnights")  # the control: one that is not known is doubted
        (found,) = findings(read_record(tmp_path / f"a.{form}"), "rad", "angle")
        assert found.kind is Kind.TIME_UNIT
        assert "'fortnights'" in found.sentence
        assert "--time-unit" in found.option


def test_times_since_a_date(tmp_path: Path) -> None:
    """As netCDF has them."""
    for unit, scale in (
        ("milliseconds since 2024-01-01", 1e3),
        ("days since 1970-01-01 00:00", 1 / 86400),
    ):
        hdf(tmp_path / "a.h5", T * scale, unit)
        np.testing.assert_allclose(read_record(tmp_path / "a.h5").t, T, atol=1e-9)  # type: ignore[arg-type]


def test_numbers_of_days(tmp_path: Path) -> None:
    for name, begin in (("time (d)", 738000.25), ("Excel time (days)", 45000.5)):
        raw = read_record(write_table(tmp_path / "a.csv", f"{name},angle", begin + T / 86400, Y))
        np.testing.assert_allclose(raw.t, 86400 * (begin % 1) + T, atol=2e-5)  # type: ignore[arg-type]
        assert any(f"from day {begin // 1:.0f} on" in note and name in note for note in raw.provenance.notes)
        assert findings(raw, "rad", "angle") == ()
