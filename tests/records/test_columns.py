"""Which columns are read as a record: tables made by hand with one right choice, and tables that must be refused."""

import re
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.read import read_record, read_records
from bayesdamp.types import InputError
from tests.physics.independent import trajectory
from tests.records.tables import T, Y, write_table

V = np.gradient(Y, T)
A = np.gradient(V, T)
OTHER = 0.2 * np.exp(-0.15 * T) * np.cos(5 * T + 1)
NOISE = np.random.default_rng(1).normal(0, 0.1, T.size)
STEADY = 0.3 * np.cos(6 * T)
INDEX = np.arange(T.size)


def write(path: Path, columns: dict[str, np.ndarray], *above: str, named: bool = True) -> Path:
    head = [*above, *([",".join(columns)] if named else [])]
    return write_table(path, "\n".join(head), *columns.values())


CLEAR: dict[str, tuple[dict[str, np.ndarray], str, str]] = {
    "two columns": ({"t": T, "x": Y}, "t", "x"),
    "sample numbers first": ({"sample": INDEX, "time": T, "x": Y}, "time", "x"),
    "times last": ({"phi (deg)": Y, "Elapsed (s)": T}, "Elapsed (s)", "phi (deg)"),
    "a switch and a constant": ({"t": T, "trigger": (T > 3) * 5.0, "volts": 0 * T + 1.5, "x": Y}, "t", "x"),
    "derivatives by name": ({"t": T, "acceleration": A, "velocity": V, "position": Y}, "t", "position"),
    "derivatives by unit": ({"t": T, "a (m/s²)": A, "v (m/s)": V, "s (m)": Y}, "t", "s (m)"),
    "one motion in two units": ({"t": T, "angle (rad)": Y, "arc (mm)": 210 * Y + 3}, "t", "angle (rad)"),
    "a steady drive": ({"t": T, "drive": np.cos(6 * T + 1), "reference": STEADY, "x": Y}, "t", "x"),
    "axes of a phone": ({"t": T, "ax (g)": 0.1 * OTHER, "ay (g)": Y, "absolute (g)": abs(Y)}, "t", "ay (g)"),
    "axes without units": ({"t": T, "z": 0.1 * Y, "y": Y, "x": 0.03 * OTHER}, "t", "y"),
    "a drift": ({"t": T, "x": Y, "y": 3 * np.exp(-0.2 * T) + 0.5 * np.cos(0.8 * T)}, "t", "x"),
    "warm": ({"t": T, "z (m/s2)": Y, "T (C)": np.round(25 - 0.03 * T + 0.01 * NOISE, 2)}, "t", "z (m/s2)"),
    "an energy": ({"t": T, "kinetic energy": V**2, "x": Y}, "t", "x"),
    "residuals of a fit": (
        {"t": T, "x": Y, "r": 0.2 * np.exp(-0.07 * T) * (np.cos(6 * T) - np.cos(6.8 * T))}, "t", "x",
    ),
}  # fmt: skip
ONLY_CHOICE = ("two columns", "sample numbers first", "times last", "a switch and a constant")
"""Tables in which only one column is a motion, so that the choice needs no explanation."""


@pytest.mark.parametrize("case", CLEAR)
def test_a_clear_choice_is_made_and_explained(tmp_path: Path, case: str) -> None:
    columns, time, value = CLEAR[case]
    record = read_record(write(tmp_path / "a.csv", columns))
    assert record.columns == (time, value)
    np.testing.assert_allclose(record.y, columns[value], atol=1e-12)
    np.testing.assert_allclose(record.t, T, atol=1e-12)  # type: ignore[arg-type]
    assert record.choice in " ".join(map(str, record.provenance.notes))
    assert (f"Using column {value!r}" in record.choice) == (case not in ONLY_CHOICE)


UNCLEAR: dict[str, tuple[dict[str, np.ndarray], bool, str]] = {
    "two motions": ({"t": T, "x": Y, "y": OTHER}, True, "'x', 'y' may each be the record; give the name"),
    "channels without a unit": ({"t": T, "ch1": Y, "ch2": OTHER}, True, "or of several channels"),
    "two motions without times": ({"x": Y, "y": OTHER}, True, "may each be the record"),
    "only times": ({"t": T}, True, "its only column contains the times"),
    "no times": ({"x": Y}, True, "export the times too, or give the rate in Hz (--rate)"),
}  # fmt: skip


@pytest.mark.parametrize(("columns", "named", "message"), UNCLEAR.values(), ids=UNCLEAR)
def test_an_unclear_choice_is_refused_in_one_line(tmp_path: Path, columns, named, message) -> None:
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        read_records(write(tmp_path / "a.csv", columns, named=named))
    assert len(str(caught.value)) < 300


