"""Tables of oscilloscopes that no general rule reads, turned into plain ones.

Tektronix TDS writes its settings beside the first samples; Rigol numbers the samples and says start and increment in
the head.
"""

from __future__ import annotations

from bayesdamp.provenance import Fact
from bayesdamp.records.files.facts import kept
from bayesdamp.records.files.table import number, split

DEEP = 64
"""Lines that the settings take at most."""


def plain(lines: list[str]) -> tuple[list[str], dict[str, Fact]] | None:
    """Return the lines as a plain table with one line of names, and the settings; None where neither wrote them.

    The lines are those that were given one by one, but for a line of names before them where there was none.
    """
    head = [split(line, ",") for line in lines[:DEEP]]
    if len(head) < 3:
        return None
    if head[0][0] == "X" and head[1][0] == "Sequence" and "Start" in head[0]:
        return _numbered(lines, head)
    names = [row[0] for row in head]
    if (
        "Record Length" in names
        and "Sample Interval" in names
        and all(map(_number, head[0][3:5]))
        and head[0][4:]
    ):
        facts = {row[0]: " ".join(filter(None, row[1:3])) for row in head if row[0]}
        across, along = facts.get("Vertical Units", ""), facts.get("Horizontal Units", "s")
        title = f"{_titled('Time', along)},{_titled(facts.get('Source', 'CH1'), across)}"
        return [title, *(",".join(split(line, ",")[3:5]) for line in lines)], kept(facts)
    return None


def _number(cell: str) -> bool:
    return number(cell, ".") is not None


def _titled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _numbered(lines: list[str], head: list[list[str]]) -> tuple[list[str], dict[str, Fact]] | None:
    """Return the table with times in place of the numbers of samples."""
    start, step = head[0].index("Start"), head[0].index("Start") + 1
    values = head[1]
    if len(values) <= step or not (_number(values[start]) and _number(values[step])):
        return None
    first, each = float(values[start]), float(values[step])
    names = [_titled(name, unit) for name, unit in zip(head[0][1:start], values[1:start], strict=True)]
    rows = []
    for line in lines[2:]:
        cells = split(line, ",")
        at = number(cells[0], ".") if cells else None
        rows.append("" if at is None else ",".join([repr(first + each * at), *cells[1:start]]))
    return ["", ",".join(["Time (s)", *names]), *rows], kept({"Start": first, "Increment": each})
