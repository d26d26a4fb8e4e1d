"""Reading text tables and array files, and the one-line refusals of bad ones."""

import re

import numpy as np
import pytest
from scipy.io import savemat

from bayesdamp.records.read import read_record
from bayesdamp.records.readers.text import parse_table
from bayesdamp.types import InputError
from tests.records.tables import write_lines

T = np.arange(20) * 0.1
Y = np.round(np.cos(3 * T) * np.exp(-0.1 * T), 4)


def rows(separator=",", decimal="."):
    return [f"{t:.1f}{separator}{y:.4f}".replace(".", decimal) for t, y in zip(T, Y)]


TEXTS = {
    "comma": (["time, angle", *rows()], "time", "angle"),
    "semicolon and decimal comma": (['"Time (s)";" Angle "', *rows(";", ",")], "Time (s)", "Angle"),
    "tab": (["t\tx", *rows("\t")], "t", "x"),
    "tab and decimal comma": (["t\tx", *rows("\t", ",")], "t", "x"),
    "blanks": (["  " + row for row in rows("   ")], 1, 2),
    "dashes below the names": (["Stamp,Angle(deg)", "-----------", *rows()], "Stamp", "Angle(deg)"),
    "names, then units": (["time,phi", "s,rad", *rows()], "time", "phi"),
    "comments, names": (["# made by hand", "# on a Monday", "time,phi", *rows()], "time", "phi"),
    "blank lines": (["time,phi", "", *rows(), "", ""], "time", "phi"),
    "more columns": (["n;t;v;x", *(f"7;{r};abc".replace(".", ",") for r in rows(";"))], 2, 3),
    "integers first": (["t,x", *rows(), "2,0"], "t", "x"),
    "exponents": (["t;x", *(f"{t:.2E};{y:.4E}".replace(".", ",") for t, y in zip(T, Y))], "t", "x"),
}
ENCODINGS = {"semicolon and decimal comma": ("utf-8", "utf-8-sig", "utf-16")}


@pytest.mark.parametrize("case", TEXTS)
def test_a_text_table_is_read(tmp_path, case):
    lines, time, value = TEXTS[case]
    for encoding in ENCODINGS.get(case, ("utf-8",)):
        raw = read_record(write_lines(tmp_path / "a.csv", lines, encoding), time=time, value=value)
        np.testing.assert_array_equal(raw.t[:20], np.round(T, 1))
        np.testing.assert_array_equal(raw.y[:20], Y)


def test_a_head_longer_than_the_rows_gives_names_and_units(tmp_path):
    """A head with separators at its end, with more names than columns, and with facts next to the first rows."""
    longer = "its header names {} columns, but its rows have 2"
    for separator, head, warnings in (
        (",", "t (ms){0}phi (deg){0}{0}", []),
        (";", "t (ms){0}phi (deg){0}comment", [longer.format(3)]),
        ("\t", "t (ms){0}phi (deg){0}name{0}value", [
            longer.format(4), "line 2 has 4 cells where the table has 2 (and 1 more",
        ]),
    ):  # fmt: skip
        lines = rows(separator)
        if len(warnings) == 2:
            lines[:2] = [lines[0] + "\tmass\t1.5", lines[1] + "\twho\tme"]
        record = read_record(write_lines(tmp_path / "a.csv", [head.format(separator), *lines]))
        assert (record.columns, record.unit) == (("t (ms)", "phi (deg)"), "deg")
        np.testing.assert_allclose(record.t, T / 1e3, atol=1e-12)
        np.testing.assert_array_equal(record.y, Y)
        for warning, start in zip(record.provenance.warnings, warnings, strict=True):
            assert warning.startswith(start)


def test_a_head_shorter_than_the_rows_gives_a_warning():
    """Decimal commas that also separate cells make more cells than names. Empty columns do not count."""
    split = [f"{1000 * t:.0f},{y:.4f}".replace(".", ",") for t, y in zip(T, Y)]
    numbered = [f"{i},{row}" for i, row in enumerate(rows())]
    warning = "its header names {} columns, but its rows have {}"
    for head, lines, warnings in (
        ("t (ms),x (mm)", split, [warning.format(2, 3)]),
        ("t (ms),x,v", [f"{row},1.5" for row in numbered], [warning.format(3, 4)]),
        (",t,x", numbered, []),
        ("t,x", [f"{row},," for row in rows()], []),
    ):
        assert [line.split(":")[0] for line in parse_table([head, *lines]).warnings] == warnings


STAMPS = {
    "a day does not vanish": (["2024-02-28T23:59:59.5", "2024-02-29T00:00:00.25", "2024-03-02T00:00"], 0.75, 172800.5),
    "zones are taken off": (["2024-05-03T10:00:00+02:00", "2024-05-03T08:00:01Z", "2024-05-03 06:00:03-02"], 1, 3),
    "a zone before midnight": (["2024-05-03T23:30:00-01:00", "2024-05-04T00:30:01Z", "2024-05-04T00:30:02Z"], 1, 2),
    "days first": (["03.05.2024 10:00:00", "03.05.2024 10:00:01", "04.05.2024 10:00:00"], 1, 86400),
    "months first": (["1/31/2024 11:59:59 PM", "2/1/2024 12:00:00 AM", "2/1/2024 12:00:02.5 AM"], 1, 3.5),
    "slashes without seconds": (["1/31/2024 23:59", "2/1/2024 00:00", "2/1/2024 00:02"], 60, 180),
    "midnight without a date": (["23:59:59.5", "00:00:00.5", "00:00:02.5"], 1, 3),
}  # fmt: skip


@pytest.mark.parametrize(("stamps", "second", "third"), STAMPS.values(), ids=STAMPS)
def test_dates_in_the_column_of_times(tmp_path, stamps, second, third):
    lines = [f"{cell},{np.cos(i):.3f}" for i, cell in enumerate([*stamps, *[stamps[-1]] * 12])]
    record = read_record(write_lines(tmp_path / "a.csv", lines), time=1, value=2)
    np.testing.assert_allclose(record.t[:3] - record.t[0], [0, second, third], rtol=0, atol=1e-9)


def test_thousands_separators_are_read(tmp_path):
    """As spreadsheets write 1234.5 in English and in German. A point alone is a decimal point."""
    english = ["t (ms),x", *(f'"{1000 * t:,.2f}",{y:.4f}' for t, y in zip(T, Y))]
    swapped = str.maketrans({",": ".", ".": ",", '"': ""})
    german = ["t (ms);x", *(line.replace('",', ";").translate(swapped) for line in english[1:])]
    for lines in (german, english):
        raw = read_record(write_lines(tmp_path / "a.csv", lines))
        np.testing.assert_allclose(raw.t, T, atol=1e-12)
        np.testing.assert_array_equal(raw.y, Y)
    decimal = ["t;x", *(f"{t:.1f};{5 + y:.3f}" for t, y in zip(T, Y))]
    raw = read_record(write_lines(tmp_path / "c.csv", decimal))
    np.testing.assert_allclose(raw.y, 5 + Y, atol=6e-4)


def test_a_serial_monitors_stamps_are_times(tmp_path):
    raw = read_record(write_lines(tmp_path / "a.txt", [f"10:00:{t:06.3f} -> {y:.4f}" for t, y in zip(T, Y)]))
    np.testing.assert_allclose(raw.t - raw.t[0], T, atol=1e-9)
    np.testing.assert_array_equal(raw.y, Y)


def test_incomplete_rows_and_repeated_heads_are_left_out(tmp_path):
    lines = ["t;x;v", "0,00;;", *(f"{r};" for r in rows(";", ",")[1:]), "9,0;;"]
    raw = read_record(write_lines(tmp_path / "a.csv", lines), time="t", value="x")
    assert raw.y.size == 19
    assert any("2 rows with an empty cell" in note for note in raw.provenance.notes)
    lines = ["time, angle", *rows()[:8], "time, angle", *rows()[8:]]
    raw = read_record(write_lines(tmp_path / "a.csv", lines))
    np.testing.assert_array_equal(raw.y, Y)
    assert "Line 10 repeats the names of the columns and is left out." in raw.provenance.notes


