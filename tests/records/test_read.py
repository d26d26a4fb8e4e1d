"""Every format, and every bad file with its one line."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from bayesdamp.records.read import read_record, read_records
from bayesdamp.types import InputError

T = np.arange(20) * 0.1
Y = np.round(np.cos(3 * T) * np.exp(-0.1 * T), 4)


def rows(separator=",", decimal="."):
    return [f"{t:.1f}{separator}{y:.4f}".replace(".", decimal) for t, y in zip(T, Y)]


def write(path, lines, encoding="utf-8"):
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


TEXTS = {
    "comma": (["time, angle", *rows()], "time", "angle"),
    "semicolon and decimal comma": (['"Time (s)";" Angle "', *rows(";", ",")], "Time (s)", "Angle"),
    "tab": (["t\tx", *rows("\t")], "t", "x"),
    "tab and decimal comma": (["t\tx", *rows("\t", ",")], "t", "x"),
    "blanks": (["  " + row for row in rows("   ")], 1, 2),
    "no header": (rows(), "1", "2"),
    "dashes below the names": (["Stamp,Angle(deg)", "-----------", *rows()], "Stamp", "Angle(deg)"),
    "names, then units": (["time,phi", "s,rad", *rows()], "time", "phi"),
    "comments, names": (["# made by hand", "# on a Monday", "time,phi", *rows()], "time", "phi"),
    "blank lines": (["time,phi", "", *rows(), "", ""], "time", "phi"),
    "more columns": (["n;t;v;x", *(f"7;{r};abc".replace(".", ",") for r in rows(";"))], 2, 3),
    "integers first": (["t,x", *rows(), "2,0"], "t", "x"),
}


@pytest.mark.parametrize(
    ("what", "encoding"),
    [
        *((what, "utf-8") for what in TEXTS),
        *(("semicolon and decimal comma", e) for e in ("utf-8-sig", "utf-16")),
    ],
)
def test_text(tmp_path, what, encoding):
    lines, time, value = TEXTS[what]
    raw = read_record(write(tmp_path / "a.csv", lines, encoding), time=time, value=value)
    np.testing.assert_array_equal(raw.t[:20], np.round(T, 1))
    np.testing.assert_array_equal(raw.y[:20], Y)


def test_names_above_values_of_other_columns(tmp_path):
    lines = ["start, sample_rate, seconds", "90, 10, 2", *(f"{y}" for y in Y)]
    raw = read_record(write(tmp_path / "a.txt", lines), rate=10)
    assert raw.t is None
    assert raw.rate == 10
    np.testing.assert_array_equal(raw.y, Y)


LONGER = {
    "separators at its end": ("t (ms){0}phi (deg){0}{0}", []),
    "more names": ("t (ms){0}phi (deg){0}comment", ["its head names 3 columns and its rows have 2"]),
    "facts beside the first rows": (
        "t (ms){0}phi (deg){0}name{0}value",
        [
            "its head names 4 columns and its rows have 2",
            "line 2 has 4 cells where the table has 2 (and 1 more",
        ],
    ),
}


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("what", LONGER)
def test_a_head_longer_than_the_rows_gives_names_and_units(tmp_path, what, separator):
    head, said = LONGER[what]
    beside = [f"{separator}mass{separator}1.5", f"{separator}who{separator}me"] if "beside" in what else []
    lines = [row + (beside[i] if i < len(beside) else "") for i, row in enumerate(rows(separator))]
    record = read_record(write(tmp_path / "a.csv", [head.format(separator), *lines]))
    assert (record.columns, record.unit) == (("t (ms)", "phi (deg)"), "deg")
    np.testing.assert_allclose(record.t, T / 1e3, atol=1e-12)
    np.testing.assert_array_equal(record.y, Y)
    found = record.provenance.warnings
    assert len(found) == len(said)
    assert all(line.startswith(start) for line, start in zip(found, said))


def test_single_blanks_before_units_part_no_names(tmp_path):
    record = read_record(write(tmp_path / "a.txt", ["t (ms) phi (deg)", *rows(" ")]))
    assert (record.columns, record.unit) == (("t (ms)", "phi (deg)"), "deg")


def test_one_column_with_decimal_comma(tmp_path):
    raw = read_record(
        write(tmp_path / "a.txt", ["angle", *(f"{y:.4f}".replace(".", ",") for y in Y)]), rate=10
    )
    np.testing.assert_array_equal(raw.y, Y)


def test_time_of_day_past_midnight(tmp_path):
    lines = [
        f"23:59:{59.5 + t:06.3f},{y}" if t < 0.45 else f"00:00:{t - 0.5:06.3f},{y}" for t, y in zip(T, Y)
    ]
    raw = read_record(write(tmp_path / "a.csv", lines), time=1, value=2)
    np.testing.assert_allclose(raw.t - raw.t[0], T, atol=1e-9)


def test_thousands_in_groups(tmp_path):
    """As a spreadsheet writes 1234.5; a point alone is no group of thousands."""
    german = [
        f"{1000 * t:,.2f};{y:.4f}".replace(",", "_").replace(".", ",").replace("_", ".") for t, y in zip(T, Y)
    ]
    english = [f'"{1000 * t:,.2f}",{y:.4f}' for t, y in zip(T, Y)]
    for name, lines in (("a.csv", german), ("b.csv", english)):
        raw = read_record(
            write(tmp_path / name, ["t (ms),x".replace(",", ";" if name == "a.csv" else ","), *lines])
        )
        np.testing.assert_allclose(raw.t, T, atol=1e-12)
        np.testing.assert_array_equal(raw.y, Y)
    pointed = [f"{t:.1f};{5 + y:.3f}" for t, y in zip(T, Y)]
    raw = read_record(write(tmp_path / "c.csv", ["t;x", *pointed]))
    np.testing.assert_allclose(raw.y, 5 + Y, atol=6e-4)


def test_a_serial_monitors_stamps_are_times(tmp_path):
    lines = [f"10:00:{t:06.3f} -> {y:.4f}" for t, y in zip(T, Y)]
    raw = read_record(write(tmp_path / "a.txt", lines))
    np.testing.assert_allclose(raw.t - raw.t[0], T, atol=1e-9)
    np.testing.assert_array_equal(raw.y, Y)
    assert raw.columns == (1, 2)


def test_dates_with_slashes_and_halves_of_a_day(tmp_path):
    def stamped(seconds):
        days, rest = divmod(86399.5 + seconds, 86400.0)  # over midnight, and over the end of a month
        date = ("1/31/2024", "2/1/2024")[int(days)]
        hours, rest = divmod(rest, 3600)
        half = "PM" if hours >= 12 else "AM"
        return f"{date} {int(hours) % 12 or 12}:{int(rest // 60):02d}:{rest % 60:05.2f} {half}"

    lines = ["Date,x", *(f"{stamped(t)},{y}" for t, y in zip(T, Y))]
    raw = read_record(write(tmp_path / "a.csv", lines))
    np.testing.assert_allclose(raw.t - raw.t[0], T, atol=1e-6)
    wrong = ["Date,x", *(f"45/45/2024 1:00:{t:05.2f} AM,{y}" for t, y in zip(T, Y))]
    with pytest.raises(InputError, match="no time given"):
        read_record(write(tmp_path / "b.csv", wrong))


def test_incomplete_rows_are_left_out_and_said(tmp_path):
    lines = ["t;x;v", "0,00;;", *(f"{r};" for r in rows(";", ",")[1:]), "9,0;;"]
    raw = read_record(write(tmp_path / "a.csv", lines), time="t", value="x")
    assert raw.y.size == 19
    assert raw.provenance.more["incomplete_rows"] == 2
    assert any("2 rows with an empty cell" in note for note in raw.provenance.notes)


def test_matlab(tmp_path):
    path = tmp_path / "a.mat"
    savemat(
        path, {"Theta1": {"time": T, "signals": {"values": Y[:, None]}}, "both": np.stack([T, Y], axis=1)}
    )
    for time, value in (("Theta1.time", "Theta1.signals.values"), ("both.1", "both.2")):
        raw = read_record(path, time=time, value=value)
        np.testing.assert_array_equal(raw.t, T)
        np.testing.assert_array_equal(raw.y, Y)
    with pytest.raises(InputError, match=r"Theta1\.signals\.values"):
        read_record(path, time="Theta1.time", value="Theta1.signals.value")


def test_matlab_7_3(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        file["run/t"], file["run/x"] = T[None, :], Y[None, :]
    raw = read_record(tmp_path / "a.mat", time="run.t", value="run.x")
    np.testing.assert_array_equal(raw.y, Y)


def test_numpy(tmp_path):
    np.savez(tmp_path / "a.npz", t=T, x=Y, both=np.stack([T, Y], axis=1))
    np.save(tmp_path / "a.npy", np.stack([T, Y], axis=1))
    named = np.array(list(zip(T, Y)), dtype=[("t", float), ("x", float)])
    np.save(tmp_path / "b.npy", named)
    for file, time, value in (
        ("a.npz", "t", "x"),
        ("a.npz", "both.1", "both.2"),
        ("a.npy", 1, 2),
        ("a.npy", "1", "2"),
        ("b.npy", "t", "x"),
    ):
        raw = read_record(tmp_path / file, time=time, value=value)
        np.testing.assert_array_equal(raw.t, T)
        np.testing.assert_array_equal(raw.y, Y)


GOOD = ["time,angle", *rows()]
BAD = {
    "empty": ([], {}, "empty"),
    "no numbers": (["hello", "world"], {}, "no rows of numbers"),
    "unknown column": (GOOD, {"value": "angel"}, "unknown column 'angel'; did you mean 'angle'"),
    "far name": (GOOD, {"value": "zzz"}, "valid are time, angle"),
    "number too large": (GOOD, {"value": 3}, "no column 3, the file has 2"),
    "name without header": (rows(), {"value": "angle", "time": 1}, "no names"),
    "text in a number": (
        [*GOOD[:8], "0.7,oops", *GOOD[8:]],
        {},
        "line 9: 'oops' in column 2 is not a number",
    ),
    "nan": ([*GOOD[:8], "0.7,nan", *GOOD[8:]], {}, "line 9: the value is nan"),
    "infinite time": ([*GOOD[:8], "inf,0.1", *GOOD[8:]], {}, "line 9: the time is inf"),
    "too short": (GOOD[:8], {}, "7 samples, a record needs at least 10"),
    "constant": (["time,angle", *(f"{t:.1f},2.5" for t in T)], {}, "constant"),
    "no time": (["angle", *map(str, Y)], {"time": None}, "rate in Hz"),
    "both": (GOOD, {"rate": 10.0}, "not both"),
    "bad rate": (GOOD, {"time": None, "rate": -1.0}, "positive"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_text(tmp_path, what):
    lines, change, message = BAD[what]
    path = tmp_path / "bad.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_record(path, **{"time": "time", "value": "angle", **change})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "bad.csv" in str(caught.value)


def test_no_such_file_folder_and_rubbish(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_record(tmp_path / "none.csv", time=1)
    with pytest.raises(InputError, match="folder"):
        read_record(tmp_path, time=1)
    for name in ("a.mat", "a.npy", "a.npz", "a.csv"):
        (tmp_path / name).write_bytes(bytes(range(256)) * 4)
        with pytest.raises(InputError, match=name):
            read_record(tmp_path / name, time=1, value=2)


def test_arrays_of_different_length(tmp_path):
    np.savez(tmp_path / "a.npz", t=T, x=Y[:-1])
    with pytest.raises(InputError, match="20 samples, 'x' has 19"):
        read_record(tmp_path / "a.npz", time="t", value="x")


@pytest.mark.parametrize(("beside", "unit"), [((), "deg"), (("drive",), "")])
def test_a_unit_in_a_run_s_own_structure_is_that_of_its_one_column(
    tmp_path: Path, beside: tuple[str, ...], unit: str
) -> None:
    """The control has a second column in each: then nobody knows of which the unit is."""
    t = np.arange(0.0, 10.0, 0.02)
    y = 20 * np.exp(-0.1 * t) * np.cos(6 * t)
    runs = {
        f"run{i}": {"time": t, "theta": y, "unit": "deg", **dict.fromkeys(beside, 0 * t + 3)} for i in (1, 2)
    }
    savemat(tmp_path / "rig.mat", {"rig": runs})
    found = read_records(tmp_path / "rig.mat")
    assert [record.unit for record in found] == [unit, unit]


def test_a_repeated_head_is_left_out(tmp_path):
    lines = ["time, angle", *rows()[:8], "time, angle", *rows()[8:]]
    record = read_record(write(tmp_path / "a.csv", lines))
    np.testing.assert_array_equal(record.y, Y)
    assert "Line 10 repeats the names of the columns and is left out." in record.provenance.notes


def test_rows_without_a_number_are_counted(tmp_path):
    lines = ["time, angle", *rows()]
    lines[5], lines[9], lines[12] = "nan,0.1", "0.8,bad", "1.1,nan"
    with pytest.raises(
        InputError, match=r"line 6: the time is nan, not a finite number; .* \(2 more like it\)"
    ):
        read_record(write(tmp_path / "a.csv", lines))
