"""What oscilloscopes write around a table of samples, turned into a plain header.

Tektronix puts its settings beside the first samples (TDS) or above them (DPO, MSO), as Siglent does; Rigol numbers the
samples and says start and increment in the head; LeCroy names the trace alone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from bayesdamp.provenance import Fact
from bayesdamp.records.files.facts import kept
from bayesdamp.records.files.table import number, split

_SETTINGS = re.compile(
    r"record length|sample interval|trigger point|point format|pt fmt|waveform type|zero index|"
    r"(vertical|horizontal) (units|scale|offset|position|delay)|probe atten(uation)?|y ?zero|gating",
    re.IGNORECASE,
)
LEAST = 3
"""Settings that an instrument's head has."""
DEEP = 64
"""Lines that a head takes at most."""
_CHANNEL = re.compile(r"^(CH\d+|MATH\d*|REF\d*)\(?(V|mV|A)\)?$")
"""`CH1V`: a channel of Rigol's with its unit."""


def plain(lines: list[str]) -> tuple[list[str], dict[str, Fact]] | None:
    """(the lines as a plain table with one line of names, the settings); None where no oscilloscope wrote them. The
    lines are those that were given one by one, but for a line of names before them where there was none."""
    head = [split(line, ",") if "," in line else [line.strip()] for line in lines[:DEEP]]
    if len(head) < LEAST:
        return None
    if head[0][0] == "X" and head[1][0] == "Sequence" and "Start" in head[0]:
        return _numbered(lines, head)
    if head[0][0].upper().startswith("LECROY"):
        return _named(lines, head, {"Vertical Units": ["V"]})
    if _CHANNEL.match(head[0][1] if len(head[0]) > 1 else "") and head[0][0].lower().startswith("time"):
        return _named(lines, head, {})
    settings = {row[0]: row[1:] for row in head if _SETTINGS.fullmatch(row[0])}
    if len(settings) < LEAST:
        return None
    if len(head[0]) >= 5 and all(_number(cell) for cell in head[0][3:5]):
        return _beside(lines, head)
    return _named(lines, head, settings)


def _number(cell: str) -> bool:
    return number(cell, ".") is not None


def _unit(cells: Sequence[str]) -> str:
    """The unit of the first of some cells: `V`, or `CH1:V` as Siglent writes it."""
    return next((cell.rpartition(":")[2].strip() for cell in cells if cell.strip()), "")


def _titled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _numbered(lines: list[str], head: list[list[str]]) -> tuple[list[str], dict[str, Fact]] | None:
    """Rigol's numbers of samples, as times."""
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


def _beside(lines: list[str], head: list[list[str]]) -> tuple[list[str], dict[str, Fact]]:
    """Tektronix TDS: the settings stand in the first columns, the samples in the next two."""
    facts = {row[0]: " ".join(filter(None, row[1:3])) for row in head if row[0]}
    across, along = facts.get("Vertical Units", ""), facts.get("Horizontal Units", "s")
    names = f"{_titled('Time', along)},{_titled(facts.get('Source', 'CH1'), across)}"
    return [names, *(",".join(split(line, ",")[3:5]) for line in lines)], kept(facts)


def _named(
    lines: list[str], head: list[list[str]], settings: dict[str, list[str]]
) -> tuple[list[str], dict[str, Fact]] | None:
    """A head above the table, its last line the names: each with its unit, where the settings say it."""
    good = [len(row) > 1 and _number(row[0]) and any(map(_number, row[1:])) for row in head]
    first = next((i for i in range(1, len(good) - 1) if good[i] and good[i + 1]), None)
    if first is None:
        return None
    above = [row for row in head[:first] if any(row)]
    names = above[-1] if above and not _SETTINGS.fullmatch(above[-1][0]) else []
    width = max(len(head[first]), len(names))
    names = [*names, *[""] * (width - len(names))]
    units = next((cells for name, cells in settings.items() if name.lower() == "vertical units"), [])
    only = _unit(units) if sum(bool(cell.strip()) for cell in units) == 1 else ""
    titles = []
    for i, name in enumerate(names):
        own = _CHANNEL.match(name)
        if own:
            titles.append(_titled(own[1], own[2]))
        elif i == 0:
            titles.append("Time (s)" if re.fullmatch(r"(time|second|s|)", name, re.IGNORECASE) else name)
        elif re.fullmatch(r"volt|ampere?|amp", name, re.IGNORECASE):
            titles.append(f"CH{i} ({name})")
        else:
            unit = _unit(units[i - 1 : i]) or only
            titles.append(_titled(name or f"CH{i}", unit) if "(" not in name and (name or unit) else name)
    while titles and not any(
        len(row) >= len(titles) and row[len(titles) - 1] for row in head[first : first + 8]
    ):
        titles.pop()  # a comma at the end of each line
    facts = {
        row[0]: " ".join(filter(None, row[1:])) for row in above if row[0] and len(row) > 1 and row != names
    }
    rows = [",".join(split(line, ",")[: len(titles)]) for line in lines[first:]]
    return [*[""] * (first - 1), ",".join(titles), *rows], kept(facts)
