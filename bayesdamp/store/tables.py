"""Columns of the tables of a run; write and read tables without loss of digits."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.store.files import write_bytes
from bayesdamp.types import InputError

TABLES: dict[str, tuple[str, ...]] = {
    "estimates.csv": (
        "signal", "repeat", "model", "restoring", "estimator", "stage", "parameter", "unit", "value", "stderr", "truth",
        "error_pct", "evaluations", "seconds", "outcome",
    ),
    "posteriors.csv": (
        "signal", "repeat", "model", "restoring", "sampler", "deviation", "parameter", "unit", "mean", "sd",
        "sd_noise", "sd_law", "median", "q2.5", "q25", "q75", "q97.5", "hdi_low", "hdi_high", "ess_bulk", "ess_tail",
        "rhat", "divergences", "seconds", "outcome",
    ),
    "evidence.csv": (
        "signal", "repeat", "model", "restoring", "method", "deviation", "log_evidence", "stderr", "log_bayes_factor",
        "probability", "diagnostic", "outcome",
    ),
    "fits.csv": (
        "signal", "repeat", "model", "restoring", "rms", "rms_unit", "residual_autocorrelation",
        "window_spread", "predictive_p", "deviation", "deviation_low", "deviation_high", "unexplained_pct", "verdict",
    ),
}  # fmt: skip
"""Columns of the tables of every study, by file name. All intervals are 95 %; log_evidence and its stderr are in nats,
error_pct and unexplained_pct in per cent, seconds in s, and parameters in the column `unit`."""

POPULATION = (
    "model", "restoring", "parameter", "unit", "specimens", "mean", "mean_low", "mean_high", "spread", "spread_low",
    "spread_high", "next_low", "next_high",
)  # fmt: skip
"""Columns of population.csv, which a study with several specimens has."""
DAMPING_CURVES = ("amplitude", "ratio", "ratio_low", "ratio_high", "lost", "lost_low", "lost_high")
"""Columns of damping_curves.csv after the record's name and the unit of the amplitude: amplitude, damping ratio and
energy lost in a cycle per unit of inertia (square of the amplitude's unit per s²), measured without a damping law, with
95 % intervals. The array of a column in an answer has the name `free/COLUMN`."""

CALIBRATION_TABLES = ("calibration.csv", "ranks.csv", "recovery.csv")
"""Names of the tables of a calibration."""

_TEXT = frozenset({
    "signal", "model", "estimator", "stage", "parameter", "unit", "outcome", "sampler", "restoring", "method",
    "diagnostic", "rms_unit", "verdict",
})  # fmt: skip
_WHOLE = frozenset({"repeat", "evaluations", "divergences", "specimens"})
_NUMBER = {c for columns in (*TABLES.values(), POPULATION) for c in columns} - _TEXT - _WHOLE
TEXT_COLUMNS = frozenset({("posteriors.csv", "deviation"), ("evidence.csv", "deviation")})
"""Pairs (table, column) of columns that contain text, although a column of the same name contains numbers in another
table."""


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]]) -> None:
    """Write a CSV file in one step. Floats read back exactly; nan, None and missing keys become empty fields.

    Raises ValueError if a row has a key that is not a column.
    """

    def field(value: object) -> str:
        value = value.item() if isinstance(value, np.generic) else value
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return ""
        return repr(float(value)) if isinstance(value, float) else str(value)

    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({column: field(value) for column, value in row.items()} for row in rows)
    write_bytes(path, buffer.getvalue().encode())


def read_table(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a table that `write_table` wrote.

    Columns of `TABLES` and `POPULATION` contain text, whole numbers (None if empty) or floats (nan if empty);
    other columns are text. Raises InputError if a field in a column of numbers is not a number.
    """
    path = Path(path)

    def convert(line: int, column: str, text: str) -> object:
        try:
            if column in _WHOLE:
                return int(text) if text else None
            if column in _NUMBER and (path.name, column) not in TEXT_COLUMNS:
                return float(text) if text else math.nan
        except ValueError:
            raise InputError(f"{path.name}, line {line}, column {column}: {text!r} is not a number") from None
        return text

    with path.open(newline="", encoding="utf-8") as handle:
        reader = csv.DictReader(handle)
        return [
            {c: convert(reader.line_num, c, text or "") for c, text in row.items() if c} for row in reader
        ]
