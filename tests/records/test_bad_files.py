"""Files that are damaged, hostile or no files: each one line of less than 300 characters, no traceback, no hanging."""

from __future__ import annotations

import io
import os
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from bayesdamp.records.files import limits
from bayesdamp.records.read import read_record, read_records
from bayesdamp.types import InputError

T = np.arange(200) / 50
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)


def table(
    path: Path, *, t: Callable[[int], object] = lambda i: T[i], y: Callable[[int], object] = lambda i: Y[i]
) -> None:
    rows = [f"{t(i)},{y(i)}" for i in range(T.size)]
    path.write_text("\n".join(["time,angle", *rows]), encoding="utf-8")


def zip_bomb(path: Path) -> None:
    """A .npz whose directory says that it unpacks to four GiB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", b"\0" * 1000)
    data = path.read_bytes()
    at = data.rindex(b"PK\1\2")
    path.write_bytes(data[: at + 24] + struct.pack("<I", 0xFFFFFFF0) + data[at + 28 :])


def npy_bomb(path: Path) -> None:
    with io.BytesIO() as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (10**6,)}
        )
        path.write_bytes(file.getvalue() + b"\0" * 64)


def npy_huge(path: Path) -> None:
    with io.BytesIO() as file:
        np.lib.format.write_array_header_1_0(
            file, {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
        )
        path.write_bytes(file.getvalue() + b"\0" * 64)


def mat_bomb(path: Path) -> None:
    """A compressed element of 192 MiB of zeros, in 200 KiB."""
    savemat(path, {"x": Y})
    pack = zlib.compressobj(9)
    block = bytes(2**20)
    packed = b"".join([*(pack.compress(block) for _ in range(192)), pack.flush()])
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)


def hdf_bomb(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(10**12,), dtype="f8", chunks=(10**6,), fillvalue=0.0)


def hdf_elsewhere(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(8,), dtype="f8", external=[("/etc/hostname", 0, 64)])


def hdf_link(path: Path) -> None:
    import h5py

    with h5py.File(path.with_suffix(".other"), "w") as file:
        file["x"] = Y
    with h5py.File(path, "w") as file:
        file["x"] = h5py.ExternalLink(str(path.with_suffix(".other")), "x")


def damaged(name: str) -> Callable[[Path], None]:
    """A file of a format with its second half overwritten."""

    def write(path: Path) -> None:
        if name == "npz":
            np.savez(path, t=T, x=Y)
        elif name == "mat":
            savemat(path, {"t": T, "x": Y}, do_compression=True)
        elif name == "xlsx":
            excel(path)
        else:
            import h5py

            with h5py.File(path, "w") as file:
                file["t"], file["x"] = T, Y
        data = bytearray(path.read_bytes())
        data[len(data) // 2 :] = os.urandom(len(data) - len(data) // 2)
        path.write_bytes(bytes(data))

    return write


def excel(path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    assert book.active is not None
    for row in zip(T.tolist(), Y.tolist()):
        book.active.append(row)
    book.save(path)


def encrypted_zip(path: Path) -> None:
    np.savez(path, t=T, x=Y)
    data = bytearray(path.read_bytes())
    at = 0
    while (at := data.find(b"PK\1\2", at)) != -1:
        data[at + 8] |= 1
        at += 4
    path.write_bytes(bytes(data))


def compound(path: Path, stream: str) -> None:
    """The head of a compound file and the name of a stream in it, as Excel writes what is no archive."""
    path.write_bytes(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(504) + stream.encode("utf-16-le") + bytes(100))


def days(path: Path, zone: str = "") -> None:
    table(path, t=lambda i: f"2024-02-{28 + i // 150:02d}T99:99:00{zone}")


FILES: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "empty": ("a.csv", lambda p: p.write_bytes(b""), "is empty"),
    "newlines": ("a.csv", lambda p: p.write_bytes(b"\n\r\n \n" * 50), "nothing but blanks"),
    "zeros": ("a.csv", lambda p: p.write_bytes(b"\0" * 5000), "nothing but blanks"),
    "words": ("a.txt", lambda p: p.write_text("a letter to somebody\n" * 30), "no rows of numbers"),
    "noise": ("a.csv", lambda p: p.write_bytes(os.urandom(5000)), "unknown format"),
    "picture": ("a.png", lambda p: p.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(500)), "unknown format"),
    "an archive": ("a.zip", lambda p: zipfile.ZipFile(p, "w").writestr("a.txt", "x"), "unknown format"),
    "npz cut": ("a.npz", lambda p: p.write_bytes(b"PK\3\4" + bytes(100)), "not readable"),
    "npz damaged": ("a.npz", damaged("npz"), "not readable"),
    "npz encrypted": ("a.npz", encrypted_zip, "encrypted"),
    "npz bomb": ("a.npz", zip_bomb, "GiB"),
    "npy cut": ("a.npy", npy_bomb, "cut off"),
    "npy bomb": ("a.npy", npy_huge, "cut off"),
    "npy header": ("a.npy", lambda p: p.write_bytes(b"\x93NUMPY\1\0\x10\0{'x': ((((((((((("), "not readable"),
    "mat cut": ("a.mat", lambda p: p.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM\x0f\0\0\0"), "cut off"),
    "mat damaged": ("a.mat", damaged("mat"), "not readable"),
    "mat bomb": ("a.mat", mat_bomb, "GiB"),
    "hdf damaged": ("a.h5", damaged("h5"), "a.h5"),
    "hdf bomb": ("a.h5", hdf_bomb, "GiB"),
    "hdf elsewhere": ("a.h5", hdf_elsewhere, "lies in another file"),
    "hdf link": ("a.h5", hdf_link, "no numeric array"),
    "xlsx damaged": ("a.xlsx", damaged("xlsx"), "not readable"),
    "xlsx encrypted": ("a.xlsx", lambda p: compound(p, "EncryptedPackage"), "is a workbook with a password"),
    "xls": ("a.xls", lambda p: compound(p, "Workbook"), "is an Excel 97-2003 workbook (.xls), which is not read; save"),
    "xls named xlsx": ("a.xlsx", lambda p: compound(p, "Book"), "is an Excel 97-2003 workbook"),
    "parquet cut": ("a.parquet", lambda p: p.write_bytes(b"PAR1" + bytes(60)), "not readable"),
    "tdms cut": ("a.tdms", lambda p: p.write_bytes(b"TDSm" + os.urandom(60)), "a.tdms"),
    "lvm without data": ("a.lvm", lambda p: p.write_text("LabVIEW Measurement\t\n"), "has no rows of numbers"),
    "wav cut": ("a.wav", lambda p: p.write_bytes(b"RIFF\x24\0\0\0WAVEfmt "), "not readable"),
    "json cut": ("a.json", lambda p: p.write_text('{"t": [1, 2'), "not readable"),
    "json deep": ("a.json", lambda p: p.write_text("[" * 100000 + "]" * 100000), "not readable"),
    "json long number": ("a.json", lambda p: p.write_text('{"t": [' + "9" * 5000 + ", 1]}"), "not readable"),
    "long number": ("a.csv", lambda p: table(p, y=lambda i: "9" * 5000 if i == 50 else i), "line 52: the value is inf"),
    "long time": ("a.csv", lambda p: table(p, t=lambda i: "9" * 5000 if i == 50 else i), "line 52: the time is inf"),
    "large values": ("a.csv", lambda p: table(p, y=lambda i: 1e308 * np.cos(i)), "not a measurement"),
    "small values": ("a.csv", lambda p: table(p, y=lambda i: 1e-300 * np.cos(i)), "too little"),
    "large times": ("a.csv", lambda p: table(p, t=lambda i: 1e100 * i), "right column"),
    "small times": ("a.csv", lambda p: table(p, t=lambda i: 1e-300 * i), "no instrument resolves"),
    "constant": ("a.csv", lambda p: table(p, y=lambda i: 2.5), "constant"),
    "no time": ("a.csv", lambda p: table(p, t=lambda i: "99:99:99"), "'99:99:99' in column 1 is not a number"),
    "no date": ("a.csv", days, "is not a number"),
    "no day": ("a.csv", lambda p: table(p, t=lambda i: f"2024-02-30T10:00:{i % 60:02d}"), "is not a number"),
}  # fmt: skip


@pytest.mark.parametrize("what", FILES)
def test_a_bad_file_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    name, write, said = FILES[what]
    monkeypatch.setattr(limits, "LARGEST", 2**26)
    write(tmp_path / name)
    for named in ({}, {"time": 1, "value": 2}):
        with pytest.raises(InputError) as caught:
            read_record(tmp_path / name, **named)
        line = str(caught.value)
        assert said in line or named
        assert len(line) < 300
        assert "\n" not in line
        assert line.startswith(name)


def test_the_files_are_bad_for_what_they_are_said_to_be(tmp_path: Path) -> None:
    """The negative control: the same writers without the fault give records."""
    table(tmp_path / "a.csv")
    np.savez(tmp_path / "a.npz", t=T, x=Y)
    savemat(tmp_path / "a.mat", {"t": T, "x": Y}, do_compression=True)
    excel(tmp_path / "a.xlsx")
    for name in ("a.csv", "a.npz", "a.mat", "a.xlsx"):
        np.testing.assert_allclose(read_record(tmp_path / name).y, Y, rtol=1e-12)


@pytest.mark.parametrize("rate", [1e-308, 5e-324, 1e308, 0.0, float("nan"), float("inf")])
def test_a_rate_that_no_instrument_has(tmp_path: Path, rate: float) -> None:
    (tmp_path / "a.txt").write_text("\n".join(map(str, Y)), encoding="utf-8")
    with pytest.raises(InputError, match="rate must be a positive number"):
        read_record(tmp_path / "a.txt", rate=rate)
    np.savez(tmp_path / "a.npz", x=Y, fs=abs(rate) if np.isfinite(rate) else 1e300)
    with pytest.raises(InputError, match=r"a\.npz: (its sampling rate is|no time given)"):
        read_record(tmp_path / "a.npz")


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, said in ((tmp_path / "pipe", "device or a pipe"), (Path("/dev/zero"), "device or a pipe")):
        with pytest.raises(InputError, match=said):
            read_records(path)
    with pytest.raises(InputError, match="is a folder"):
        read_records(tmp_path)
    for name in ("none.csv", "a" * 300, "nul\0l"):
        with pytest.raises(InputError) as caught:
            read_records(tmp_path / name)
        assert len(str(caught.value)) < 300


def test_a_long_name_and_many_columns_keep_the_line_short(tmp_path: Path) -> None:
    path = tmp_path / f"{'x' * 240}.csv"
    names = [f"a very long name of a column, number {i}" for i in range(300)]
    rows = [";".join(f"{np.cos(i * (k + 1)):.3f}" for k in range(300)) for i in range(40)]
    path.write_text("\n".join([";".join(names), *rows]), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_records(path)
    assert len(str(caught.value)) < 300


STAMPS = {
    "a day does not vanish": (
        ["2024-02-28T23:59:59.5", "2024-02-29T00:00:00.25", "2024-03-02T00:00"],
        0.75,
        172800.5,
    ),
    "Z is a zone": (["2024-05-03T10:00:00Z", "2024-05-03T10:00:01Z", "2024-05-03T10:00:03Z"], 1, 3),
    "zones are taken off": (
        ["2024-05-03T10:00:00+02:00", "2024-05-03T08:00:01Z", "2024-05-03 06:00:03-02"],
        1,
        3,
    ),
    "a zone before midnight": (
        ["2024-05-03T23:30:00-01:00", "2024-05-04T00:30:01Z", "2024-05-04T00:30:02Z"],
        1,
        2,
    ),
    "days first": (["03.05.2024 10:00:00", "03.05.2024 10:00:01", "04.05.2024 10:00:00"], 1, 86400),
    "midnight without a date": (["23:59:59.5", "00:00:00.5", "00:00:02.5"], 1, 3),
}


@pytest.mark.parametrize("what", STAMPS)
def test_dates_in_the_column_of_times(tmp_path: Path, what: str) -> None:
    stamps, second, third = STAMPS[what]
    rows = [f"{cell},{np.cos(i):.3f}" for i, cell in enumerate([*stamps, *[stamps[-1]] * 12])]
    (tmp_path / "a.csv").write_text("\n".join(rows), encoding="utf-8")
    record = read_record(tmp_path / "a.csv", time=1, value=2)
    assert record.t is not None
    np.testing.assert_allclose(record.t[:3] - record.t[0], [0, second, third], rtol=0, atol=1e-9)


def test_what_was_meant_is_named(tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("t,a\n0,1\n")
    with pytest.raises(InputError, match=r"rig.csvv: no such file; did you mean 'rig.csv'\?"):
        read_record(tmp_path / "rig.csvv")
    with pytest.raises(
        InputError, match=r"is a folder, not a file; give the files in it: .*/\*\.csv \(1 file\)"
    ):
        read_record(tmp_path)


def test_an_error_knows_what_is_wrong_where_by_itself_and_in_another_process() -> None:
    error = InputError("the time goes back", "rig.csv", "line 7")
    assert str(error) == "rig.csv, line 7: the time goes back"
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert (one.what, one.where, one.at) == ("the time goes back", "rig.csv", "line 7")
        assert str(one) == str(error)
    assert str(InputError("nothing oscillates")) == "nothing oscillates"
