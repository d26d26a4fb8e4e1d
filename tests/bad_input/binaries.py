# ruff: noqa: E501
"""Binary files of every format: cut off, overwritten, encrypted, or with wrong sizes in their headers."""

import io
import json
import struct
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

from tests.bad_input.case import READ, Case, T, Y, raw
from tests.records.readers import written

FORMATS: dict[str, Callable[[Path], object]] = {
    "npz": partial(np.savez, t=T, x=Y), "npy": partial(np.save, arr=np.c_[T, Y]), "h5": written.hdf5, "wav": written.wav, "tdms": written.tdms,
    "mat": partial(savemat, mdict={"t": T, "x": Y}, do_compression=True),
    "xlsx": written.excel, "parquet": written.parquet, "json": written.write_json, "uff": written.uff, "lvm": written.lvm,
}  # fmt: skip


@cache
def whole(form: str) -> bytes:
    """Return the bytes of a file without a fault."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{form}"
        FORMATS[form](path)
        return path.read_bytes()


def bomb_zip(path: Path) -> None:
    """Write an archive whose directory states an uncompressed size of four GiB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", bytes(1000))
    data = path.read_bytes()
    at = data.rindex(b"PK\1\2")
    path.write_bytes(data[: at + 24] + struct.pack("<I", 0xFFFFFFF0) + data[at + 28 :])


def header(path: Path, shape: tuple[int, ...]) -> None:
    """Write a .npy file whose header states more data than it has."""
    with io.BytesIO() as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
        path.write_bytes(file.getvalue() + bytes(64))


def of_version(path: Path, form: str, version: int) -> None:
    """Write a zip archive whose members require a version of zip."""
    data = bytearray(whole(form))
    at = -1
    while (at := data.find(b"PK\1\2", at + 1)) != -1:
        data[at + 6] = version
    path.write_bytes(data)


def locked(path: Path, form: str) -> None:
    """Write a zip archive whose members are marked as encrypted."""
    data = bytearray(whole(form))
    for mark, offset in ((b"PK\1\2", 8), (b"PK\3\4", 6)):
        at = -1
        while (at := data.find(mark, at + 1)) != -1:
            data[at + offset] |= 1
    path.write_bytes(bytes(data))


def hdf(fill: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    """Return a function that writes an HDF5 file and fills it."""

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            fill(file)

    return write


ENDLESS = {"shape": (10**12,), "dtype": "f8", "chunks": (10**6,), "fillvalue": 0.0}
ELSEWHERE = {"shape": (8,), "dtype": "f8", "external": [("/etc/hostname", 0, 64)]}


def compound(path: Path, stream: str) -> None:
    """Write the head of a compound file and the name of a stream, as in Excel files that are not archives."""
    path.write_bytes(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(504) + stream.encode("utf-16-le") + bytes(100))


def wav_head(path: Path, rate: int = 50, channels: int = 1, bits: int = 16) -> None:
    block = channels * bits // 8
    sizes = rate, (rate * block) % 2**32, block % 2**16, bits
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, channels, *sizes)
    data = (Y * 32767).astype("<i2").tobytes()
    body = b"WAVE" + form + struct.pack("<4sI", b"data", len(data)) + data
    path.write_bytes(struct.pack("<4sI", b"RIFF", len(body)) + body)


def as_json(value: object) -> Callable[[Path], object]:
    text = value if isinstance(value, str) else json.dumps(value)
    return lambda path: path.write_text(text, encoding="utf-8")


def arrays(**named: object) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **named)  # type: ignore[arg-type]


_T, _Y = T.tolist(), Y.tolist()
DAMAGED: tuple[tuple[str, str, Callable[[Path], object], str], ...] = (
    ("bomb", "a.npz", bomb_zip, "GiB"), ("bomb", "a.h5", hdf(lambda file: file.create_dataset("x", **ENDLESS)), "GiB"),
    ("encrypted", "a.xlsx", partial(locked, form="xlsx"), "encrypted"),
    ("with a password", "a.xlsx", partial(compound, stream="EncryptedPackage"), "is a workbook with a password"),
    ("of 1997", "a.xls", partial(compound, stream="Workbook"), "is an old Excel workbook (.xls); save"),
    ("of version 255 of zip", "a.xlsx", partial(of_version, form="xlsx", version=255), "damaged or cut off"),
    ("of another file's numbers", "a.h5", hdf(lambda file: file.create_dataset("x", **ELSEWHERE)), "is stored in another file"),
    ("of a link", "a.h5", hdf(lambda file: file.update(x=h5py.ExternalLink("/etc/hostname", "x"))), "no numeric array"),
    ("of 1e6 numbers", "a.npy", partial(header, shape=(10**6,)), "cut off"),
    ("of 1e300 numbers", "a.npy", partial(header, shape=(10**150, 10**150)), ""),
    ("of version 9", "a.npy", raw(b"\x93NUMPY\x09\0" + bytes(200)), ""),
    ("of brackets", "a.npy", raw(b"\x93NUMPY\1\0\xff\xff" + b"(" * 65535), "not readable"),
    ("of values of nan", "a.npz", arrays(t=T, x=Y * np.nan), ""),
    ("of a rate of 0", "a.wav", partial(wav_head, rate=0), ""),
    ("of 65,535 channels", "a.wav", partial(wav_head, channels=65535), ""),
    ("cut off", "a.wav", raw(b"RIFF\x24\0\0\0WAVEfmt "), "not readable"),
    ("of 100,000 levels", "a.json", as_json("[" * 10**5 + "]" * 10**5), "not readable"),
    ("of 400 digits", "a.json", as_json({"time": [10**400 + i for i in range(200)], "angle": _Y}), ""),
    ("of true and false", "a.json", as_json({"time": _T, "angle": [True, False] * 100}), ""),
    ("cut off", "a.json", as_json('{"time": [1, 2'), "not readable"),
    ("cut off", "a.mat", raw(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM\x0f\0\0\0"), "cut off"),
    ("of version 4", "a.mat", raw(struct.pack("<5i", 0, 10**6, 10**6, 0, 2) + b"x\0" + bytes(64)), ""),
    ("cut off", "a.parquet", raw(b"PAR1" + bytes(60)), "not readable"),
    ("without data", "a.lvm", raw(b"LabVIEW Measurement\t\n"), "has no rows of numbers"),
    ("of a link to elsewhere", "a.tdms", raw(b"TDSm" + b"\xff" * 60), ""),
)  # fmt: skip


UNUSUAL: tuple[tuple[str, str, Callable[[Path], object]], ...] = (
    ("of version 45 of zip", "a.xlsx", partial(of_version, form="xlsx", version=45)),
    ("of one name in two objects", "a.json", as_json({"a": {"t": _T, "y": _Y}, "t": "x"})),
)
"""Unusual files that are read."""

CASES = [
    *(Case(f"{Path(file).suffix[1:]} {what}", ("look", "FILE"), file, write, line) for what, file, write, line in DAMAGED),
    *(Case(f"{file} {what}", ("look", "FILE"), file, write, statuses=(READ,)) for what, file, write in UNUSUAL),
]  # fmt: skip
