"""What commands are asked: the study of a file, and the folder to write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bayesdamp.types import InputError

if TYPE_CHECKING:
    from bayesdamp.config import Study


FIRST_WORDS = 5
"""Records of one command whose first words are printed."""


def run_folder(out: Path | None, name: str) -> Path:
    """A run's folder. Raises InputError where a file has its name."""
    folder = out if out is not None else Path("reports") / name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; it must be a folder, or a new name")
    return folder


def read_study(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """A study with the options of its estimators checked too. plugins: files besides those that it names."""
    from bayesdamp.config import load_study
    from bayesdamp.config.shipped import study_file
    from bayesdamp.plugins import read_modules

    loaded = load_study(study_file(file), read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded
