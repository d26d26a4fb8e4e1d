"""Text tables that hold no record, or one that nothing can be computed from."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.bad_input.case import READ, REFUSED, Case, T, Y, raw, rows, text

LOOK = ("look", "FILE", "--time", "1", "--angle", "2")

NO_NUMBERS = {
    "a word": "abc", "not a number": "nan", "minus nan": "-nan", "infinite": "inf", "minus infinite": "-Infinity",
    "a hexadecimal": "0x10", "two signs": "--5", "half an exponent": "1e", "two points": "1.2.3", "a formula": "=A1+1",
    "an error of a sheet": "#REF!", "no value of a sheet": "#N/A", "an exponent too large": "1e400",
    "an exponent of digits": "1e" + "9" * 300, "5,000 digits": "9" * 5000, "a minus and 5,000 digits": "-" + "9" * 5000,
    "a picture sign": "\U0001f600", "a time that is none": "99:99", "a percentage": "5%",
    "a fraction": "1/2", "a complex number": "1+2j", "an escape": "\x1b[31m", "a bracket": "[1", "true": "true",
    "a long word": "x" * 100000, "a date that is none": "2024-13-01T00:00:00", "no day": "2023-02-29T00:00:00",
    "a zone that is none": "2024-01-01T00:00:00+99:99", "a time of 60 min": "10:60:00",
}  # fmt: skip
"""Cells that hold no number."""


def one_cell(path: Path, cell: str, column: int) -> None:
    rows(
        path,
        t=lambda i: cell if (i, column) == (100, 0) else T[i],
        y=lambda i: cell if (i, column) == (100, 1) else Y[i],
    )


def all_cells(path: Path, cell: str, column: int) -> None:
    rows(path, t=lambda i: cell if column == 0 else T[i], y=lambda i: cell if column == 1 else Y[i])


def scaled(path: Path, column: int, factor: float) -> None:
    size = (factor, 1.0) if column == 0 else (1.0, factor)
    rows(path, t=lambda i: repr(float(T[i] * size[0])), y=lambda i: repr(float(Y[i] * size[1])))


CELLS = [
    Case(f"{name} in {many} of column {column + 1}", LOOK, write=partial(make, cell=cell, column=column))
    for name, cell in NO_NUMBERS.items()
    for many, make, column in (("a cell", one_cell, 1), ("all cells", all_cells, 0))
]
"""One bad cell is reported with its line; a column of them is not taken for times."""

SIZES = [
    Case(f"values times {factor:g}", LOOK, write=partial(scaled, column=1, factor=factor))
    for factor in (1e308, 1e300, 1e200, 1e-300, 5e-324, 0.0)
] + [
    Case(f"times times {factor:g}", LOOK, write=partial(scaled, column=0, factor=factor))
    for factor in (1e300, 1e100, 1e20, 1e-300, 1e-100)
]  # fmt: skip

_LINES = [f"{t},{y}" for t, y in zip(T, Y)]
TEXTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (raw(b""), "is empty"),
    "a mark of UTF-8 alone": (raw(b"\xef\xbb\xbf"), "nothing but blanks"),
    "a mark of UTF-16 alone": (raw(b"\xff\xfe"), ""),
    "half a letter of UTF-16": (raw(b"\xff\xfea"), ""),
    "newlines": (raw(b"\n" * 5000), "nothing but blanks"),
    "returns": (raw(b"\r" * 5000), "nothing but blanks"),
    "blanks": (raw(b" \t" * 5000), "nothing but blanks"),
    "zeros": (raw(bytes(5000)), "nothing but blanks"),
    "zeros after a head": (raw(b"time,angle\n" + bytes(5000)), ""),
    "a head": (text("time,angle\n"), ""),
    "a head and units": (text("time,angle\ns,rad\n"), ""),
    "one number": (text("1"), ""),
    "one row": (text("1,2"), ""),
    "two rows": (text("1,2\n2,3"), ""),
    "separators": (text(",,,,\n" * 300), ""),
    "quotes": (text('"\n' * 300), ""),
    "an open quote": (text('time,angle\n"' + "\n".join(_LINES)), ""),
    "quoted words": (text('"a","b"\n' * 300), ""),
    "a letter": (text("Dear Sir or Madam,\nthank you for the pendulum.\n" * 30), ""),
    "a page": (text("<!doctype html><html><body>404</body></html>\n" * 30), ""),
    "a programme": (text("import os\nos.remove('x')\n" * 30), ""),
    "a pointer to a large file": (text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n"), ""),
    "one long line": (text("1," * 20000), ""),
    "one long word": (text("x" * 10**6), ""),
    "one long number": (text("9" * 10**6), ""),
    "brackets": (text("[" * 10**5), ""),
    "random bytes": (raw(np.random.default_rng(27).bytes(5000)), ""),
    "controls": (raw(bytes(range(1, 32)) * 200), ""),
    "Latin-1 words": (raw("Zeit;Größe;äöü\n".encode("latin-1") * 200), ""),
    "3 samples": (partial(rows, n=3), ""),
    "7 samples": (partial(rows, n=7), ""),
    "a constant": (partial(rows, y=lambda i: 2.5), "constant"),
    "times that stand still": (partial(rows, t=lambda i: 1.0), ""),
    "times that go back": (partial(rows, t=lambda i: -T[i]), ""),
    "times at random": (partial(rows, t=lambda i: float(np.sin(17.0 * i))), ""),
    "empty cells": (partial(rows, y=lambda i: ""), ""),
    "empty times": (partial(rows, t=lambda i: ""), ""),
    "200 columns": (text("\n".join(",".join(str(np.cos(i * k)) for k in range(200)) for i in range(12))), ""),
}  # fmt: skip

SHOWN = ("an open quote", "times that stand still", "times that go back", "times at random")
"""Tables of numbers: `look` shows them, and says why there is no free decay."""

WRONG = [
    Case(
        f"{name}, {how}",
        arguments,
        write=write,
        said=said if how == "as it is" else "",
        ends=(REFUSED, READ) if name in SHOWN and how != "as it is" else (REFUSED,),
    )
    for name, (write, said) in TEXTS.items()
    for how, arguments in (
        ("as it is", ("compare", "FILE", "--quick", "--workers", "1")),
        ("columns named", (LOOK[0], "FILE", "--time", "time", "--angle", "angle")),
    )
    if (name in SHOWN or how == "as it is")
    and (name, how) != ("an open quote", "as it is")  # all but its first cell is read, and rightly analysed
]

NAMES = [
    Case(f"a table named {file}", ("look", "FILE"), file, partial(rows), ends=(READ, REFUSED))
    for file in (
        "a.npz",
        "a.npy",
        "a.mat",
        "a.h5",
        "a.wav",
        "a.uff",
        "a.tdms",
        "a.xlsx",
        "a.json",
        "a.parquet",
        "a.lvm",
    )
]

NO_SAMPLE = ("NA", "N/A", "NaN", "nan", "null", "-", "---", "n/a", "#N/A", "none", "oops", "x" * 100000)
MISSING = [
    *(
        Case(
            f"{cell[:20]} in place of a sample",
            LOOK,
            write=partial(one_cell, cell=cell, column=1),
            said="correct it or leave the row out",
        )
        for cell in NO_SAMPLE
    ),
    *(
        Case(
            f"{cell[:20]} and its line",
            LOOK,
            write=partial(one_cell, cell=cell, column=1),
            said="a.csv: line 102: ",
        )
        for cell in ("NA", "nan")
    ),
    Case(
        "an empty cell in place of a sample", LOOK, write=partial(one_cell, cell="", column=1), ends=(READ,)
    ),
]
"""What says that a sample is missing is refused alike, with what to do; an empty cell is left out."""

CASES = [*CELLS, *MISSING, *SIZES, *WRONG, *NAMES]
