"""What commands are asked: the study of a file, and the folder to write."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bayesdamp.machine import cache_folder
from bayesdamp.types import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bayesdamp.config import Study
    from bayesdamp.pipeline import Depth


MOST_QUESTIONS = 100
"""Folders of one name that are looked through for the question's own."""
FIRST_WORDS = 5
"""Records of one command whose first words are printed."""


def run_folder(out: Path | None, name: str) -> Path:
    """A run's folder. Raises InputError where a file has its name."""
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


def own_folder(study: Study) -> Path:
    """The folder of a question that none was given for: reports/NAME, or the first of NAME-2, NAME-3, ... that has no
    other question's answer. Raises InputError where a file has its name."""
    from bayesdamp.config.load import asks_another

    names = (study.name, *(f"{study.name}-{number}" for number in range(2, MOST_QUESTIONS)))
    folders = (run_folder(None, one) for one in names)
    found = next((folder for folder in folders if not asks_another(study, folder)), None)
    if found is None:
        raise InputError(
            f"--out: reports/ has {MOST_QUESTIONS} answers of {study.name}; give a folder of your own"
        )
    return found


def describable(paths: Sequence[Path]) -> None:
    """Refuse files whose names no run's description can hold. Raises InputError."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise InputError(
                f"{path}: its name is no UTF-8, in which a run says what it was made of; rename the file"
            ) from None


def compiles_first() -> str:
    """What a first command has to say before it is silent: nothing that it runs is compiled yet. Empty later."""
    if any((cache_folder() / "kernels").glob("*")):
        return ""
    return "compiling the equations of motion for this machine, once: about 20 s more than later"


def run_asked(
    study: Study,
    folder: Path,
    depth: Depth,
    finish: Callable[[Path, Console], None],
    *,
    as_json: bool,
    **how: Any,
) -> int:
    """Run a study and print its verdicts as they are there; the exit status.

    finish: prints what there is to say of the run's folder at the end; not where verdicts are printed as_json. how: as
    of `run_study`.
    """
    from rich.console import Console

    from bayesdamp.pipeline import run_study
    from bayesdamp.report.terminal import Lasting, Told

    if not how["quiet"] and not all(s.is_envelope for s in study.signals) and (once := compiles_first()):
        typer.echo(once, err=True)
    shown = Lasting()
    told = Told(shown, {spec.name: spec.source.unit for spec in study.signals})
    answered = None if as_json or len(study.signals) > FIRST_WORDS else told
    status = run_study(study, folder, console=Console(stderr=True), depth=depth, answered=answered, **how)
    if as_json:
        path = folder / "verdict.json"
        typer.echo(path.read_text(encoding="utf-8").rstrip("\n") if path.is_file() else "[]")
    else:
        finish(folder, shown)
    return status


def read_study(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """A study with the options of its estimators checked too. plugins: files besides those that it names."""
    from bayesdamp.config import load_study
    from bayesdamp.config.load import study_file
    from bayesdamp.plugins import read_modules

    loaded = load_study(study_file(file), read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded
