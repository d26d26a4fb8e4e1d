"""Text tables without a record, or with a record from which nothing can be computed."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from tests.bad_input.binaries import FORMATS
from tests.bad_input.case import READ, REFUSED, Case, T, Y, raw, rows, text

LOOK = ("look", "FILE", "--time", "1", "--angle", "2")

NOT_NUMBERS = {
    "a word": "abc", "not a number": "nan", "minus infinite": "-Infinity", "a long word": "x" * 100000,
    "an exponent of digits": "1e" + "9" * 300, "5,000 digits": "9" * 5000, "an escape": "\x1b[31m",
    "an impossible date": "2024-13-01T00:00:00", "an impossible time zone": "2024-01-01T00:00:00+99:99",
}  # fmt: skip
"""Cells without a number."""


def one_value(path: Path, cell: str) -> None:
    rows(path, y=lambda i: cell if i == 100 else Y[i])


def all_times(path: Path, cell: str) -> None:
    rows(path, t=lambda _: cell)


CELLS = [
    Case(f"{name} in {where}", LOOK, write=partial(write, cell=cell), line=line)
    for name, cell in NOT_NUMBERS.items()
    for where, write, line in (("a value", one_value, "a.csv: line 102: "), ("all times", all_times, ""))
]
"""One bad value is reported with its line; a column of bad times is not read as times."""

MARKS = [
    Case("missing values marked by nines", LOOK, write=partial(rows, y=lambda i: -9999 if i % 50 == 7 else Y[i]),
         line="4 values are -9999, far from all others"),
    Case("a single outlier of nines", LOOK, write=partial(rows, y=lambda i: -9999 if i == 7 else Y[i]),
         statuses=(READ,)),
    Case("an empty cell in place of a sample", LOOK, write=partial(one_value, cell=""), statuses=(READ,)),
    Case("a study as a record", ("compare", "FILE"), "a.toml", text("[system]"), line="bayesdamp study"),
    Case("quick and exact", ("compare", "FILE", "--quick", "--exact"), write=rows, line="only one of them"),
]  # fmt: skip

_LINES = [f"{t},{y}" for t, y in zip(T, Y)]
TEXTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (raw(b""), "is empty"),
    "zeros": (raw(bytes(5000)), "nothing but blanks"),
    "a head": (text("time,angle\n"), ""),
    "an open quote": (text('time,angle\n"' + "\n".join(_LINES)), ""),
    "a letter": (text("Dear Sir or Madam,\nthank you for the pendulum.\n" * 30), ""),
    "random bytes": (raw(np.random.default_rng(27).bytes(5000)), ""),
    "values of 1e308": (partial(rows, y=lambda i: 1e308 * np.cos(i)), "not a measurement"),
    "values of 1e-300": (partial(rows, y=lambda i: 1e-300 * np.cos(i)), "too little"),
    "times of 1e100": (partial(rows, t=lambda i: 1e100 * i), "right column"),
    "times of 1e-300": (partial(rows, t=lambda i: 1e-300 * i), "no instrument resolves"),
    "a constant": (partial(rows, y=lambda i: 2.5), "constant"),
    "times that stand still": (partial(rows, t=lambda i: 1.0), ""),
    "times that go back": (partial(rows, t=lambda i: -T[i]), ""),
    "200 columns": (text("\n".join(",".join(str(np.cos(i * k)) for k in range(200)) for i in range(12))), ""),
}  # fmt: skip

SHOWN = ("an open quote", "times that stand still", "times that go back")
"""Tables of numbers: `look` shows them and says why they have no free decay."""

WRONG = [
    Case(name, ("compare", "FILE", "--quick", "--workers", "1"), write=write, line=line)
    for name, (write, line) in TEXTS.items()
    if name != "an open quote"  # all but its first cell is read, and rightly analysed
] + [
    Case(f"{name}, columns named", ("look", "FILE", "--time", "time", "--angle", "angle"), write=TEXTS[name][0],
         statuses=(REFUSED, READ))
    for name in SHOWN
]  # fmt: skip

NAMES = [
    Case(f"a table named a.{form}", ("look", "FILE"), f"a.{form}", rows, statuses=(READ, REFUSED))
    for form in FORMATS
]

CASES = [*CELLS, *MARKS, *WRONG, *NAMES]
