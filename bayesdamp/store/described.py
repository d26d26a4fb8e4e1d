"""run.json read back, and whether what its readers rely on is of the kind that a run writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from bayesdamp.types import InputError

RUN = "run.json"
_KINDS = {
    "string_type": "must be text",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "missing": "is missing",
}


class _Part(BaseModel):
    """A table of which each key may be missing, or null; what a later version adds is left alone."""

    model_config = ConfigDict(strict=True, extra="ignore")


class _Source(_Part):
    damping: list[str] | None = None
    truth: dict[str, Any] | None = None


class _System(_Part):
    restoring: str | None = None
    known: dict[str, Any] | None = None
    free: dict[str, Any] | None = None


class _StudySignal(_Part):
    name: str
    source: _Source | None = None
    system: _System | None = None


class _Published(_Part):
    estimator: str
    signal: str
    error_pct: str
    time: str


class _Study(_Part):
    name: str | None = None
    signals: list[_StudySignal] | None = None
    estimators: dict[str, Any] | None = None
    posterior: dict[str, Any] | None = None
    evidence: dict[str, Any] | None = None
    published: list[_Published] | None = None


class _Signal(_Part):
    unit: str | None = None
    quantity: Literal["angle", "velocity", "acceleration", "envelope"] | None = None
    warnings: list[str] | None = None
    notes: list[str] | None = None
    restoring: list[str] | None = None
    constant_columns: list[str] | None = None
    pieces: list[dict[str, Any]] | None = None
    outcome: str | None = None
    bound: dict[str, Any] | None = None
    reference: dict[str, Any] | None = None
    features: dict[str, Any] | None = None


class _Damping(_Part):
    parameter: str
    force: str | None = None


class _Run(_Part):
    name: str | None = None
    description: str | None = None
    kind: str | None = None
    study: _Study | None = None
    signals: dict[str, _Signal | None] | None = None
    models: list[str] | None = None
    cells: dict[str, str | None] | None = None
    seconds: dict[str, Any] | None = None
    inputs: dict[str, Any] | None = None
    versions: dict[str, Any] | None = None
    priors: dict[str, dict[str, dict[str, Any]] | None] | None = None
    assumed: list[str] | None = None
    damping: dict[str, _Damping] | None = None
    restoring: dict[str, str] | None = None
    error_budget: dict[str, Any] | None = None
    equilibrium: dict[str, dict[str, Any] | None] | None = None
    result: dict[str, Any] | None = None


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
    try:
        _Run.model_validate(found)
    except ValidationError as error:
        wrong = _misfit(error.errors(include_url=False)[0])
        raise InputError(f"{path}: {wrong}; give a folder that a run wrote, or run the study again") from None
    return found


def _misfit(wrong: ErrorDetails) -> str:
    """What does not fit, with its place and what it must be."""
    at = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in wrong["loc"]).lstrip(".")
    unknown = f"is {str(wrong['input'])[:40]!r}, which this version does not know"
    return f"{at} {_KINDS.get(wrong['type'], unknown)}"
