"""Doubts about units, times and rates are reported with the option that removes them; correct files give none."""

from pathlib import Path

import numpy as np
import pytest

import bayesdamp
from bayesdamp.config import Recording
from bayesdamp.pipeline.records import read_free_decay
from bayesdamp.records.read import read_record
from bayesdamp.records.record import Kind, findings, unit_or_guess
from bayesdamp.types import InputError
from tests.records.tables import T, Y, write_table

NOISE = 0.01 * np.random.default_rng(1).standard_normal(T.size)
DEG = 57 * Y + 50 * NOISE

CASES = {
    # head, times, values, options of reading, given unit, kinds of doubts, text of the option
    "right": ("t,angle", T, Y, {}, None, [], ""),
    "degrees": ("t,angle", T, 50 * Y, {}, None, [Kind.DEGREES], "--unit rad"),
    "rad is given": ("t,angle", T, 50 * Y, {}, "rad", [], ""),
    "many turns": ("t,angle (rad)", T, 100 * Y, {}, None, [], ""),
    "ms": ("t,angle", 1e3 * T, Y, {}, None, [Kind.TIME_UNIT], "--time-unit ms"),
    "ms in the head": ("t (ms),angle", 1e3 * T, Y, {}, None, [], ""),
    "ms in the head, but s": ("t (ms),angle (deg)", T, 50 * Y, {}, None, [Kind.TIME_UNIT], "--time-unit s, or ms"),
    "us in the head, but ms": ("TimeUS,x (m)", 1e3 * T, Y, {}, None, [Kind.TIME_UNIT], "--time-unit ms, or us"),
    "s, in bursts": ("t (s),angle (deg)", np.floor(3 * T) / 3, 50 * Y, {}, None, [], ""),
    "ms, a small swing": ("t (ms),angle (deg)", T, Y, {}, None, [], ""),
    "ms, an acceleration": ("t (ms),acc (g)", T, 50 * Y, {}, None, [], ""),
    "weeks in the head": ("time (weeks),angle", T, Y, {}, None, [Kind.TIME_UNIT], "--time-unit s if they are"),
    "datenum": ("time,angle", 738000 + T / 86400, Y, {}, None, [Kind.TIME_UNIT], "--time-unit d"),
    "slow, s in the head": ("t (s),angle", 1e3 * T, Y, {}, None, [], ""),
    "sample numbers": ("t,angle", np.arange(600.0), Y, {}, None, [Kind.SAMPLE_NUMBERS], "--rate HZ"),
    "interval as rate": ("x,angle", Y[::-1], Y, {"rate": 0.02, "value": 2}, None, [Kind.PERIOD], "--rate 50"),
    "rate against the file's": (
        "# sample rate: 50 Hz\nx,angle", Y[::-1], Y, {"rate": 500.0, "value": 2}, None, [Kind.RATE], "--rate 50",
    ),
    "rate and sample numbers": ("t,angle", np.arange(600.0), Y, {"rate": 50.0}, None, [], ""),
    "times against the file's rate": ("# fs = 25\nt,angle", T, Y, {}, None, [Kind.RATE], "--rate 25"),
    "an envelope": ("t,angle", T, np.hypot(Y, 0.05 * np.sin(6 * T)), {}, None, [], ""),
    "wrapped, deg in the head": ("t,angle (deg)", T, DEG % 360, {}, None, [], ""),
    "wrapped, no unit": ("t,angle", T, DEG % 360, {}, None, [Kind.DEGREES], ""),
    "a factor in brackets": ("t,angle (deg x1000)", T, Y, {}, None, [Kind.UNIT], "--unit"),
    "a range": ("t,accel (16 g)", T, Y, {}, None, [Kind.UNIT], "--unit counts"),
    "a power of a unit": ("t,acc (m/s^2)", T, Y, {}, None, [], ""),
    "a factor, but the unit is given": ("t,disp (1e-3 m)", T, Y, {}, "mm", [], ""),
    "a factor of times": ("t (1e-3 s),angle", 1e3 * T, Y, {}, None, [Kind.TIME_UNIT], "--time-unit s if they are"),
    "a probe": ("t,Ch1 x10 (V)", T, Y, {}, None, [], ""),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_doubt_is_reported_if_and_only_if_there_is_one(tmp_path: Path, case: str) -> None:
    head, t, y, options, unit, kinds, option = CASES[case]
    raw = read_record(write_table(tmp_path / "a.csv", head, t, y), **options)
    doubts = findings(raw, *unit_or_guess(raw, unit, None), unit is not None)
    assert [doubt.kind for doubt in doubts] == kinds
    assert all(option in doubt.option and len(str(doubt)) < 250 for doubt in doubts)


@pytest.mark.parametrize(
    ("name", "size", "unit"),
    [
        ("angle", 1, "rad"), ("angle", 50, "deg"), ("", 50, "deg"), ("voltage", 50, "counts"),
        ("angle", 5000, "counts"), ("angle (rad)", 50, "rad"),
    ],
)  # fmt: skip
def test_values_too_large_for_rad_are_read_in_deg_or_counts_with_a_warning(
    tmp_path: Path, name, size, unit
) -> None:
    path = write_table(tmp_path / "a.csv", f"t,{name}" if name else "", T, size * Y)
    assert unit_or_guess(read_record(path), None, None) == (unit, "angle")
    record = bayesdamp.read(path)
    assert record.unit == unit
    assert ("no unit given" in str(record.signal().provenance.warnings)) is (unit != "rad")


def test_the_error_of_an_unknown_unit_names_counts(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"or counts for a sensor of unknown scale \(unit=\)"):
        bayesdamp.read(write_table(tmp_path / "a.csv", "t,force (kN)", T, Y))


def test_a_rate_unlike_that_of_the_file_is_a_warning_in_python_and_in_a_study(tmp_path: Path) -> None:
    path = write_table(tmp_path / "a.csv", "# sample rate: 50 Hz\nx,angle", Y[::-1], Y)
    read = [bayesdamp.read(path, value=2, rate=rate).signal() for rate in (50.0, 500.0)]
    read.append(read_free_decay(Recording(file="a.csv", path=path, angle=2, rate=500.0), "a"))
    warned = ["its file states 50 Hz" in str(signal.provenance.warnings) for signal in read]
    assert warned == [False, True, True]
