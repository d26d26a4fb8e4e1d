"""Which columns of a record's file hold times and values, where that is plain."""

from __future__ import annotations

from pathlib import Path

from bayesdamp.signals.arrays import named_arrays
from bayesdamp.signals.named_units import quantity_of, unit_and_quantity
from bayesdamp.signals.table import Layout, find_layout
from bayesdamp.signals.text import decoded
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

Column = str | int
ARRAYS = (".mat", ".npy", ".npz")


def choose_columns(
    path: Path, time: Column | None, value: Column | None, rate: float | None
) -> tuple[Column | None, Column | None]:
    """The columns of times (None where a rate in Hz is given) and of values, by name or number from 1.

    What is given stays. Else a file of two columns has times in the first and values in the second. Raises InputError,
    one line that names the columns, where the choice is not plain.
    """
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder, not a file' if path.is_dir() else 'no such file'}")
    if time is not None and rate is not None:
        raise InputError(f"{path.name}: give either --time (a column) or --rate (in Hz), not both")
    if value is not None and (time is not None or rate is not None):
        return time, value
    names = _columns(path)
    wanted = 1 if rate is not None else 2
    listed = ", ".join(str(n) for n in names)
    if time is not None or value is not None:
        if len(names) == 2 and rate is None:
            given = time if time is not None else value
            at = [i for i, name in enumerate(names) if str(given) in (str(name), str(i + 1))]
            if len(at) == 1:
                other = names[1 - at[0]]
                return (time, other) if time is not None else (other, value)
        lacks = "--angle" if value is None else "--time or --rate"
        raise InputError(f"{path.name}: which column is the other? Give {lacks}; columns are {listed}")
    if len(names) != wanted:
        say = "--angle and --time (columns by name or number), or --angle and --rate (in Hz)"
        raise InputError(
            f"{path.name}: has {len(names)} column{'s' * (len(names) != 1)}: {listed}; give {say}"
        )
    return (None, names[0]) if rate is not None else (names[0], names[1])


def unit_asked(path: Path, value: Column | None, unit: str | None, quantity: str | None) -> tuple[str, str]:
    """The unit and the quantity of a record: as given, else as its column's name says, else an angle in rad.

    value: the column, by name or number from 1.
    """
    if unit is None or quantity is None:
        name = _named(path, value)
        said = unit_and_quantity(name) or ("rad", quantity_of(name) or "angle")
        only = UNITS[unit].quantity if unit in UNITS else None
        unit, quantity = unit or said[0], quantity or only or said[1]
    return unit, quantity


def _named(path: Path, value: Column | None) -> str:
    """What a column that is given by its name or number is named, with its unit; empty where it has no name."""
    given = str("" if value is None else value).strip()
    if not given or path.suffix.lower() in ARRAYS:
        return given
    layout = _layout(path)
    at = layout.names.index(given) if given in layout.names else int(given) - 1 if given.isdigit() else -1
    return layout.label(at) if 0 <= at < layout.columns else given


def _layout(path: Path) -> Layout:
    try:
        layout = find_layout(decoded(path.read_bytes(), path.name).splitlines())
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read ({error.strerror or error})") from None
    if layout is None:
        raise InputError(f"{path.name}: no rows of numbers were found; give a file with columns of numbers")
    return layout


def _columns(path: Path) -> list[Column]:
    """Names of a file's columns or arrays; the number from 1 where one has none or shares its name."""
    if path.suffix.lower() in ARRAYS:
        return list(named_arrays(path))
    names = list(_layout(path).names)
    return [n if n and names.count(n) == 1 else i for i, n in enumerate(names, start=1)]
