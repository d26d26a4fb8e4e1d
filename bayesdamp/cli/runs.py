"""Read the study of a command, choose its folder, and run it."""

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

MOST_ANSWERS = 100
"""Numbered folders of one name that are searched for one without another question's answer."""
FIRST_WORDS = 5
"""Largest number of records in one command for which a first line on each is printed."""


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
    from bayesdamp.config.load import asks_another

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


def compilation_notice() -> str:
    """Return a notice where a first run has nothing compiled yet and takes longer; empty later."""
    if any((cache_folder() / "kernels").glob("*")):
        return ""
    return "compiling the equations of motion for this machine; this first run takes about 20 s longer"


def run_and_print(
    study: Study,
    folder: Path,
    depth: Depth,
    finish: Callable[[Path, Console], None],
    *,
    as_json: bool,
    **options: Any,
) -> int:
    """Run a study, print its verdicts as they come, and return the exit status.

    Parameters
    ----------
    study
        The study.
    folder
        The folder of the run.
    depth
        How thoroughly the answer is checked.
    finish
        Prints the summary of the run's folder at the end; not called with `as_json`.
    as_json
        Whether verdicts are printed as JSON.
    **options
        Options of `run_study`.
    """
    from rich.console import Console

    from bayesdamp.pipeline import run_study
    from bayesdamp.report.terminal import Lasting, VerdictPrinter

    envelopes_only = all(s.is_envelope for s in study.signals)
    if not options["quiet"] and not envelopes_only and (notice := compilation_notice()):
        typer.echo(notice, err=True)
    shown = Lasting()
    answered = None
    if not as_json and len(study.signals) <= FIRST_WORDS:
        answered = VerdictPrinter(shown, {spec.name: spec.source.unit for spec in study.signals})
    status = run_study(study, folder, console=Console(stderr=True), depth=depth, answered=answered, **options)
    if as_json:
        path = folder / "verdict.json"
        typer.echo(path.read_text(encoding="utf-8").rstrip("\n") if path.is_file() else "[]")
    else:
        finish(folder, shown)
    return status


def read_study(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """Read a study and check the options of its estimators too.

    Parameters
    ----------
    file
        A study file, the name of a study that ships, or a run's run.json.
    plugins
        Files with plug-ins besides those that the study names.
    """
    from bayesdamp.config import load_study
    from bayesdamp.config.load import study_file
    from bayesdamp.plugins import read_modules

    loaded = load_study(study_file(file), read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded
