"""The studies that ship, by name: in the installed package, or beside it in a clone."""

from __future__ import annotations

from pathlib import Path

from bayesdamp.plugins import nearest
from bayesdamp.types import InputError

PACKAGE = Path(__file__).resolve().parents[1]


def folder() -> Path:
    """Where they are."""
    own = PACKAGE / "studies"
    return own if own.is_dir() else PACKAGE.parent / "studies"


def names() -> list[str]:
    """Names of the studies that ship."""
    return sorted(path.stem for path in folder().glob("*.toml"))


def study_file(given: Path) -> Path:
    """The file itself where there is one, else the study of this name that ships. Raises InputError."""
    if given.exists() or len(given.parts) != 1 or given.suffix not in ("", ".toml"):
        return given
    if given.stem in names():
        return folder() / f"{given.stem}.toml"
    if given.suffix:
        return given
    raise InputError(f"{given}: no such file, and no study of this name ships{nearest(given.name, names())}")
