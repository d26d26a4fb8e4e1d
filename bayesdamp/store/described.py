"""run.json read back, and whether what its readers rely on is of the kind that a run writes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bayesdamp.types import InputError
from bayesdamp.units import UNITS

RUN = "run.json"
_ANY = "*"
"""The key of a shape that holds for all others."""
_NEEDED = "!"
"""At the end of a key that may not be missing, nor null."""
_CALLED = {str: "text", dict: "a table", list: "a list"}
_SOURCE = {"damping": [str], "truth": dict}
_SYSTEM = {"restoring": str, "known": dict, "free": dict}
_SIGNAL = {
    "unit": tuple(UNITS),
    "quantity": ("angle", "velocity", "acceleration"),
    "warnings": [str],
    "notes": [str],
    "restoring": [str],
    "constant_columns": [str],
    "pieces": [dict],
    "outcome": str,
    "bound": dict,
    "reference": dict,
    "features": dict,
}
_SHAPE = {
    "name": str,
    "description": str,
    "kind": str,
    "study": {
        "name": str,
        "signals": [{"name!": str, "source": _SOURCE, "system": _SYSTEM}],
        "estimators": dict,
        "posterior": dict,
        "evidence": dict,
        "published": [{"estimator!": str, "signal!": str, "error_pct!": str, "time!": str}],
    },
    "signals": {_ANY: _SIGNAL},
    "models": [str],
    "cells": {_ANY: str},
    "seconds": dict,
    "inputs": dict,
    "versions": dict,
    "priors": {_ANY: {_ANY: dict}},
    "damping": {_ANY: {"parameter!": str, "force": str}},
    "restoring": {_ANY: str},
    "error_budget": dict,
    "equilibrium": {_ANY: dict},
    "result": dict,
}
"""Kinds of values by key, as deep as they are relied on: a type, words, a list of one kind, or a table."""


def read_description(folder: Path) -> dict[str, Any]:
    """What run.json says of the run in a folder; any key may be missing.

    Raises InputError where there is none, where it is no JSON, and for the first value that no run writes so.
    """
    path = folder / RUN
    if not path.is_file():
        raise InputError(f"{folder}: no run.json here; give the folder of a run, such as reports/<name>")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); run the study again") from fault
    if not isinstance(found, dict):
        raise InputError(f"{path}: holds no description of a run; run the study again")
    wrong = next(_misfits(found, _SHAPE, ""), None)
    if wrong is not None:
        raise InputError(f"{path}: {wrong}; give a folder that a run wrote, or run the study again")
    return found


def _misfits(value: object, shape: Any, at: str) -> Iterator[str]:
    """What does not fit, each with its place and what it must be."""
    if isinstance(shape, tuple):
        if value not in shape:
            yield f"{at} is {str(value)[:40]!r}, which this version does not know"
        return
    kind = shape if isinstance(shape, type) else type(shape)
    if not isinstance(value, kind):
        yield f"{at} must be {_CALLED[kind]}"
    elif isinstance(shape, list):
        for i, one in enumerate(value):  # type: ignore[arg-type]
            yield from _misfits(one, shape[0], f"{at}[{i}]")
    elif isinstance(shape, Mapping):
        yield from _in_table(value, shape, f"{at}." if at else "")  # type: ignore[arg-type]


def _in_table(table: Mapping[str, Any], shape: Mapping[str, Any], at: str) -> Iterator[str]:
    for key, wanted in shape.items():
        name = key.removesuffix(_NEEDED)
        for one in table if key == _ANY else [name]:
            if table.get(one) is not None:
                yield from _misfits(table[one], wanted, f"{at}{one}")
            elif name != key:
                yield f"{at}{one} is missing"
