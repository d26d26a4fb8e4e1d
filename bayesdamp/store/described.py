"""run.json read back, and whether what its readers rely on is of the kind that a run writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from bayesdamp.types import InputError

RUN = "run.json"
EACH = "*"
_TABLE: dict[str, Any] = {}
_TABLES = {EACH: _TABLE}
_SIGNAL = {
    "name!": str,
    "source": {"damping": [str], "truth": _TABLE},
    "system": {"restoring": str, "known": _TABLE, "free": _TABLE},
}
_STUDY = {
    "name": str,
    "signals": [_SIGNAL],
    "estimators": _TABLE,
    "posterior": _TABLE,
    "evidence": _TABLE,
    "published": [{"estimator!": str, "signal!": str, "error_pct!": str, "time!": str}],
}
_RECORD = {
    "unit": str,
    "quantity": ("angle", "velocity", "acceleration", "envelope"),
    **{name: [str] for name in ("warnings", "notes", "restoring", "constant_columns")},
    "decays": [_TABLE],
    "outcome": str,
    "bound": _TABLE,
    "reference": _TABLE,
    "features": _TABLE,
}
SHAPE: dict[str, Any] = {
    **dict.fromkeys(("name", "description", "kind"), str),
    "study": _STUDY,
    "signals": {EACH: _RECORD},
    "models": [str],
    "cells": {EACH: str},
    "assumed": [str],
    "priors": {EACH: _TABLES},
    "damping": {EACH: {"parameter!": str, "force": str}},
    "restoring": {EACH: str},
    **dict.fromkeys(("seconds", "inputs", "versions", "error_budget", "result"), _TABLE),
    "equilibrium": _TABLES,
}
"""A table of what a key may hold: text, a list of something, a table, or one of several words. Any key may be missing,
or null, but for those marked with !; what a later version adds is left alone."""


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
    wrong = _misfit(SHAPE, found, "")
    if wrong:
        raise InputError(f"{path}: {wrong}; give a folder that a run wrote, or run the study again")
    return found


def _misfit(shape: Any, value: Any, at: str) -> str:
    """Return the first value that is not of its shape, with its place and what it must be; empty without one."""
    if value is None:
        return ""
    if isinstance(shape, tuple):
        return "" if value in shape else f"{at} is {str(value)[:40]!r}, which this version does not know"
    kind, words = {list: (list, "a list"), dict: (dict, "a table")}.get(type(shape), (str, "text"))
    if not isinstance(value, kind):
        return f"{at} must be {words}"
    parts: list[tuple[Any, Any, str]] = []
    if isinstance(shape, list):
        # of a list none may be missing: an empty value of no kind is refused as any other
        parts = [(shape[0], False if one is None else one, f"{at}[{i}]") for i, one in enumerate(value)]
    elif isinstance(shape, dict):
        below = f"{at}." if at else ""
        missing = [key[:-1] for key in shape if key.endswith("!") and value.get(key[:-1]) is None]
        if missing:
            return f"{below}{missing[0]} is missing"
        each = shape.get(EACH)
        shapes = (
            {k: each for k in value} if each is not None else {k.rstrip("!"): s for k, s in shape.items()}
        )
        parts = [(one, value.get(key), f"{below}{key}") for key, one in shapes.items()]
    return next(filter(None, (_misfit(*part) for part in parts)), "")
