"""Check the files and folders that a command names, and read its study."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from bayesdamp.config import Study, load_study
from bayesdamp.config.load import asks_another, study_file
from bayesdamp.plugins import read_modules
from bayesdamp.types import InputError

MOST_ANSWERS = 100
"""Numbered folders of one name that are searched for one without another question's answer."""


def check_folder(out: Path | None, name: str) -> Path:
    """Return the folder of a run: `out`, or reports/`name`.

    Raises
    ------
    InputError
        Where the folder cannot be made, because a file has its name or that of a folder above it.
    """
    folder = out if out is not None else Path("reports") / name
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InputError(f"--out: is {str(folder)!r}, {what}; it must be a folder, or a new name") from None
    present = next(place for place in (folder, *folder.absolute().parents) if os.path.lexists(place))
    if not present.is_dir():
        raise InputError(
            f"--out: is {str(folder)!r}, and {present} is not a folder; it must be a folder, or a new name"
        )
    return folder


def choose_folder(study: Study) -> Path:
    """Return reports/NAME, or the first of NAME-2, NAME-3, ... that does not hold another question's answer.

    Raises
    ------
    InputError
        Where a file has the folder's name, or no such folder is left.
    """
    for name in (study.name, *(f"{study.name}-{number}" for number in range(2, MOST_ANSWERS))):
        folder = check_folder(None, name)
        if not asks_another(study, folder):
            return folder
    raise InputError(
        f"--out: reports/ has {MOST_ANSWERS} answers for {study.name}; give a folder of your own"
    )


def check_names(paths: Sequence[Path]) -> None:
    """Refuse files whose names are not valid UTF-8, in which a run describes its inputs. Raises InputError."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise InputError(f"{path}: the file name is not valid UTF-8; rename the file") from None


def read_study(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """Read a study and check the options of its estimators too.

    Parameters
    ----------
    file
        A study file, the name of a study that ships, or a run's run.json.
    plugins
        Files with plug-ins besides those that the study names.
    """
    loaded = load_study(study_file(file), read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded
