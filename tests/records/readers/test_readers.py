"""Files of every format, written by their own libraries or by hand, are read with values, rates, units and names."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from bayesdamp.records.files import contents
from bayesdamp.records.read import read_contents, read_record, read_records
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError
from tests.records.readers.written import FORMATS, RATE, Z, cassy, excel, matlab_73, parquet, tdms, uff
from tests.records.tables import T, Y, write_lines

TOLERANCES = {"WAV": 0.5, "Excel": 1e-16, "UFF uneven": 1e-9, "UFF ascii": 1e-9, "UFF named as text": 1e-9}


@pytest.mark.parametrize("case", FORMATS)
def test_a_format_is_read_as_its_library_writes_it(tmp_path: Path, case: str) -> None:
    name, write, channels, unit, quantity, rate = FORMATS[case]
    write(tmp_path / name)
    records = read_records(tmp_path / name)
    assert [record.channel for record in records] == channels
    for record, truth in zip(records, (Y, Z)):
        assert (record.unit, record.quantity, record.run) == (unit, quantity, "")
        assert_times(record, rate)
        scale, tolerance = 1e4 if case == "WAV" else 1.0, TOLERANCES.get(case, 0.0)
        np.testing.assert_allclose(record.y, scale * truth, rtol=0, atol=tolerance)
        time, value = record.columns
        np.testing.assert_array_equal(read_record(tmp_path / name, time=time, value=value).y, record.y)


def assert_times(record: RawRecord, rate: float | None) -> None:
    if rate is None:
        np.testing.assert_allclose(record.t - record.t[0], T, rtol=0, atol=1e-9)
    else:
        assert record.t is None
        assert record.rate == pytest.approx(rate, rel=1e-12)


def test_a_tdms_file_that_was_cut_off_gives_a_warning(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.tdms", tmp_path / "cut.tdms"
    tdms(whole)
    cut.write_bytes(whole.read_bytes()[:-800])
    assert read_contents(whole).warnings == ()
    (note,) = read_contents(cut).warnings
    assert re.search(r"^the file is cut off .* \d+ samples of a channel are missing", note)


def test_cells_and_structs_of_matlab_are_runs(tmp_path: Path) -> None:
    cells = np.empty(2, object)
    cells[:] = [{"t": T, "x": Y}, {"t": T, "x": Z}]
    savemat(tmp_path / "a.mat", {"runs": cells, "fs": RATE})
    savemat(tmp_path / "b.mat", {"angle": Y, "Fs": RATE, "who": "me"}, do_compression=True)
    matlab_73(tmp_path / "c.mat")
    for file in ("a.mat", "c.mat"):
        for run, truth in (("1", Y), ("2", Z)):
            record = read_record(tmp_path / file, run=int(run))
            assert record.run == run
            assert_times(record, None)
            np.testing.assert_array_equal(record.y, truth)
    (single,) = read_records(tmp_path / "b.mat")
    assert single.provenance.facts == {"Fs": RATE, "who": "me"}
    assert_times(single, RATE)


def test_a_mat_file_above_the_limit_is_refused_before_it_is_read(tmp_path: Path, monkeypatch) -> None:
    """64 MiB of zeros in 64 KiB. It is read in this process because a child process would have the normal limit."""
    savemat(path := tmp_path / "a.mat", {"y": np.zeros(2**23)}, do_compression=True)
    monkeypatch.setattr(contents, "LARGEST_FILE", 2**25)
    with pytest.raises(InputError, match="GiB are not read"):
        read_contents(path, isolate=False)


def test_an_npz_file_contains_a_rate_and_pickled_objects_are_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", theta=Y, dt=1 / RATE)
    assert_times(read_record(tmp_path / "a.npz"), RATE)
    objects = np.array([{"a": 1}], object)
    np.save(tmp_path / "b.npy", objects, allow_pickle=True)
    with pytest.raises(InputError, match="pickled objects, which are not read"):
        read_record(tmp_path / "b.npy")
    np.savez(tmp_path / "c.npz", theta=Y, dt=1 / RATE, secret=objects)
    np.testing.assert_array_equal(read_record(tmp_path / "c.npz").y, Y)


def test_lists_of_samples_in_json(tmp_path: Path) -> None:
    samples = [{"seconds_elapsed": repr(t), "phi_deg": y} for t, y in zip(T.tolist(), Y.tolist())]
    (tmp_path / "a.json").write_text(json.dumps(samples), encoding="utf-8")
    (tmp_path / "b.json").write_text("\n".join(map(json.dumps, samples)), encoding="utf-8")
    (tmp_path / "c.json").write_text(json.dumps(np.stack([T, Y], axis=1).tolist()), encoding="utf-8")
    for file, unit in (("a.json", "deg"), ("b.json", "deg"), ("c.json", "")):
        record = read_record(tmp_path / file)
        assert_times(record, None)
        assert record.unit == unit
        np.testing.assert_array_equal(record.y, Y)
    (tmp_path / "d.json").write_text(json.dumps({"t": T.tolist(), "x": Y[1:].tolist()}), encoding="utf-8")
    with pytest.raises(InputError, match="different lengths"):
        read_record(tmp_path / "d.json")


def test_a_uff_file_of_geometry_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.uff").write_text("    -1\n    15\n         1         0\n    -1\n", encoding="utf-8")
    with pytest.raises(InputError, match="its data sets are 15"):
        read_records(tmp_path / "b.uff")


def test_a_damaged_uff_file_is_not_read_as_a_table(tmp_path: Path) -> None:
    """Its numbers are not read as columns, whatever its name is and however it is damaged."""
    uff(tmp_path / "a.uff", names=("arm",))
    text = (tmp_path / "a.uff").read_text(encoding="utf-8")
    renamed = tmp_path / "a.csv"
    for whole in (text.replace("\n", "\r\n"), f"\n\n{text}"):
        renamed.write_bytes(whole.encode())
        assert read_contents(renamed).format == "UFF 58"
        np.testing.assert_allclose(read_record(renamed).y, Y, atol=1e-9)
    renamed.write_text(text[: len(text) // 2], encoding="utf-8")
    with pytest.raises(InputError, match=r"universal file|cut off"):
        read_record(renamed)


def test_a_column_that_begins_like_a_uff_file_is_read_as_a_table(tmp_path: Path) -> None:
    """Negative control: -1 above 58 without the six columns of a data set's mark."""
    (tmp_path / "a.txt").write_text("\n".join(["-1", "58", *(f"{y:.6f}" for y in Y)]), encoding="utf-8")
    assert read_contents(tmp_path / "a.txt").format == "text"


@pytest.mark.parametrize(
    ("file", "write", "module", "line"),
    [
        ("a.xlsx", excel, "openpyxl", 'this is an Excel file: pip install "bayesdamp[excel]"'),
        ("a.parquet", parquet, "pyarrow", 'this is a Parquet file: pip install "bayesdamp[parquet]"'),
        ("a.uff", uff, "pyuff", 'this is a universal file (UFF): pip install "pyuff"'),
    ],
)
def test_the_refusal_without_a_library_says_how_to_install_it(
    tmp_path, monkeypatch, file, write, module, line
) -> None:
    write(tmp_path / file)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=f"^{re.escape(f'{file}: {line}')}$"):
        read_records(tmp_path / file)


def test_each_run_of_an_hdf5_has_its_own_rate(tmp_path: Path) -> None:
    with pytest.importorskip("h5py").File(tmp_path / "a.h5", "w") as file:
        for i, place in enumerate(("run1", "run2"), start=1):
            group = file.create_group(f"measured/{place}")
            group.attrs["fs"] = RATE * i
            group.create_dataset("angle", data=Y).attrs["unit"] = "deg"
    records = read_records(tmp_path / "a.h5")
    assert [(r.run, r.rate, r.unit) for r in records] == [("1", RATE, "deg"), ("2", 2 * RATE, "deg")]


def test_a_cassy_file_contains_its_runs(tmp_path: Path) -> None:
    for unit, packed in (("s", True), ("ms", False)):
        cassy(tmp_path / "a.labx", unit, packed)
        records = read_records(tmp_path / "a.labx")
        assert [(r.run, r.channel, r.unit) for r in records] == [(i, "Winkel", "deg") for i in ("1", "2")]
        for record, truth in zip(records, (Y, Z), strict=True):
            assert_times(record, None)
            np.testing.assert_array_equal(record.y, truth)
        assert any("stores times in s" in note for note in records[0].provenance.notes) == (unit == "ms")


def test_a_cassy_file_that_defines_entities_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.labx").write_text('<!DOCTYPE x [<!ENTITY a "b">]><cassylab>&a;</cassylab>')
    with pytest.raises(InputError, match="document type"):
        read_records(tmp_path / "a.labx")


LVM_HEAD = "LabVIEW Measurement|Separator\tTab|Decimal_Separator\t.|X_Columns\tAXES|***End_of_Header***"
LVM_SEGMENT = "Channels\t1|Samples\t600|Y_Unit_Label\tmm|X0\t0.5|Delta_X\t0.02|***End_of_Header***"
"""Lines, separated by |."""
LVM_ROWS = {
    "One": [f"{t!r}\t{y!r}" for t, y in zip(T.tolist(), Y.tolist(), strict=True)],
    "No": [f"\t{y!r}" for y in Y.tolist()],
    "No, no cell": [f"{y!r}" for y in Y.tolist()],
}


@pytest.mark.parametrize("axes", LVM_ROWS)
def test_optional_parts_of_an_lvm_file_may_be_missing(tmp_path: Path, axes: str) -> None:
    """Optional are the names of the columns, the line between the two heads, and the cell of the times."""
    parts = [([name], [""]) for name in ("X_Value\tside\tComment", "X_Value\tside", "side\tComment")]
    parts += [([], ["\t\t"]), ([], [])]
    head = LVM_HEAD.replace("AXES", axes.partition(",")[0]).split("|")
    for names, blank in parts:
        lines = [*head, *blank, *LVM_SEGMENT.split("|"), *names, *LVM_ROWS[axes]]
        (tmp_path / "a.lvm").write_text("\n".join(lines) + "\n", encoding="utf-8")
        (record,) = read_records(tmp_path / "a.lvm")
        assert_times(record, None)
        np.testing.assert_array_equal(record.y, Y)
        assert (record.unit, record.t[0]) == ("mm", 0.0 if axes == "One" else 0.5)


def test_quoted_cells_may_have_decimal_and_separating_commas(tmp_path: Path) -> None:
    rows = [f'"{t:.2f}","{y:.5f}"'.replace(".", ",") for t, y in zip(T, Y)]
    path = write_lines(tmp_path / "a.csv", ['"Zeit (s)","Winkel (rad)"', *rows])
    np.testing.assert_allclose(read_record(path).y, Y, atol=1e-5)


def test_a_row_with_another_number_of_cells_gives_a_warning(tmp_path: Path) -> None:
    lines = [f"{t},{y}" for t, y in zip(T, Y, strict=True)]
    for line, warnings in (
        ("1.98,0.1,7", ["line 101 has 3 cells where the table has 2"]),
        ("1.98", ["line 101 has 1 cell where the table has 2"]),
        ("1.98,0.1,", []),
    ):
        text = "\n".join(["t,angle", *lines[:99], line, *lines[100:]])
        (tmp_path / "a.csv").write_text(text, encoding="utf-8")
        raw = read_record(tmp_path / "a.csv")
        assert [warning.partition(":")[0] for warning in raw.provenance.warnings] == warnings
