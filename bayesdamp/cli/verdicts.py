"""A run's verdicts for other programs."""

from __future__ import annotations

from pathlib import Path


def verdicts_json(folder: Path) -> str:
    """The text of a run's verdict.json; an empty list where the run has no verdict."""
    try:
        return (folder / "verdict.json").read_text(encoding="utf-8").rstrip("\n")
    except FileNotFoundError:
        return "[]"
