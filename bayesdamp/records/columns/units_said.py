"""The unit and the quantity of a column, as its file says them."""

from __future__ import annotations

import re

from bayesdamp.records.columns.names import parted
from bayesdamp.records.files.contents import Column
from bayesdamp.records.files.named_units import quantity_of, unit_and_quantity, unit_written
from bayesdamp.units import UNITS

_BRACKETS = re.compile(r"[(\[{]\s*([^()\[\]{}]{1,12})\s*[)\]}]\s*$")


def unit_said(column: Column) -> tuple[str, str]:
    """(unit, quantity) of a column; each empty where the file does not say.

    The unit is a name in UNITS, that of the displacement itself; one that is in none is given as it is written.
    """
    name = parted(column)[0]
    named = quantity_of(name) or column.quantity
    if column.unit:
        written = unit_written(column.unit.strip("()[]"))
        if written is None:
            return (column.unit if len(column.unit) < 20 else ""), named
        unit, quantity = written
        return unit, (quantity if UNITS[unit].quantity or quantity != "angle" else named or quantity)
    said = unit_and_quantity(name)
    if said is not None:
        return said
    behind = _BRACKETS.search(name)
    return (behind[1].strip() if behind and not behind[1].strip().isdigit() else ""), named
