# ruff: noqa: E501
"""Binary files of every format, cut off, overwritten, encrypted or said to be larger than they are."""

from __future__ import annotations

import io
import json
import struct
import wave
import zipfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np

from tests.bad_input.case import READ, REFUSED, Case, T, Y, nothing, raw


def npz(path: Path) -> None:
    np.savez(path, t=T, x=Y)


def npy(path: Path) -> None:
    np.save(path, np.c_[T, Y])


def mat(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"t": T, "x": Y}, do_compression=True)


def hdf(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["t"], file["x"] = T, Y


def wav(path: Path) -> None:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(50)
        file.writeframes((Y * 32767).astype("<i2").tobytes())


def tdms(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(str(path)) as file:
        file.write_segment([ChannelObject("g", "t", T), ChannelObject("g", "x", Y)])


def xlsx(path: Path) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    assert book.active is not None
    for row in [("time", "angle"), *zip(T.tolist(), Y.tolist())]:
        book.active.append(row)
    book.save(path)


def parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table({"time": T, "angle": Y}), path)


def json_text(path: Path) -> None:
    path.write_text(json.dumps({"time": T.tolist(), "angle": Y.tolist()}), encoding="utf-8")


def uff(path: Path) -> None:
    """Dataset 58 by hand: its eleven lines of head, and values four to a line."""
    names = ["angle", "NONE", "NONE", "NONE", "NONE"]
    ids = f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{1:10d}{1:4d} {'NONE':10s}{1:10d}{1:4d}"
    form = f"{4:10d}{Y.size:10d}{1:10d}{0.0:13.5e}{0.02:13.5e}{0.0:13.5e}"
    axis = [f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}" for kind in (17, 8, 0, 0)]
    values = ["".join(f"{v:20.12e}" for v in Y[i : i + 4]) for i in range(0, Y.size, 4)]
    lines = ["    -1", "    58", *names, ids, form, *axis, *values, "    -1", ""]
    path.write_text("\n".join(lines), encoding="ascii")


def lvm(path: Path) -> None:
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
    ]
    head += ["Multi_Headings\tNo", "X_Columns\tOne", "***End_of_Header***\t", "\t"]
    head += [
        "Channels\t1\t",
        "Samples\t200\t",
        "Delta_X\t0.02\t",
        "***End_of_Header***\t\t",
        "X_Value\tangle\tComment",
    ]
    path.write_text("\n".join([*head, *(f"{t:.6f}\t{y:.6f}" for t, y in zip(T, Y))]), encoding="ascii")


FORMATS: dict[str, Callable[[Path], None]] = {
    "npz": npz, "npy": npy, "mat": mat, "h5": hdf, "wav": wav, "tdms": tdms, "xlsx": xlsx, "parquet": parquet,
    "json": json_text, "uff": uff, "lvm": lvm,
}  # fmt: skip


@cache
def whole(form: str, folder: Path) -> bytes:
    """An undamaged file's bytes."""
    path = folder / f"whole.{form}"
    FORMATS[form](path)
    data = path.read_bytes()
    path.unlink()
    return data


def cut(data: bytes, share: float) -> bytes:
    return data[: max(1, int(len(data) * share))]


def overwritten(data: bytes, start: float, stop: float, seed: int) -> bytes:
    a, b = int(len(data) * start), int(len(data) * stop)
    return data[:a] + np.random.default_rng(seed).bytes(b - a) + data[b:]


def flipped(data: bytes, seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    found = bytearray(data)
    for at in rng.integers(0, len(found), 12):
        found[at] ^= 1 << int(rng.integers(8))
    return bytes(found)


def head_filled(data: bytes, byte: int) -> bytes:
    return data[:8] + bytes([byte]) * min(120, len(data) - 8) + data[128:]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "cut to a fiftieth": partial(cut, share=0.02),
    "cut to a third": partial(cut, share=1 / 3),
    "cut to nine tenths": partial(cut, share=0.9),
    "overwritten from a tenth on": partial(overwritten, start=0.1, stop=1.0, seed=1),
    "overwritten at the end": partial(overwritten, start=0.8, stop=1.0, seed=2),
    "twelve bits flipped": partial(flipped, seed=3),
    "twelve other bits flipped": partial(flipped, seed=4),
    "its head of ones": partial(head_filled, byte=255),
    "its head of zeros": partial(head_filled, byte=0),
}


def damaged(path: Path, form: str, how: str) -> None:
    path.write_bytes(DAMAGES[how](whole(form, path.parent)))


