"""A file's contents as plain arrays by name and back, so that they can pass from one process to another."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents

_REST = "rest"


def packed(found: Contents) -> dict[str, np.ndarray]:
    """Arrays of numbers that `unpacked` makes the same contents of; what is no number is JSON in bytes."""
    arrays: dict[str, np.ndarray] = {}
    columns: list[dict[str, Any]] = []
    for i, column in enumerate(found.columns):
        arrays[f"values{i}"] = column.values
        if column.empty is not None:
            arrays[f"empty{i}"] = column.empty
        said = {k: v for k, v in vars(column).items() if k not in ("values", "empty", "words")}
        columns.append(said | {"words": list(column.words.items())})
    if found.lines is not None:
        arrays["lines"] = found.lines
    rest = {k: v for k, v in vars(found).items() if k not in ("columns", "lines")}
    text = json.dumps({**rest, "columns": columns}, default=dict)
    return arrays | {_REST: np.frombuffer(text.encode(), np.uint8)}


def unpacked(arrays: Mapping[str, np.ndarray]) -> Contents:
    """The contents that `packed` was given."""
    rest = json.loads(np.asarray(arrays[_REST], np.uint8).tobytes())
    columns = tuple(
        Column(**said, values=arrays[f"values{i}"], empty=arrays.get(f"empty{i}"), words=dict(words))
        for i, (said, words) in enumerate((said, said.pop("words")) for said in rest.pop("columns"))
    )
    return Contents(columns=columns, lines=arrays.get("lines"), **_tuples(rest))


def _tuples(rest: Mapping[str, Any]) -> dict[str, Any]:
    return {**rest, **{name: tuple(rest[name]) for name in ("notes", "warnings")}}
