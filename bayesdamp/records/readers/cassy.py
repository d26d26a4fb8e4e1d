"""Read files of CASSY Lab 2, the measuring software of LD Didactic. They are XML files, plain or in a ZIP archive."""

import zipfile
from collections import Counter
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from bayesdamp.records.files.contents import (
    Column,
    Contents,
    Reader,
    archive_names,
    refuse_archive,
    seconds_written,
    trim_facts,
)
from bayesdamp.records.readers.text import LARGEST_TEXT, make_column
from bayesdamp.types import Fact, InputError

_ROOT = b"<cassylab"
_MEMBER = "data.xml"
_HEAD = 65536


class CassyReader(Reader):
    """Reader of CASSY Lab 2 files, which have a list of values for each quantity and run.

    References
    ----------
    PhyPraKit 1.2, `labxParser`, and its example files; LD Didactic publishes no description of the format.
    """

    format = "a CASSY Lab file"
    extensions = (".labx",)

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file, or the XML file in its ZIP archive, contains the root element of CASSY Lab.

        Plain XML is searched only in the first bytes, `head`.
        """
        if not head.startswith(b"PK") or _MEMBER not in (archive_names(path) or ()):
            return _ROOT in head
        try:
            with zipfile.ZipFile(path) as archive, archive.open(_MEMBER) as member:
                return _ROOT in member.read(_HEAD)
        except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError):
            return False

    def read(self, path: Path) -> Contents:
        """Return the `Contents` of the file, with a column for each quantity and run that has values.

        Times are in s even if the file states a shorter unit, in which CASSY Lab only displays them. Raises InputError
        if the XML is too large or has a document type (DOCTYPE), or if the ZIP archive is encrypted.
        """
        if zipfile.is_zipfile(path):
            refuse_archive(path)
            with zipfile.ZipFile(path) as archive:
                data = archive.read(_MEMBER)
        else:
            data = path.read_bytes()
        if len(data) > LARGEST_TEXT:
            raise InputError(f"the file has more than {LARGEST_TEXT >> 20} MiB of text; split it")
        if b"<!DOCTYPE" in data:
            raise InputError("has a document type, which no CASSY Lab file has; export it again, or as CSV")
        quantities = [list(channels) for channels in ElementTree.fromstring(data).iter("channels")]
        named = Counter(_text(channels[0], "quantity") for channels in quantities if channels)
        several = max(map(len, quantities), default=0) > 1
        columns: list[Column] = []
        facts: dict[str, Fact] = {}
        notes: dict[str, None] = {}
        for channels in quantities:
            for run, channel in enumerate(channels, start=1):
                cells = [(value.text or "").strip() for value in channel.iterfind("values/value")]
                rows = [["" if cell == "NaN" else cell] for cell in cells]
                if not any(map(any, rows)):
                    continue
                label = str(run) if several else ""
                name, unit = _text(channel, "quantity"), _text(channel, "unit")
                if named[name] != 1:
                    name = f"{name} {_text(channel, 'symbol')}".strip()
                if (seconds_written(unit) or 1.0) < 1.0:
                    note = f"Times are read in s: CASSY Lab stores times in s, although it displays {unit}."
                    notes[note] = None
                    unit = "s"
                column = make_column(rows, 0, ".", f"{label}.{name}" if label else name, label, unit)
                columns.append(replace(column, run=label))
                if channel.get("datetime"):
                    facts[f"{label}.datetime".strip(".")] = channel.get("datetime", "")
        return Contents("CASSY Lab", tuple(columns), trim_facts(facts), tuple(notes))


def _text(channel: ElementTree.Element, tag: str) -> str:
    return (channel.findtext(tag) or "").strip()


PLUGIN = CassyReader()
