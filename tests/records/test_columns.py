"""Which columns are taken for a record, by hand-made tables of which the right answer is plain, and some of which none
is."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.records.read import read_record, read_records
from bayesdamp.types import InputError
from tests.records.tables import write_table

T = np.arange(600) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)
V = np.gradient(Y, T)
A = np.gradient(V, T)
OTHER = 0.2 * np.exp(-0.15 * T) * np.cos(5 * T + 1)
NOISE = np.random.default_rng(1).normal(0, 0.1, T.size)
BEATING = 0.2 * np.exp(-0.07 * T) * (np.cos(6 * T) - np.cos(6.8 * T))
STEADY = 0.3 * np.cos(6 * T)
INDEX = np.arange(T.size)
FLAT = np.full(T.size, 1.5)


def write(path: Path, columns: dict[str, np.ndarray], *above: str, named: bool = True) -> Path:
    head = [*above, *([",".join(columns)] if named else [])]
    return write_table(path, "\n".join(head), *columns.values())


PLAIN: dict[str, tuple[dict[str, np.ndarray], str | None, str]] = {
    "two columns": ({"t": T, "x": Y}, "t", "x"),
    "an index before": ({"sample": INDEX, "time": T, "x": Y}, "time", "x"),
    "times last": ({"phi (deg)": Y, "Elapsed (s)": T}, "Elapsed (s)", "phi (deg)"),
    "a switch beside": ({"t": T, "trigger": (T > 3) * 5.0, "voltage": FLAT, "x": Y}, "t", "x"),
    "derivatives named": ({"t": T, "acceleration": A, "velocity": V, "position": Y}, "t", "position"),
    "derivatives by unit": ({"t": T, "a (m/s²)": A, "v (m/s)": V, "s (m)": Y}, "t", "s (m)"),
    "the same in two units": ({"t": T, "angle (rad)": Y, "arc (mm)": 210 * Y + 3}, "t", "angle (rad)"),
    "what does not die down": ({"t": T, "drive": np.cos(6 * T + 1), "reference": STEADY, "x": Y}, "t", "x"),
    "axes of a phone": ({"t": T, "ax (g)": 0.1 * OTHER, "ay (g)": Y, "absolute (g)": abs(Y)}, "t", "ay (g)"),
    "axes alike, without units": ({"t": T, "z": 0.1 * Y, "y": Y, "x": 0.03 * OTHER}, "t", "y"),
    "a drift beside": ({"t": T, "x": Y, "y": 3 * np.exp(-0.2 * T) + 0.5 * np.cos(0.8 * T)}, "t", "x"),
    "an energy beside": ({"t": T, "kinetic energy": V**2, "x": Y}, "t", "x"),
    "residuals of a fit": ({"t": T, "x": Y, "r": BEATING}, "t", "x"),
    "two times": ({"Time (s)": T, "Time (ms)": 1000 * T, "x": Y}, "Time (s)", "x"),
}


ALONE = ("two columns", "an index before", "times last", "a switch beside", "two times")
"""Of the tables above, those in which one column changes."""


@pytest.mark.parametrize("what", PLAIN)
def test_a_plain_choice_is_made_and_said(tmp_path: Path, what: str) -> None:
    columns, time, value = PLAIN[what]
    record = read_record(write(tmp_path / "a.csv", columns))
    assert record.columns == (time, value)
    np.testing.assert_allclose(record.y, columns[value], atol=1e-12)
    np.testing.assert_allclose(record.t, T, atol=1e-12)  # type: ignore[arg-type]
    assert record.choice in " ".join(map(str, record.provenance.notes))
    assert (f"Using column {value!r}" in record.choice) == (what not in ALONE)


OPEN: dict[str, tuple[dict[str, np.ndarray], bool, str]] = {
    "two that swing": ({"t": T, "x": Y, "y": OTHER}, True, "'x', 'y' may each be the record; give the name"),
    "without names": ({"t": T, "x": Y, "y": OTHER}, False, "2, 3 may each be the record"),
    "channels without a unit": ({"t": T, "ch1": Y, "ch2": OTHER}, True, "or of several channels"),
    "no time": ({"x": Y, "y": OTHER}, True, "may each be the record"),
    "times alone": ({"t": T}, True, "has only one column, and it contains the times"),
    "one without time": ({"x": Y}, True, "export the times too, or give the rate in Hz (--rate)"),
}  # fmt: skip


@pytest.mark.parametrize(("columns", "named", "said"), OPEN.values(), ids=OPEN)
def test_where_no_choice_is_plain_one_line_lists_what_there_is(tmp_path: Path, columns, named, said) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        read_records(write(tmp_path / "a.csv", columns, named=named))
    assert len(str(caught.value)) < 300


def test_sensors_of_one_unit_are_a_record_each(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", {"t (ms)": 1000 * T, "left (g)": Y, "right (g)": OTHER})
    found = read_records(path)
    assert [record.channel for record in found] == ["left (g)", "right (g)"]
    assert not any(record.run for record in found)
    assert read_records(path, channels=["right"])[0].y[0] == OTHER[0]
    with pytest.raises(InputError, match="contains 2 records; give the run or channel of one: 'left"):
        read_record(path)


RUNS = {
    "behind": ("Time (s) Run #{}", "Angle (deg) Run #{}"),
    "before": ("Run {}: Time (s)", "Run {}: Angle (deg)"),
    "in brackets": ("t (s) (trial {})", "Angle (deg) (trial {})"),
    "underscores": ("t_run{}", "Angle_deg_run{}"),
    "one column of times": ("Time (s)", "Angle (deg) Run {}"),
}


@pytest.mark.parametrize(("time", "value"), RUNS.values(), ids=RUNS)
def test_runs_of_a_file_are_repeats(tmp_path: Path, time: str, value: str) -> None:
    columns: dict[str, np.ndarray] = {}
    for i in (1, 2, 3, 4):
        columns |= {time.format(i): T, value.format(i): i * Y}
    path = write(tmp_path / "a.csv", columns)
    found = read_records(path)
    assert [record.run for record in found] == ["1", "2", "3", "4"]
    assert all(record.unit == "deg" for record in found)
    assert len({record.channel for record in found}) == 1
    for i, record in enumerate(found, start=1):
        np.testing.assert_allclose(record.y, i * Y, atol=1e-12)
    assert [r.run for r in read_records(path, runs="1,3-4")] == ["1", "3", "4"]
    assert [r.run for r in read_records(path, runs=" 4 , 2 ")] == ["4", "2"]
    assert read_record(path, run=3, channel=found[0].channel).columns == found[2].columns
    for wrong in ("7", "3-1", "", "a"):
        with pytest.raises(InputError, match=f"no runs '{wrong}'; give numbers .*there are runs 1, 2, 3, 4"):
            read_records(path, runs=wrong)


def test_one_column_is_chosen_for_all_runs(tmp_path: Path) -> None:
    """Run 2 was not let go, so by itself it would give another column or none."""
    columns = {"t": T}
    for i, y in ((1, Y), (2, 1e-3 * NOISE), (3, Y)):
        columns |= {f"roll (deg) Run {i}": y, f"temperature Run {i}": NOISE + i}
    found = read_records(write(tmp_path / "a.csv", columns))
    assert [record.channel for record in found] == ["roll (deg)"] * 3


PHONE = ((0.15, "acceleration {} (m/s²)", 1.0), (0.6, "{} (g)", 1 / 9.81), (1.2, "acc {}", 1.0))


@pytest.mark.parametrize(("size", "head", "scale"), PHONE)
def test_of_a_phone_on_a_pendulum_the_axis_across_gravity_is_taken(tmp_path: Path, size, head, scale) -> None:
    """It measures m/s² at 0.8 of a pendulum's effective length, with a little drag: motion by SciPy."""
    g, length, t = 9.81, 0.85, np.arange(3000) / 100

    def swing(_: float, u: np.ndarray) -> list[float]:
        return [u[1], -g / length * np.sin(u[0]) - 0.03 * u[1]]

    angle, speed = u = solve_ivp(swing, (0, t[-1]), [size, 0.0], t_eval=t, rtol=1e-8, atol=1e-10).y
    turning = np.array([swing(0.0, state)[1] for state in u.T])
    across = 0.8 * length * turning + g * np.sin(angle)
    along = -(g * np.cos(angle) + 0.8 * length * speed**2)
    noise = 0.02 * np.random.default_rng(2).standard_normal((3, t.size))
    x, y, z = map(head.format, "xyz")
    columns = dict(zip((x, y, z), scale * (noise + np.array([across, along, 0 * t + 0.05])), strict=True))
    assert read_record(write(tmp_path / "a.csv", {"t (s)": t, **columns})).channel == x
    # what points to the pivot is not answered for being the only one that swings
    for path in (
        write(tmp_path / "alone.csv", {"t (s)": t, y: columns[y]}),
        write(tmp_path / "b.csv", {"t (s)": t, y: columns[y], z: columns[z]}),
    ):
        with pytest.raises(InputError, match=r"contains gravity .* at twice the freq.* \(--angle\)"):
            read_record(path)
    assert read_record(path, value=y).channel == y