def test_sensors_of_one_unit_are_separate_records(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", {"t (ms)": 1000 * T, "left (g)": Y, "right (g)": OTHER})
    records = read_records(path)
    assert [(record.channel, record.run) for record in records] == [("left (g)", ""), ("right (g)", "")]
    assert read_records(path, channels=["right"])[0].y[0] == OTHER[0]
    with pytest.raises(InputError, match="has 2 records; give the run or channel of one: 'left"):
        read_record(path)


RUNS = {
    "number last": ("Time (s) Run #{}", "Angle (deg) Run #{}"),
    "number first": ("Run {}: Time (s)", "Run {}: Angle (deg)"),
    "in brackets": ("t (s) (trial {})", "Angle (deg) (trial {})"),
    "underscores": ("t_run{}", "Angle_deg_run{}"),
    "one column of times": ("Time (s)", "Angle (deg) Run {}"),
}


@pytest.mark.parametrize(("time", "value"), RUNS.values(), ids=RUNS)
def test_numbered_columns_are_runs_of_one_channel(tmp_path: Path, time: str, value: str) -> None:
    columns: dict[str, np.ndarray] = {}
    for i in (1, 2, 3, 4):
        columns |= {time.format(i): T, value.format(i): i * Y}
    path = write(tmp_path / "a.csv", columns)
    records = read_records(path)
    assert [(record.run, record.unit) for record in records] == [(i, "deg") for i in "1234"]
    assert len({record.channel for record in records}) == 1
    for i, record in enumerate(records, start=1):
        np.testing.assert_allclose(record.y, i * Y, atol=1e-12)
    assert [record.run for record in read_records(path, runs=" 4 , 1-2 ")] == ["4", "1", "2"]
    assert read_record(path, run=3, channel=records[0].channel).columns == records[2].columns
    for wrong in ("7", "3-1", "", "a"):
        with pytest.raises(InputError, match=f"no runs '{wrong}'; give numbers .*there are runs 1, 2, 3, 4"):
            read_records(path, runs=wrong)


def test_all_runs_use_the_same_column(tmp_path: Path) -> None:
    """Run 2 contains only noise; alone it would give another column or none."""
    columns = {"t": T}
    for i, y in ((1, Y), (2, 1e-3 * NOISE), (3, Y)):
        columns |= {f"roll (deg) Run {i}": y, f"temperature Run {i}": NOISE + i}
    records = read_records(write(tmp_path / "a.csv", columns))
    assert [record.channel for record in records] == ["roll (deg)"] * 3


PHONE = ((0.15, "acceleration {} (m/s²)", 1.0), (0.6, "{} (g)", 1 / 9.81), (1.2, "acc {}", 1.0))


@pytest.mark.parametrize(("angle_0", "name", "scale"), PHONE)
def test_a_phone_on_a_pendulum_is_read_along_its_path(tmp_path: Path, angle_0, name, scale) -> None:
    """The acceleration at 0.8 of a pendulum's effective length, computed from SciPy's solution.

    The axis that points to the pivot oscillates at twice the frequency and must be refused, also if it is the only one.
    """
    g, length, t = 9.81, 0.85, np.arange(3000) / 100
    p = {"stiffness": g / length, "zeta": 0.015, "rest_angle": 0.0, "theta0": angle_0, "omega0": 0.0}
    angle, speed, acceleration = trajectory("pendulum", p, t).T
    across = 0.8 * length * acceleration + g * np.sin(angle)
    along = -(g * np.cos(angle) + 0.8 * length * speed**2)
    noise = 0.02 * np.random.default_rng(2).standard_normal((3, t.size))
    x, y, z = map(name.format, "xyz")
    columns = dict(zip((x, y, z), scale * (noise + np.array([across, along, 0 * t + 0.05])), strict=True))
    assert read_record(write(tmp_path / "a.csv", {"t (s)": t, **columns})).channel == x
    for names in ((y,), (y, z)):
        path = write(tmp_path / "b.csv", {"t (s)": t, **{name: columns[name] for name in names}})
        with pytest.raises(InputError, match=r"contains gravity .* at twice the freq.* \(--angle\)"):
            read_record(path)
    assert read_record(path, value=y).channel == y


def test_a_vertical_acceleration_with_gravity_must_be_named(tmp_path: Path) -> None:
    """The mean may also be gravity on a mass that moves up and down: only the user knows."""
    name = "acceleration (m/s²)"
    path = write(tmp_path / "a.csv", {"t (s)": T, name: 9.81 + 10 * Y})
    with pytest.raises(InputError, match="or this one if the body moves up and down"):
        read_record(path)
    assert read_record(path, value=name).channel == name
    # Negative control: not gravity, or faster than any pendulum.
    for other, mean, t in ((name, 5.0, T), ("angle", 9.81, T), (name, 9.81, T / 100)):
        assert read_record(write(tmp_path / "b.csv", {"t (s)": t, other: mean + 10 * Y})).channel == other


def test_parts_of_a_lock_in_amplifier_are_not_a_motion(tmp_path: Path) -> None:
    """Control: a body on a string, whose distance from the origin does not fall."""
    for size in (np.exp(-0.1 * T), np.ones_like(T)):
        x, y = size * np.cos(5 * T), size * np.sin(5 * T)
        path = write(tmp_path / "a.csv", {"t (s)": T, "x (V)": x, "y (V)": y, "r (V)": np.hypot(x, y)})
        wrong = pytest.raises(InputError, match=r"'r \(V\)' is √.* and falls, .* \(--angle, --quantity\)")
        with wrong if size[-1] < 1 else nullcontext():
            read_records(path)


def test_crosstalk_of_an_acceleration_with_gravity_is_not_the_record(tmp_path: Path) -> None:
    """Control: without gravity, the large axis is the record."""
    for share, mean in ((0.02, 9.81), (0.5, 9.81), (0.02, 0.0)):
        x, z = 10 * share * Y + 0.1 * NOISE, 10 * Y + mean
        columns = {"t (s)": T, "x (m/s²)": x, "z (m/s²)": z, "total (m/s²)": np.hypot(x, z)}
        path = write(tmp_path / "a.csv", columns)
        with pytest.raises(InputError, match=r"'z .*' contains gravity") if mean else nullcontext():
            assert read_record(path).channel == "z (m/s²)"


def test_a_channel_with_one_spike_is_not_preferred(tmp_path: Path) -> None:
    for width, first in ((1, 300), (30, 580)):
        spike = 0.01 * NOISE
        pulse = 20 * np.sin(np.pi * (np.arange(width) + 0.5) / width)
        spike[first : first + width] += pulse[: T.size - first]
        columns = {"t (s)": T, "first (m)": Y, "second (m)": spike}
        assert read_record(write(tmp_path / "a.csv", columns)).channel == "first (m)"


SLOW = np.arange(500) * 0.0263
LATER = 0.2 * np.exp(-0.15 * SLOW) * np.cos(5 * SLOW)
PAIRS = [
    ["Time A (s)", "A (mm)", "Time B (s)", "B (mm)"],
    ["Time A", "A", "Time B", "B"],
    ["t1", "x1", "t2", "x2"],
    ["", "", "", ""],
]


def side_by_side(path: Path, names: list[str], columns: list[np.ndarray]) -> Path:
    """Write columns of different lengths; the shorter ones end with empty cells."""
    rows = [",".join(repr(float(c[i])) if i < c.size else "" for c in columns) for i in range(T.size)]
    path.write_text("\n".join([*([",".join(names)] if any(names) else []), *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize("names", [*PAIRS, ["A (mm)", "t_A (s)", "B (mm)", "t_B (s)"]], ids=str)
def test_each_value_column_uses_the_times_next_to_it(tmp_path: Path, names: list[str]) -> None:
    columns = [T, Y, SLOW, LATER] if names in PAIRS else [Y, T, LATER, SLOW]
    path = side_by_side(tmp_path / "a.csv", names, columns)
    for record, t, y in zip(read_records(path), (T, SLOW), (Y, LATER), strict=True):
        time, value = record.columns
        for same in (record, read_record(path, time=time, value=value)):
            np.testing.assert_allclose(same.t, t, atol=1e-12)  # type: ignore[arg-type]
            np.testing.assert_allclose(same.y, y, atol=1e-12)


def test_columns_of_one_clock_are_not_pairs(tmp_path: Path) -> None:
    """Negative control: the same times twice, times on both sides, and a value that only grows."""
    for names, columns, chosen in (
        (["t", "x (m)", "t", "v (m/s)"], [T, Y, T, V], (1, "x (m)")),
        (["time (s)", "x (mm)", "stamp (ms)"], [T, Y, 1e3 * T], ("time (s)", "x (mm)")),
        (["t (s)", "x (mm)", "way (m)", "y (mm)"], [T, Y, np.cumsum(abs(Y)), STEADY], ("t (s)", "x (mm)")),
    ):
        assert read_record(side_by_side(tmp_path / "a.csv", names, columns)).columns == chosen


def test_a_rate_in_the_head_replaces_sample_numbers(tmp_path: Path) -> None:
    record = read_record(write(tmp_path / "a.csv", {"x": INDEX, "y": Y}, "# delta t (s): 0.02"))
    assert (record.t, record.rate, record.columns) == (None, 50.0, (None, "y"))
    assert read_record(write(tmp_path / "b.csv", {"x": INDEX, "y": Y})).columns == ("x", "y")


def test_missing_frames_are_gaps_in_the_times(tmp_path: Path) -> None:
    """Control: numbers of which none is missing."""
    kept = np.delete(INDEX, np.r_[50:60, 200])
    tables = ({"frame": rows, "x_px": Y[kept]} for rows in (kept, INDEX[: kept.size]))
    raw, plain = (read_record(write(tmp_path / "video.csv", table), rate=50.0) for table in tables)
    assert raw.t == pytest.approx(kept / 50.0)
    assert (plain.t, plain.rate) == (None, 50.0)