DAMAGED = [
    Case(
        f"{form} {how}",
        ("look", "FILE"),
        f"a.{form}",
        partial(damaged, form=form, how=how),
        ends=(READ, REFUSED),
    )
    for form in FORMATS
    for how in DAMAGES
]


def bomb_zip(path: Path) -> None:
    """An archive whose directory says that it unpacks to four GiB."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", bytes(1000))
    data = path.read_bytes()
    at = data.rindex(b"PK\1\2")
    path.write_bytes(data[: at + 24] + struct.pack("<I", 0xFFFFFFF0) + data[at + 28 :])


def header(path: Path, shape: tuple[int, ...] = (10,), descr: str = "<f8") -> None:
    """A .npy of a header that promises more than there is."""
    with io.BytesIO() as file:
        np.lib.format.write_array_header_1_0(file, {"descr": descr, "fortran_order": False, "shape": shape})
        path.write_bytes(file.getvalue() + bytes(64))


def objects(path: Path) -> None:
    """Pickled objects, which are never unpickled."""
    np.save(path, np.array([{"a": 1}, None], dtype=object), allow_pickle=True)


def of_version(path: Path, form: str, version: int) -> None:
    """A zip archive, each member of which says that it needs a version of zip."""
    data = bytearray(whole(form, path.parent))
    at = -1
    while (at := data.find(b"PK\1\2", at + 1)) != -1:
        data[at + 6] = version
    path.write_bytes(data)


def locked(path: Path, form: str) -> None:
    """A zip archive, each member of which says that it is encrypted."""
    data = bytearray(whole(form, path.parent))
    for mark, offset in ((b"PK\1\2", 8), (b"PK\3\4", 6)):
        at = -1
        while (at := data.find(mark, at + 1)) != -1:
            data[at + offset] |= 1
    path.write_bytes(bytes(data))


def hdf_bomb(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(10**12,), dtype="f8", chunks=(10**6,), fillvalue=0.0)


def wav_head(path: Path, rate: int = 50, channels: int = 1, bits: int = 16) -> None:
    block = channels * bits // 8
    form = struct.pack(
        "<4sIHHIIHH", b"fmt ", 16, 1, channels, rate, (rate * block) % 2**32, block % 2**16, bits
    )
    data = (Y * 32767).astype("<i2").tobytes()
    body = b"WAVE" + form + struct.pack("<4sI", b"data", len(data)) + data
    path.write_bytes(struct.pack("<4sI", b"RIFF", len(body)) + body)


def as_json(value: object) -> Callable[[Path], object]:
    return lambda path: path.write_text(
        value if isinstance(value, str) else json.dumps(value), encoding="utf-8"
    )


def arrays(**named: object) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **named)  # type: ignore[arg-type]


_STEM = {"time": T.tolist()}
MADE: tuple[tuple[str, str, Callable[[Path], object]], ...] = (
    ("bomb", "a.npz", bomb_zip), ("bomb", "a.xlsx", bomb_zip), ("encrypted", "a.npz", partial(locked, form="npz")),
    ("encrypted", "a.xlsx", partial(locked, form="xlsx")), ("old, encrypted", "a.xlsx",
    raw(bytes.fromhex("d0cf11e0a1b11ae1") + bytes(600))), ("bomb", "a.h5", hdf_bomb),
    ("of 1e15 numbers", "a.npy", partial(header, shape=(10**15,))),
    ("of 1e300 numbers", "a.npy", partial(header, shape=(10**150, 10**150))),
    ("of a negative shape", "a.npy", partial(header, shape=(-5,))), ("of 40 dimensions", "a.npy",
    partial(header, shape=(1,) * 40)), ("of no numbers", "a.npy", partial(header, shape=(0,))),
    ("of words", "a.npy", partial(header, descr="<U2")), ("of times", "a.npy", partial(header, descr="<M8[s]")),
    ("of complex numbers", "a.npy", partial(header, descr="<c16", shape=(4,))), ("of objects", "a.npy", objects),
    ("of an unknown type", "a.npy", raw(b"\x93NUMPY\1\0\x46\0{'descr': '<q9', 'fortran_order': False, 'shape': (3,)}".ljust(90) + b"\n")),
    ("of version 9", "a.npy", raw(b"\x93NUMPY\x09\0" + bytes(200))),
    ("of brackets", "a.npy", raw(b"\x93NUMPY\1\0\xff\xff" + b"(" * 65535)),
    ("of words", "a.npz", arrays(x=np.array(["a", "b"]))), ("of nothing", "a.npz", arrays()),
    ("of one number", "a.npz", arrays(x=1.0)), ("of a rate of 1e-308", "a.npz", arrays(x=Y, fs=1e-308)),
    ("of a rate of 1e308", "a.npz", arrays(x=Y, fs=1e308)), ("of a negative rate", "a.npz", arrays(x=Y, fs=-5.0)),
    ("of a rate of nan", "a.npz", arrays(x=Y, fs=np.nan)), ("of values of nan", "a.npz", arrays(t=T, x=Y * np.nan)),
    ("of values of 1e308", "a.npz", arrays(t=T, x=Y * 1e308 * 3)), ("of unlike lengths", "a.npz", arrays(t=T[:50], x=Y)),
    ("of a rate of 0", "a.wav", partial(wav_head, rate=0)), ("of no channels", "a.wav", partial(wav_head, channels=0)),
    ("of 65,535 channels", "a.wav", partial(wav_head, channels=65535)), ("of 7 bits", "a.wav", partial(wav_head, bits=7)),
    ("of 0 bits", "a.wav", partial(wav_head, bits=0)),
    ("of a word", "a.json", as_json('"a"')), ("of a number", "a.json", as_json("1")), ("of null", "a.json", as_json("null")),
    ("of an empty object", "a.json", as_json({})), ("of an empty list", "a.json", as_json([])),
    ("of 100,000 levels", "a.json", as_json("[" * 10**5 + "]" * 10**5)), ("of 100,000 objects", "a.json", as_json('{"a":' * 10**5)),
    ("of 5,000 digits", "a.json", as_json('{"time": [' + "9" * 5000 + ",1]}")),
    ("of 400 digits", "a.json", as_json({"time": [10**400 + i for i in range(200)], "angle": Y.tolist()})),
    ("of nan", "a.json", as_json({**_STEM, "angle": [float("nan")] * 200})), ("of words", "a.json", as_json({"a": ["x"] * 200})),
    ("of unlike lengths", "a.json", as_json({**_STEM, "angle": [1, 2]})), ("of mixed cells", "a.json", as_json({**_STEM, "angle": [1, "x"] * 100})),
    ("of lists in lists", "a.json", as_json([[[1, 2], [3]], [[4]]])), ("of true and false", "a.json", as_json({**_STEM, "angle": [True, False] * 100})),
    ("cut off", "a.json", as_json('{"time": [1, 2')), ("of half a letter", "a.json", raw(b'{"time": ["\xff\xfe')),
    ("of a lone surrogate", "a.json", as_json('{"\\ud800": [1,2,3]}')),
    ("of a claimed element", "a.mat", raw(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM\x0f\0\0\0\xff\xff\xff\x7f")),
    ("of version 4", "a.mat", raw(struct.pack("<5i", 0, 10**6, 10**6, 0, 2) + b"x\0" + bytes(64))),
    ("of text", "a.mat", raw(b"t = [1 2 3];\n")), ("of another format", "a.png", raw(b"\x89PNG\r\n\x1a\n" + bytes(500))),
    ("of a programme", "a.exe", raw(b"MZ" + bytes(range(256)) * 8)), ("of gzip", "a.csv.gz", raw(b"\x1f\x8b\x08" + bytes(range(200)))),
    ("of PDF", "a.pdf", raw(b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n" + bytes(range(256)) * 9)),
    ("of a link to elsewhere", "a.tdms", raw(b"TDSm" + b"\xff" * 60)), ("not there", "a.npz", nothing),
)  # fmt: skip

VERSIONS = [
    Case(
        f"{form} of version {version} of zip named .{ending}",
        ("look", "FILE"),
        f"a.{ending}",
        partial(of_version, form=form, version=version),
        said,
        ends=(ends,),
    )
    for form in ("xlsx", "npz")
    for version, ending, said, ends in (
        (255, form, "damaged or cut off", REFUSED),
        (255, "dat", "", REFUSED),
        (45, form, "", READ),
    )
]

_T, _Y = json.dumps(T.tolist()), json.dumps(Y.tolist())
TWICE = [
    Case(f"json of {what}", ("look", "FILE"), "a.json", as_json(content), said, ends=(ends,))
    for what, content, said, ends in (
        ("one name in two objects", f'{{"a": {{"t": {_T}, "y": {_Y}}}, "t": "x"}}', "", READ),
    )
]  # fmt: skip

CASES = [
    *DAMAGED,
    *TWICE,
    *VERSIONS,
    *(Case(f"{Path(file).suffix[1:]} {what}", ("look", "FILE"), file, write) for what, file, write in MADE),
]