def test_what_moves_up_and_down_is_answered_where_it_is_named(tmp_path: Path) -> None:
    """The mean acceleration of a spring's mass is gravity too: whether it is one is for the user to say."""
    head = "acceleration (m/s²)"
    path = write(tmp_path / "a.csv", {"t (s)": T, head: 9.81 + 10 * Y})
    with pytest.raises(InputError, match="or this one if the body moves up and down"):
        read_record(path)
    assert read_record(path, value=head).channel == head
    for name, mean in ((head, 5.0), ("angle", 9.81)):
        other = write(tmp_path / "b.csv", {"t (s)": T, name: mean + 10 * Y})
        assert read_record(other).channel == name


def test_a_channel_with_one_spike_is_not_preferred(tmp_path: Path) -> None:
    for width, at in ((1, 300), (30, 580)):
        spike = 0.01 * NOISE
        spike[at : at + width] += 20 * np.sin(np.pi * (np.arange(width) + 0.5) / width)[: T.size - at]
        columns = {"t (s)": T, "first (m)": Y, "second (m)": spike}
        assert read_record(write(tmp_path / "a.csv", columns)).channel == "first (m)"


SLOW = np.arange(500) * 0.0263
LATER = 0.2 * np.exp(-0.15 * SLOW) * np.cos(5 * SLOW)
PAIRS = [
    ["Time A (s)", "A (mm)", "Time B (s)", "B (mm)"],
    ["Time A", "A", "Time B", "B"],
    ["t1", "x1", "t2", "x2"],
    ["Timed", "with", "Timed", "without"],
    ["", "", "", ""],
]


