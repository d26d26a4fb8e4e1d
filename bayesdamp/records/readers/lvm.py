"""LabVIEW measurement files, which are text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.records.files.facts import kept
from bayesdamp.records.files.table import number
from bayesdamp.records.readers.text import column_of, text_of
from bayesdamp.types import InputError

_MARK = "LabVIEW Measurement"
_END = "***End_of_Header***"
_SPECIAL = ("***Start_Special***", "***End_Special***")
_OF_SEGMENTS = {
    "Channels", "Samples", "Date", "Time", "Notes", "Test_Name", "Test_Numbers", "Test_Series", "UUT_M/N", "UUT_Name",
    "UUT_S/N", "Model_Number", "Serial_Number", "X_Dimension", "X_Unit_Label", "X0", "Delta_X",
    "Y_Dimension", "Y_Unit_Label",
}  # fmt: skip
"""Tags of a segment's header."""


@dataclass
class _Segment:
    """What a segment holds: tags with a value for each channel, names of columns, rows of cells."""

    tags: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


class LvmReader(Reader):
    """LabVIEW measurement files.

    References
    ----------
    National Instruments, Specification for the LabVIEW Measurement File (.lvm), 2.0.
    """

    format = "a LabVIEW measurement file"
    extensions = (".lvm",)

    def claims(self, head: bytes, path: Path) -> bool:
        """The header's first words."""
        return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(_MARK.encode())

    def read(self, path: Path) -> Contents:
        """Channels of all segments. Raises InputError for a text that is too large or has no rows."""
        said, segments = _parsed(text_of(path).splitlines())
        if not segments:
            raise InputError("has no rows of numbers behind its header; export the record again")
        axes, decimal = said.get("X_Columns", "One"), said.get("Decimal_Separator", ".")
        columns: list[Column] = []
        for i, segment in enumerate(segments, start=1):
            columns += _columns(segment, said, axes, decimal, str(i) if len(segments) > 1 else "")
        return Contents("LVM", tuple(columns), kept(said), channels=True)


def _parsed(lines: Sequence[str]) -> tuple[dict[str, str], list[_Segment]]:
    """(the file's tags, the segments that have rows)."""
    separator = next((line[len("Separator") :][:1] for line in lines if line.startswith("Separator")), "\t")
    said: dict[str, str] = {}
    segments = [_Segment()]
    ended = False
    for cells in _cells(lines, separator):
        tag, now, decimal = cells[0], segments[-1], said.get("Decimal_Separator", ".")
        if tag == _END:
            ended = True
        elif not ended:
            said[tag] = cells[1] if len(cells) > 1 else ""
        elif tag in _OF_SEGMENTS:
            if now.rows:
                now = _Segment()
                segments.append(now)
            now.tags[tag] = cells[1:]
        elif tag == "X_Value" or not (now.rows or any(number(cell, decimal) is not None for cell in cells)):
            now.names = cells
        else:
            now.rows.append(cells)
    return said, [segment for segment in segments if segment.rows]


def _cells(lines: Sequence[str], separator: str) -> Iterator[list[str]]:
    """The cells of lines that have any, without special blocks."""
    special = False
    for line in lines:
        cells = [cell.strip() for cell in line.split(separator)]
        special = cells[0] == _SPECIAL[0] or (special and cells[0] != _SPECIAL[1])
        if any(cells) and not special and cells[0] != _SPECIAL[1]:
            yield cells


def _columns(segment: _Segment, said: Mapping[str, str], axes: str, decimal: str, run: str) -> list[Column]:
    """A segment's columns: times where it has them, else each channel's own rate."""
    width = max(map(len, segment.rows))
    timeless = axes == "No" and any(row[0] for row in segment.rows)  # not even an empty column of times
    names = segment.names or [""] * width
    names = names[1:] if names[0] == "X_Value" and timeless else names
    names = names if names[0] == "X_Value" or timeless else ["X_Value", *names]
    names = names[: names.index("Comment")] if "Comment" in names else names
    prefix = f"{run}." if run else ""
    found: list[Column] = []
    timed: set[int] = set()
    channel = axis = 0
    for i, name in enumerate(names):
        column = column_of(segment.rows, i, decimal, name, f"{run}/{axis}")
        blank = not np.isfinite(column.values).any() and not column.words
        if name == "X_Value":
            axis += 1
        if blank:
            continue
        if name == "X_Value":
            timed.add(axis)
            name = f"{prefix}X_Value" + (f" {axis}" if axes == "Multi" else "")
            found.append(replace(column, name=name, group=f"{run}/{axis}", run=run, unit="s"))
            continue
        step, start = (_number(segment, said, tag, channel, decimal) for tag in ("Delta_X", "X0"))
        found.append(
            replace(
                column,
                name=f"{prefix}{name or f'channel {channel + 1}'}",
                run=run,
                unit=_of_channel(segment.tags.get("Y_Unit_Label", []), channel),
                rate=1 / step if step > 0 and axis not in timed else None,
                start=start,
            )
        )
        channel += 1
    return found


def _of_channel(cells: Sequence[str], channel: int) -> str:
    """What a tag says of a channel; tags have cells for columns of times too, which are empty."""
    filled = [cell for cell in cells if cell]
    return filled[channel] if channel < len(filled) else ""


def _number(segment: _Segment, said: Mapping[str, str], tag: str, channel: int, decimal: str) -> float:
    """A tag's number for a channel, of the file where the segment has none, else 0."""
    value = number(_of_channel(segment.tags.get(tag, []), channel) or said.get(tag, ""), decimal)
    return value if value is not None and np.isfinite(value) else 0.0


PLUGIN = LvmReader()
