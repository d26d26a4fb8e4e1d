"""Which columns of a file hold times and values, and in which unit, where the file says it."""

from __future__ import annotations

from pathlib import Path

from bayesdamp.records.read import read_record
from bayesdamp.units import UNITS

ColumnName = str | int


def choose_columns(
    path: Path, time: ColumnName | None, value: ColumnName | None, rate: float | None
) -> tuple[ColumnName | None, ColumnName | None]:
    """The columns of times (None where a rate stands in) and of values of a file's one record.

    What is given stays, the rest is chosen as `read_records` does. Raises InputError, one line that names the columns,
    where the choice is not plain.
    """
    if value is not None and (time is not None or rate is not None):
        return time, value
    found = read_record(path, time=time, value=value, rate=rate).columns
    return time if time is not None else found[0], value if value is not None else found[1]


def resolved_unit(unit: str | None, quantity: str | None, said: str, what: str) -> tuple[str, str]:
    """The unit and the quantity: those given, else those that a file says, else an angle in rad."""
    only = UNITS[unit].quantity if unit in UNITS else None
    chosen = unit or (said if said in UNITS else "rad")
    return chosen, quantity or only or what or "angle"
