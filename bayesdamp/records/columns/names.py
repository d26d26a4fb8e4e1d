"""What the names of columns say: run, channel, unit, whether they are times, and which columns a user means."""

from __future__ import annotations

import re
from collections.abc import Sequence
from difflib import get_close_matches

from bayesdamp.records.files.contents import Column
from bayesdamp.records.files.named_units import (
    TIMES,
    quantity_of,
    seconds_in,
    seconds_written,
    unit_and_quantity,
    unit_written,
)
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

_WORD = r"(?:run|trial|take|test|rep|repeat|repetition|lauf|versuch|messung|durchgang|essai|prova|ensayo)"
_BEHIND = re.compile(
    rf"^(.+?)[\s,;:_-]*[(\[]?(?<![A-Za-z]){_WORD}\s*[#_:.-]?\s*(\d+)[)\]]?\s*$", re.IGNORECASE
)
_BEFORE = re.compile(rf"^{_WORD}\s*[#_.-]?\s*(\d+)\s*[:,;._\s-]\s*(.+)$", re.IGNORECASE)
_SECONDS = re.compile(r"^(elapsed[\s_]*)?seconds([\s_]*elapsed)?$", re.IGNORECASE)
_LATEST = re.compile(r"^(latest)\s*:\s*(.+)$", re.IGNORECASE)
"""How Vernier's Logger Pro marks the run that has no number yet."""
_ALONE = re.compile(rf"^{_WORD}?\s*[#_.-]?\s*(\d+)$", re.IGNORECASE)
_INDEX = re.compile(
    r"^(unnamed: 0|index|idx|sample|samples|no|nr|n|i|row|frame|frames|count|counter|#|id)$", re.I
)
_BRACKETS = re.compile(r"[(\[{]\s*([^()\[\]{}]{1,12})\s*[)\]}]\s*$")
MOST = 12
WIDTH = 110
"""Names that a line lists, and characters that they take."""


def parted(column: Column) -> tuple[str, str]:
    """(name without the mark of a run, the run's label), empty where the file says none."""
    name = column.name
    bare = name.removeprefix(f"{column.group}.") if column.group else name
    if column.run:
        bare = bare.removeprefix(f"{column.run}.")  # an element of a list that is a run each
    for pattern, run, rest in ((_BEHIND, 2, 1), (_BEFORE, 1, 2)):
        at = pattern.match(bare)
        if at is not None:
            return at[rest].strip(), column.run or str(int(at[run][:9]))
    latest = _LATEST.match(bare)
    if latest is not None:
        return latest[2].strip(), column.run or "latest"
    alone = _ALONE.match(column.group)
    if column.run or (alone and not column.group.isdigit()):
        return bare, column.run or str(int(alone[1][:9]) if alone else "")
    return name, ""


def seconds_of_unit(column: Column) -> float | None:
    """Seconds in the unit that a column of times says, in its name or beside it; None where it says none."""
    said = seconds_in(parted(column)[0]) or seconds_written(column.unit)
    return 1.0 if said is None and _SECONDS.match(column.name) else said


def unit_said(column: Column) -> tuple[str, str]:
    """Return the unit and the quantity of a column; each empty where the file does not say.

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


def names_time(column: Column) -> bool:
    """Whether a column's name or unit says that it holds times."""
    bare = re.sub(r"[(\[{].*?[)\]}]", "", parted(column)[0]).rpartition(".")[2].strip()
    return bool(TIMES.search(bare)) or column.clock or seconds_of_unit(column) is not None


def names_index(column: Column) -> bool:
    """Whether a column's name says that it counts the samples."""
    return bool(_INDEX.match(parted(column)[0].rpartition(".")[2].strip()))


def shown(columns: Sequence[Column], column: Column) -> str:
    """A column's name in quotes, or its number from 1 where it has none."""
    if column.name:
        return repr(column.name[:60])
    return str(next(i for i, c in enumerate(columns, start=1) if c is column))


def listed(columns: Sequence[Column]) -> str:
    """The names that a user may type."""
    if not any(column.name for column in columns):
        return f"1 to {len(columns)} (they have no names)" if len(columns) > 1 else "1 (it has no name)"
    names = [repr(c.name) if c.name else str(i) for i, c in enumerate(columns, start=1)]
    fit = next(
        (k for k in range(len(names)) if k == MOST or len(", ".join(names[: k + 1])) > WIDTH), len(names)
    )
    return ", ".join(names[:fit]) + (f" and {len(names) - fit} more" if len(names) > fit else "")


def asked_for(columns: Sequence[Column], asked: str | int) -> list[Column]:
    """The columns that a user means: the one of that name, or of that number from 1, or, of several runs, those of that
    name without the run and the unit. Raises InputError with the nearest name."""
    name = str(asked).strip()
    exact = [column for column in columns if name and column.name == name]
    if len(exact) == 1:
        return exact
    if exact:
        raise InputError(f"{len(exact)} columns are named {name!r}; give the column's number")
    if name.isdigit():
        if len(name) < 9 and 1 <= int(name) <= len(columns):
            return [columns[int(name) - 1]]
        raise InputError(f"there is no column {name[:20]}, the file has {len(columns)}")
    for form in _FORMS:
        found = [column for column in columns if column.name and form(column) == name.casefold()]
        if found and len({parted(column)[1] for column in found}) == len(found):
            return found
    valid = list(dict.fromkeys(column.name for column in columns if column.name))
    bare = [form for c in columns for form in (parted(c)[0], without_unit(parted(c)[0]))]
    close = get_close_matches(name, [*valid, *bare], n=1, cutoff=0.6)
    if close:
        raise InputError(f"unknown column {name[:60]!r}; did you mean {close[0]!r}?")
    what = f"valid are {', '.join(valid)}" if 0 < len(valid) <= MOST else f"columns are {listed(columns)}"
    raise InputError(f"unknown column {name[:60]!r}; {what}")


def without_unit(name: str) -> str:
    """A name without the unit in brackets at its end."""
    return re.sub(r"\s*[(\[{][^()\[\]{}]*[)\]}]\s*$", "", name).strip() or name


_FORMS = (
    lambda column: column.name.casefold(),
    lambda column: column.label.casefold(),
    lambda column: parted(column)[0].casefold(),
    lambda column: without_unit(parted(column)[0]).casefold(),
)


def runs_asked(text: str, labels: Sequence[str]) -> list[str]:
    """Return the labels that `1,3-5` means among those of a file. Raises InputError."""
    more = f" and {len(labels) - MOST} more" if len(labels) > MOST else ""
    choice = "there are " + (f"runs {', '.join(labels[:MOST])}{more}" if labels else "none to choose from")
    wanted: list[str] = []
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        at = re.fullmatch(r"(\d{1,6})(?:\s*-\s*(\d{1,6}))?", part)
        if part not in labels and (at is None or int(at[2] or at[1]) < int(at[1])):
            what = f"no runs {text[:40]!r}; give numbers such as 1,3-5; {choice}"
            raise InputError(what, arguments=["runs"])
        span = (
            [part]
            if part in labels or at is None
            else [
                label
                for label in labels
                if label.isdigit() and int(at[1]) <= int(label) <= int(at[2] or at[1])
            ]
        )
        if not span:
            raise InputError(f"no runs {text[:40]!r}; {choice}", arguments=["runs"])
        wanted += span
    if not wanted:
        raise InputError(f"runs {text[:40]!r} name none; {choice}", arguments=["runs"])
    return list(dict.fromkeys(wanted))
