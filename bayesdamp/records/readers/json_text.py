"""Read JSON files: lists of numbers by name, or a list of samples."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Contents, Reader
from bayesdamp.records.files.tree import Walk, join_path
from bayesdamp.records.readers.text import make_column, read_text

LARGEST_JSON = 2**28
"""Largest size of a JSON file in bytes; larger files are refused (conventional)."""


class JsonReader(Reader):
    """Reader of JSON files, and of files with one JSON value in each line (JSON Lines)."""

    format = "a JSON file"
    extensions = (".json", ".jsonl", ".ndjson")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes, `head`, begin like JSON.

        A file with a JSON extension must begin with `{` or `[`, any other file with `{"` or `[{`.
        """
        bare = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        named = path.suffix.lower() in self.extensions
        return (named and bare[:1] in (b"{", b"[")) or bare[:2] in (b'{"', b"[{")

    def read(self, path: Path) -> Contents:
        """Return the lists of numbers as columns named by their paths.

        A list of samples (objects) gives a column for each key, as do the lines of a JSON Lines file. Single numbers
        and texts become facts. Raises InputError if the file is too large or contains no list of numbers, and
        ValueError if it is not JSON.
        """
        text = read_text(path, LARGEST_JSON)
        try:
            data = json.loads(text)
        except json.JSONDecodeError:
            lines = [line for line in text.splitlines() if line.strip()]
            if len(lines) < 2:
                raise
            data = [json.loads(line) for line in lines]
        walk = _JsonWalk()
        walk.add("", data)
        return walk.contents("JSON")


class _JsonWalk(Walk):
    """Collector of columns in JSON values, also in a list of samples.

    Each sample is an object of numbers or texts; the list gives one column for each key.
    """

    def add_list(self, path: str, items: Any, run: str, depth: int) -> None:
        """Collect a list; a list of samples (objects) gives a column for each key.

        The numbers in a sample may be in quotes. If a sample has no number for a key, the column has NaN there; a key
        without any number is left out. path: path of the list in the file, with dots. run: run (one of several
        measurements) to which it belongs, "" for none. depth: number of levels above it.
        """
        if len(items) < 2 or not all(isinstance(row, dict) for row in items):
            return super().add_list(path, items, run, depth)
        if any(isinstance(x, list | dict) for row in items[:3] for x in row.values()):
            return super().add_list(path, items, run, depth)
        for key in dict.fromkeys(key for row in items for key in row):
            cells = [row.get(key) for row in items]
            texts = [["" if x is None or isinstance(x, bool) else str(x).strip()] for x in cells]
            column = make_column(texts, 0, ".", join_path(path, key), path)
            if np.isfinite(column.values).any():
                self.columns.append(replace(column, run=run))
        return None


PLUGIN = JsonReader()
