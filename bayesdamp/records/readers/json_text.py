"""JSON: lists of numbers by name, or a list of samples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Contents, Reader
from bayesdamp.records.files.tree import Walk
from bayesdamp.records.readers.text import column_of, text_of

LARGEST = 2**28
"""Bytes of a text that is read as JSON (conventional)."""


class JsonReader(Reader):
    """JSON and JSON lines."""

    format = "a JSON file"
    extensions = (".json", ".jsonl", ".ndjson")

    def claims(self, head: bytes, path: Path) -> bool:
        """An opening bracket in a file of that name, or text that can be nothing else."""
        bare = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        named = path.suffix.lower() in self.extensions
        return (named and bare[:1] in (b"{", b"[")) or bare[:2] in (b'{"', b"[{")

    def read(self, path: Path) -> Contents:
        """Lists of numbers by their paths. Raises InputError for a text that is too large."""
        text = text_of(path, LARGEST)
        try:
            data = json.loads(text)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2:
                raise
            data = [json.loads(line) for line in lines]
        walk = Walk()
        _add(walk, "", data)
        return walk.contents("JSON")


def _add(walk: Walk, path: str, item: Any, depth: int = 0) -> None:
    if isinstance(item, list) and len(item) > 1:
        if all(isinstance(row, dict) for row in item) and not any(
            isinstance(x, list | dict) for row in item[:3] for x in row.values()
        ):
            _samples(walk, path, item)
            return
        if _table(item):
            walk.add(path, np.array(item, float))
            return
        if all(isinstance(x, int | float | None) for x in item) and None in item:
            item = [np.nan if x is None else x for x in item]
    if isinstance(item, dict) and depth < 20:
        for key, below in item.items():
            _add(walk, f"{path}.{key}" if path else str(key), below, depth + 1)
        return
    walk.add(path, item)


def _table(rows: list[Any]) -> bool:
    """Whether a list is one of lists of as many numbers."""
    if not all(isinstance(row, list) for row in rows) or len({len(row) for row in rows}) > 1:
        return False
    return all(isinstance(x, int | float) for row in rows for x in row)


def _samples(walk: Walk, path: str, rows: list[dict[str, Any]]) -> None:
    """Columns out of a list of samples, each a table of names and values; numbers may be in quotes."""
    for key in dict.fromkeys(key for row in rows for key in row):
        cells = [row.get(key) for row in rows]
        texts = [["" if x is None or isinstance(x, bool) else str(x).strip()] for x in cells]
        column = column_of(texts, 0, ".", f"{path}.{key}" if path else str(key), path)
        if np.isfinite(column.values).any():
            walk.columns.append(column)


PLUGIN = JsonReader()
