"""Read all sheets of Excel workbooks with openpyxl."""

import datetime
from dataclasses import replace
from pathlib import Path

from bayesdamp.records.files.contents import Column, Contents, Reader, archive_names, refuse_archive
from bayesdamp.records.readers.text import parse_table
from bayesdamp.types import Fact, InputError

_OLE = bytes.fromhex("d0cf11e0a1b11ae1")
"""First bytes of an OLE compound file: an Excel 97-2003 workbook, or a workbook with a password ([MS-CFB] 2.2)."""
_ENCRYPTED = "EncryptedPackage".encode("utf-16-le")
"""Name of the stream (part of a compound file) in a workbook with a password ([MS-OFFCRYPTO] 2.3.4.4)."""


class ExcelReader(Reader):
    """Reader of Excel workbooks (ECMA-376)."""

    format = "an Excel file"
    extensions = (".xlsx", ".xlsm", ".xls")
    extra = "excel"

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file is a ZIP archive with an Excel workbook, or an old or encrypted Excel file.

        `read` refuses the latter two. The extension decides for an old or encrypted file, and for a ZIP archive that
        cannot be opened.
        """
        if head.startswith(_OLE):
            return path.suffix.lower() in self.extensions
        if not head.startswith(b"PK"):
            return False
        names = archive_names(path)
        return path.suffix.lower() in self.extensions if names is None else "xl/workbook.xml" in names

    def read(self, path: Path) -> Contents:
        """Return the columns of the tables in all sheets.

        Each sheet is a group; sheets without rows of numbers are skipped. If several sheets have tables, the names of
        columns begin with the name of their sheet. Raises InputError for a workbook with a password, for an Excel
        97-2003 workbook (.xls), for one that is too large, and if no sheet has rows of numbers.
        """
        with path.open("rb") as file:
            old = file.read(len(_OLE)) == _OLE
            if old and _ENCRYPTED in file.read():
                raise InputError("is a workbook with a password; save it as .xlsx without one, or as CSV")
        if old:
            raise InputError("is an old Excel workbook (.xls); save it as .xlsx or CSV")
        refuse_archive(path)
        import openpyxl

        with path.open("rb") as file:  # given a path, openpyxl would check the extension
            book = openpyxl.load_workbook(file, read_only=True, data_only=True, keep_links=False)
            sheets = {
                sheet.title: ["\t".join(map(_cell, row)) for row in sheet.iter_rows(values_only=True)]
                for sheet in book.worksheets
            }
            book.close()
        columns: list[Column] = []
        facts: dict[str, Fact] = {}
        tables = 0
        for title, lines in sheets.items():
            try:
                table = parse_table([line if line.strip() else "" for line in lines], "Excel")
            except InputError:  # a sheet without a table
                continue
            tables += 1
            facts |= {f"{title}.{name}": value for name, value in table.facts.items()}
            columns += [replace(c, group=title) for c in table.columns]
        if not tables:
            raise InputError("no sheet has rows of numbers; give a table with a row for each sample")
        for i, column in enumerate(columns if tables > 1 else ()):
            columns[i] = replace(column, name=f"{column.group}.{column.name or i + 1}")
        return Contents("Excel", tuple(columns), facts)


def _cell(value: object) -> str:
    """Convert the value of a cell to text.

    Numbers are not rounded. Dates and times of day are written in ISO 8601, durations in s. An empty cell gives "".
    """
    if value is None:
        return ""
    if isinstance(value, datetime.datetime | datetime.time):
        return value.isoformat()
    if isinstance(value, datetime.timedelta):
        return repr(value.total_seconds())
    return repr(value) if isinstance(value, int | float) else " ".join(str(value).split())


PLUGIN = ExcelReader()
