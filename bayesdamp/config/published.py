"""Figures published elsewhere, for the report to set beside ours."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bayesdamp.config.checks import StudyError, shown
from bayesdamp.plain_text import read_plain
from bayesdamp.plugins import nearest
from bayesdamp.types import InputError

COLUMNS = ("estimator", "signal", "error_pct", "time")


@dataclass(frozen=True)
class Published:
    """One published figure, as printed: an estimator's error on a signal (per cent) and its time."""

    estimator: str
    signal: str
    error_pct: str
    time: str = ""


def read_published(path: Path, signals: Iterable[str], estimators: Iterable[str]) -> tuple[Published, ...]:
    """The rows of a CSV file with the columns of `COLUMNS`. Raises StudyError."""
    try:
        reader = csv.DictReader(io.StringIO(read_plain(path, "a CSV file"), newline=""))
        missing = [c for c in COLUMNS if c not in (reader.fieldnames or ())]
        rows = list(reader)
    except (InputError, csv.Error) as error:
        raise StudyError("published", f"is {shown(path.name)}, which cannot be read ({error})") from None
    if missing:
        what = f"is {path.name!r}, which has no column {missing[0]}"
        raise StudyError("published", f"{what}; its columns must be {', '.join(COLUMNS)}")
    known = {"signal": list(signals), "estimator": list(estimators)}
    for line, row in enumerate(rows, start=2):
        for column, names in known.items():
            if row[column] not in names:
                what = f"line {line} of {path.name}: unknown {column} {shown(row[column])}"
                raise StudyError("published", f"{what}{nearest(str(row[column]), names)}")
    return tuple(Published(*(row[c] or "" for c in COLUMNS)) for row in rows)