def side_by_side(path: Path, names: list[str], columns: list[np.ndarray]) -> Path:
    """A table of columns of several lengths, with empty cells at the ends of the shorter ones."""
    rows = [",".join(repr(float(c[i])) if i < c.size else "" for c in columns) for i in range(T.size)]
    path.write_text("\n".join([*([",".join(names)] if any(names) else []), *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize("names", [*PAIRS, ["A (mm)", "t_A (s)", "B (mm)", "t_B (s)"]], ids=str)
def test_values_keep_the_times_beside_them(tmp_path: Path, names: list[str]) -> None:
    columns = [T, Y, SLOW, LATER] if names in PAIRS else [Y, T, LATER, SLOW]
    found = read_records(side_by_side(tmp_path / "a.csv", names, columns))
    for record, t, y in zip(found, (T, SLOW), (Y, LATER), strict=True):
        np.testing.assert_allclose(record.t, t, atol=1e-12)  # type: ignore[arg-type]
        np.testing.assert_allclose(record.y, y, atol=1e-12)
        time, value = record.columns
        again = read_record(tmp_path / "a.csv", time=time, value=value)
        np.testing.assert_array_equal(again.t, record.t)  # type: ignore[arg-type]


def test_columns_of_one_clock_are_not_pairs(tmp_path: Path) -> None:
    """The negative control: the same times twice, times on both sides, a value that only grows."""
    for names, columns, taken in (
        (["t", "x (m)", "t", "v (m/s)"], [T, Y, T, V], (1, "x (m)")),
        (["time (s)", "x (mm)", "stamp (ms)"], [T, Y, 1e3 * T], ("time (s)", "x (mm)")),
        (["t (s)", "x (mm)", "way (m)", "y (mm)"], [T, Y, np.cumsum(abs(Y)), STEADY], ("t (s)", "x (mm)")),
    ):
        assert read_record(side_by_side(tmp_path / "a.csv", names, columns)).columns == taken


def test_numbers_of_samples_give_way_to_a_rate_in_the_head(tmp_path: Path) -> None:
    record = read_record(write(tmp_path / "a.csv", {"x": INDEX, "y": Y}, "# delta t (s): 0.02"))
    assert (record.t, record.rate, record.columns) == (None, 50.0, (None, "y"))
    alone = read_record(write(tmp_path / "b.csv", {"x": INDEX, "y": Y}))
    assert alone.columns == ("x", "y")