def test_variables_of_matlab_and_numpy_files_are_read_by_name_or_number(tmp_path):
    both = np.stack([T, Y], axis=1)
    savemat(tmp_path / "a.mat", {"Theta1": {"time": T, "signals": {"values": Y[:, None]}}, "both": both})
    np.savez(tmp_path / "a.npz", t=T, x=Y, both=both)
    np.save(tmp_path / "a.npy", both)
    np.save(tmp_path / "b.npy", np.array(list(zip(T, Y)), dtype=[("t", float), ("x", float)]))
    for file, time, value in (
        ("a.mat", "Theta1.time", "Theta1.signals.values"),
        ("a.mat", "both.1", "both.2"),
        ("a.npz", "t", "x"),
        ("a.npz", "both.1", "both.2"),
        ("a.npy", 1, 2),
        ("a.npy", "1", "2"),
        ("b.npy", "t", "x"),
    ):
        raw = read_record(tmp_path / file, time=time, value=value)
        np.testing.assert_array_equal(raw.t, T)
        np.testing.assert_array_equal(raw.y, Y)
    with pytest.raises(InputError, match=r"Theta1\.signals\.values"):
        read_record(tmp_path / "a.mat", time="Theta1.time", value="Theta1.signals.value")


GOOD = ["time,angle", *rows()]
BAD = {
    "unknown column": (GOOD, {"value": "angel"}, "unknown column 'angel'; did you mean 'angle'"),
    "column with another name": (GOOD, {"value": "zzz"}, "valid are time, angle"),
    "column number too large": (GOOD, {"value": 3}, "no column 3; the file has 2 columns"),
    "name without header": (rows(), {"value": "angle", "time": 1}, "no names"),
    "text in a number": ([*GOOD[:8], "0.7,oops", *GOOD[8:]], {}, "9: 'oops' in column 2 is not a number"),
    "two tables": ([*GOOD[:8], "time (ms),x", *GOOD[8:]], {}, "9: another table begins, with 'time (ms)'"),
    "infinite time": ([*GOOD[:8], "inf,0.1", *GOOD[8:]], {}, "line 9: the time is inf"),
    "several": ([*GOOD[:8], "nan,0.1", "0.8,bad", "1.1,nan"], {}, " (2 more like it)"),
    "too short": (GOOD[:8], {}, "only 7 samples; a record needs at least 10"),
    "no times": (["angle", *map(str, Y)], {"time": None}, "rate in Hz"),
}
"""More bad files are in tests/bad_input."""


@pytest.mark.parametrize(("lines", "change", "message"), BAD.values(), ids=BAD)
def test_a_bad_text_table_is_refused(tmp_path, lines, change, message):
    options = {"time": "time", "value": "angle", **change}
    with pytest.raises(InputError, match=rf"bad\.csv.*{re.escape(message)}[^\n]*$"):
        read_record(write_lines(tmp_path / "bad.csv", lines), **options)


@pytest.mark.parametrize("rate", [5e-324, 1e300, 1e308])
def test_an_impossible_rate_in_a_file_is_refused(tmp_path, rate):
    np.savez(tmp_path / "a.npz", x=Y, fs=rate)
    with pytest.raises(InputError, match=r"a\.npz: (a sampling rate of|has one column of values and no t)"):
        read_record(tmp_path / "a.npz")


def test_a_missing_file_and_a_folder_are_refused_with_a_suggestion(tmp_path):
    (tmp_path / "rig.csv").write_text("t,a\n0,1\n")
    with pytest.raises(InputError, match=r"rig.csvv: no such file; did you mean 'rig.csv'\?"):
        read_record(tmp_path / "rig.csvv")
    with pytest.raises(InputError, match=r"is a folder, not a file; give the files in it: .*/\*\.csv \(1 f"):
        read_record(tmp_path)
