"""Excel workbooks, every sheet (openpyxl)."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path
from typing import Any

from bayesdamp.provenance import Fact
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.limits import allowed_archive, archive_names
from bayesdamp.records.readers.text import from_lines
from bayesdamp.types import InputError

_OLE = bytes.fromhex("d0cf11e0a1b11ae1")
"""Begins an Excel 97-2003 workbook, and a workbook with a password ([MS-CFB] 2.2)."""
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
"""The stream of a compound file that holds a workbook with a password ([MS-OFFCRYPTO] 2.3.4.4)."""


class ExcelReader:
    """Workbooks by openpyxl (ECMA-376)."""

    format = "an Excel file"
    extensions = (".xlsx", ".xlsm", ".xls")
    extra = "excel"

    def claims(self, head: bytes, path: Path) -> bool:
        """A ZIP archive with a workbook in it; an old or encrypted file by its name."""
        if head.startswith(_OLE):
            return path.suffix.lower() in self.extensions
        if not head.startswith(b"PK"):
            return False
        names = archive_names(path)
        return path.suffix.lower() in self.extensions if names is None else "xl/workbook.xml" in names

    def read(self, path: Path) -> Contents:
        """The tables of all sheets. Raises InputError for a workbook with a password, and for an .xls."""
        with path.open("rb") as file:
            old = file.read(len(_OLE)) == _OLE
            if old and _ENCRYPTED in file.read():
                raise InputError("is a workbook with a password; save it as .xlsx without one, or as CSV")
        if old:
            raise InputError(
                "is an Excel 97-2003 workbook (.xls), which is not read; save it as .xlsx or CSV"
            )
        allowed_archive(path)
        import openpyxl

        with path.open("rb") as file:  # whatever its name: openpyxl goes by that
            book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
            sheets = {sheet.title: _lines(sheet) for sheet in book.worksheets}
            book.close()
        columns: list[Column] = []
        facts: dict[str, Fact] = {}
        held = 0
        for title, lines in sheets.items():
            try:
                found = from_lines(lines, "Excel")
            except InputError:  # a sheet of text or of charts
                continue
            held += 1
            facts |= {f"{title}.{name}": value for name, value in found.facts.items()}
            # Of several tables side by side each is its own group.
            columns += [c if c.group else replace(c, group=title) for c in found.columns]
        if not held:
            raise InputError("no sheet of it has rows of numbers; give a table with a row for each sample")
        if held > 1:
            columns = [replace(c, name=_named(c, i)) for i, c in enumerate(columns, start=1)]
        return Contents("Excel", tuple(columns), facts)


def _named(column: Column, number: int) -> str:
    """A column's name behind its sheet's."""
    name = column.name or str(number)
    return name if name.startswith(f"{column.group}.") else f"{column.group}.{name}"


def _lines(sheet: Any) -> list[str]:
    """A sheet's rows as lines of text, numbers written so that they read back exactly."""
    lines = ["\t".join(map(_cell, row)) for row in sheet.iter_rows(values_only=True)]
    return [line if line.strip() else "" for line in lines]


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime.datetime | datetime.time):
        return value.isoformat()
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return repr(value) if isinstance(value, int | float) else " ".join(str(value).split())


PLUGIN = ExcelReader()
