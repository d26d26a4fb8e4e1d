"""Times that a file says to be in another unit than s, in every way that a format has of saying it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.findings import Kind, findings
from bayesdamp.records.read import read_record

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
    assert book.active is not None
    for row in [(f"time ({unit})", "angle"), *zip(t.tolist(), Y.tolist(), strict=True)]:
        book.active.append(row)
    book.save(path)


def csv(path: Path, t: np.ndarray, unit: str) -> None:
    rows = [f"{a!r},{b!r}" for a, b in zip(t.tolist(), Y.tolist(), strict=True)]
    path.write_text("\n".join([f"time ({unit}),angle", *rows]), encoding="utf-8")


WRITERS: dict[str, Callable[[Path, np.ndarray, str], None]] = {"h5": hdf, "xlsx": xlsx, "csv": csv}


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize(("unit", "seconds"), [("h", 3600.0), ("days", 86400.0), ("ps", 1e-12), ("s", 1.0)])
def test_a_unit_of_times_is_taken(tmp_path: Path, form: str, unit: str, seconds: float) -> None:
    t = T if seconds >= 1 else T * 1e-6
    WRITERS[form](tmp_path / f"a.{form}", t / seconds, unit)
    raw = read_record(tmp_path / f"a.{form}")
    assert raw.t is not None
    np.testing.assert_allclose(raw.t, t, rtol=1e-9, atol=1e-9 * t[1])
    assert findings(raw, "rad", "angle") == ()


@pytest.mark.parametrize("form", WRITERS)
def test_one_that_is_not_known_is_doubted(tmp_path: Path, form: str) -> None:
    WRITERS[form](tmp_path / f"a.{form}", T, "fortnights")
    (found,) = findings(read_record(tmp_path / f"a.{form}"), "rad", "angle")
    assert found.kind is Kind.TIME_UNIT
    assert "'fortnights'" in found.sentence
    assert "--time-unit" in found.option


@pytest.mark.parametrize(
    ("unit", "scale"), [("milliseconds since 2024-01-01", 1e3), ("days since 1970-01-01 00:00", 1 / 86400)]
)
def test_times_since_a_date(tmp_path: Path, unit: str, scale: float) -> None:
    """As netCDF has them."""
    hdf(tmp_path / "a.h5", T * scale, unit)
    raw = read_record(tmp_path / "a.h5")
    assert raw.t is not None
    np.testing.assert_allclose(raw.t, T, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "begin"),
    [("time (d)", 738000.25), ("Excel time (days)", 45000.5), ("time (d)", 60000.0)],
)
def test_numbers_of_days(tmp_path: Path, name: str, begin: float) -> None:
    rows = [f"{a!r},{b!r}" for a, b in zip((begin + T / 86400).tolist(), Y.tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join([f"{name},angle", *rows]), encoding="utf-8")
    raw = read_record(tmp_path / "a.csv")
    assert raw.t is not None
    np.testing.assert_allclose(raw.t, 86400 * (begin % 1) + T, atol=2e-5)
    assert any(f"from day {begin // 1:.0f} on" in note and name in note for note in raw.provenance.notes)
    assert findings(raw, "rad", "angle") == ()


@pytest.mark.parametrize("name", ["datenum", "t"])
def test_matlabs_days_are_asked_about(tmp_path: Path, name: str) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {name: 738000 + T / 86400, "y": Y})
    (found,) = findings(read_record(tmp_path / "a.mat", time=name, value="y"), "rad", "angle")
    assert (found.kind, "--time-unit d" in found.option) == (Kind.TIME_UNIT, True)
    raw = read_record(tmp_path / "a.mat", time=name, value="y", time_unit="d")
    assert raw.t is not None
    np.testing.assert_allclose(raw.t, T, atol=2e-5)
