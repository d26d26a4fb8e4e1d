"""Read LabVIEW measurement files (.lvm), which are text tables in one or several segments."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader, trim_facts
from bayesdamp.records.readers.text import make_column, parse_number, read_text
from bayesdamp.types import InputError

_MARK = "LabVIEW Measurement"
_END = "***End_of_Header***"
_SPECIAL = ("***Start_Special***", "***End_Special***")
_OF_SEGMENTS = {
    "Channels", "Samples", "Date", "Time", "Notes", "Test_Name", "Test_Numbers", "Test_Series", "UUT_M/N", "UUT_Name",
    "UUT_S/N", "Model_Number", "Serial_Number", "X_Dimension", "X_Unit_Label", "X0", "Delta_X",
    "Y_Dimension", "Y_Unit_Label",
}  # fmt: skip
"""Names of the tags (first cells of a line) in the header of a segment, which is one recording in the file."""


@dataclass
class _Segment:
    """A segment of the file, which is one recording: tags of its header, names of columns, and rows of cells.

    tags: for each name of a tag, the cells after it, one for each column. names: names of the columns. rows: cells of
    each row of numbers.
    """

    tags: dict[str, list[str]] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)

    def tag(self, name: str, channel: int) -> str:
        """Return the value of the tag `name` for a channel, an index from 0; "" if it has none.

        A tag's cells for columns of times are empty and are skipped, so that the remaining cells belong to the channels
        in order.
        """
        filled = [cell for cell in self.tags.get(name, ()) if cell]
        return filled[channel] if channel < len(filled) else ""


class LvmReader(Reader):
    """Reader of LabVIEW measurement files.

    References
    ----------
    National Instruments, Specification for the LabVIEW Measurement File (.lvm), 2.0.
    """

    format = "a LabVIEW measurement file"
    extensions = (".lvm",)

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes begin with the words "LabVIEW Measurement"; the path has no effect."""
        return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(_MARK.encode())

    def read(self, path: Path) -> Contents:
        """Return the times and channels of all segments.

        If there are several segments, each is a run, and the names of its columns begin with its number. Raises
        InputError if the file is too large or has no rows of numbers.
        """
        lines = read_text(path).splitlines()
        separators = (line[len("Separator") :][:1] for line in lines if line.startswith("Separator"))
        separator = next(separators, "\t")
        tags: dict[str, str] = {}
        segments = [_Segment()]
        ended = special = False
        for line in lines:
            cells = [cell.strip() for cell in line.split(separator)]
            tag, segment, decimal = cells[0], segments[-1], tags.get("Decimal_Separator", ".")
            special = tag == _SPECIAL[0] or (special and tag != _SPECIAL[1])
            if not any(cells) or special or tag == _SPECIAL[1]:
                continue
            if tag == _END:
                ended = True
            elif not ended:
                tags[tag] = cells[1] if len(cells) > 1 else ""
            elif tag in _OF_SEGMENTS:
                if segment.rows:
                    segment = _Segment()
                    segments.append(segment)
                segment.tags[tag] = cells[1:]
            elif tag == "X_Value" or not (
                segment.rows or any(parse_number(cell, decimal) is not None for cell in cells)
            ):
                segment.names = cells
            else:
                segment.rows.append(cells)
        segments = [segment for segment in segments if segment.rows]
        if not segments:
            raise InputError("has no rows of numbers after its header; export the record again")
        columns: list[Column] = []
        for i, segment in enumerate(segments, start=1):
            columns += _columns(segment, tags, str(i) if len(segments) > 1 else "")
        return Contents("LVM", tuple(columns), trim_facts(tags), channels=True)


def _columns(segment: _Segment, tags: dict[str, str], run: str) -> list[Column]:
    """Return the columns of a segment (one recording in the file): times and channels.

    A channel without a column of times gets a sampling rate, if the file states it. tags: tags of the file's header.
    run: number of the segment, with which the names of its columns begin; "" if it is the only one.
    """
    axes, decimal = tags.get("X_Columns", "One"), tags.get("Decimal_Separator", ".")
    width = max(map(len, segment.rows))
    # Some files have no column of times, not even an empty one.
    timeless = axes == "No" and any(row[0] for row in segment.rows)
    names = segment.names or [""] * width
    names = names[1:] if names[0] == "X_Value" and timeless else names
    names = names if names[0] == "X_Value" or timeless else ["X_Value", *names]
    names = names[: names.index("Comment")] if "Comment" in names else names
    prefix = f"{run}." if run else ""
    columns: list[Column] = []
    timed: set[int] = set()
    channel = axis = 0
    for i, name in enumerate(names):
        if name == "X_Value":
            axis += 1
        column = make_column(segment.rows, i, decimal, name, f"{run}/{axis}")
        if not np.isfinite(column.values).any() and not column.words:
            continue
        if name == "X_Value":
            timed.add(axis)
            name = f"{prefix}X_Value" + (f" {axis}" if axes == "Multi" else "")
            columns.append(replace(column, name=name, run=run, unit="s"))
            continue
        numbers = []
        for tag in ("Delta_X", "X0"):  # from the segment, else from the file
            number = parse_number(segment.tag(tag, channel) or tags.get(tag, ""), decimal)
            numbers.append(number if number is not None and np.isfinite(number) else 0.0)
        step, start = numbers
        columns.append(
            replace(
                column,
                name=f"{prefix}{name or f'channel {channel + 1}'}",
                run=run,
                unit=segment.tag("Y_Unit_Label", channel),
                rate=1 / step if step > 0 and axis not in timed else None,
                start=start,
            )
        )
        channel += 1
    return columns


PLUGIN = LvmReader()
