"""Read JSON files: lists of numbers by name, or a list of samples."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Contents, Reader
from bayesdamp.records.files.tree import DEEPEST_LEVEL, Walk, join_path
from bayesdamp.records.readers.text import make_column, read_text

LARGEST_JSON = 2**28
"""Largest size of a JSON file in bytes (conventional)."""


class JsonReader(Reader):
    """Reader of JSON files and of files with one JSON value a line."""

    format = "a JSON file"
    extensions = (".json", ".jsonl", ".ndjson")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the text begins like JSON; without a JSON extension, only `{"` and `[{` count."""
        bare = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        named = path.suffix.lower() in self.extensions
        return (named and bare[:1] in (b"{", b"[")) or bare[:2] in (b'{"', b"[{")

    def read(self, path: Path) -> Contents:
        """Return the lists of numbers as columns named by their paths. Raises InputError if the file is too large."""
        text = read_text(path, LARGEST_JSON)
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
    """Collect the columns and facts in a JSON value; a list of samples (objects) gives a column for each key."""
    if isinstance(item, dict) and depth < DEEPEST_LEVEL:
        for key, below in item.items():
            _add(walk, join_path(path, key), below, depth + 1)
        return
    if isinstance(item, list) and len(item) > 1:
        if all(isinstance(row, dict) for row in item) and not any(
            isinstance(x, list | dict) for row in item[:3] for x in row.values()
        ):
            # Each object is a sample; its numbers may be in quotes.
            for key in dict.fromkeys(key for row in item for key in row):
                cells = [row.get(key) for row in item]
                texts = [["" if x is None or isinstance(x, bool) else str(x).strip()] for x in cells]
                column = make_column(texts, 0, ".", join_path(path, key), path)
                if np.isfinite(column.values).any():
                    walk.columns.append(column)
            return
        lists = all(isinstance(row, list) for row in item) and len({len(row) for row in item}) == 1
        if lists and all(isinstance(x, int | float) for row in item for x in row):
            item = np.array(item, float)
        elif all(isinstance(x, int | float | None) for x in item) and None in item:
            item = [np.nan if x is None else x for x in item]
    walk.add(path, item)


PLUGIN = JsonReader()
