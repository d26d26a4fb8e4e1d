"""Read the study of a command, choose its folder, run it, and print its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from bayesdamp.cli.border import one_line, print_error
from bayesdamp.cli.files import check_folder
from bayesdamp.config import Study, load_study
from bayesdamp.config.load import asks_another, study_file
from bayesdamp.machine import cache_folder
from bayesdamp.pipeline.jobs import Depth
from bayesdamp.pipeline.run import WRONG_CELLS, run_study
from bayesdamp.plugins import read_modules
from bayesdamp.report.terminal import Lasting, VerdictPrinter, conclude
from bayesdamp.types import InputError

MOST_ANSWERS = 100
"""Numbered folders of one name that are searched for one without another question's answer."""
FEW = 5
"""Largest number of records in one command whose verdicts are printed as they come."""


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


def compilation_notice() -> str:
    """Return a notice where a first run has nothing compiled yet and takes longer; empty later."""
    if any((cache_folder() / "kernels").glob("*")):
        return ""
    return "compiling the equations of motion for this machine; this first run takes about 20 s longer"


def run_and_print(
    study: Study,
    folder: Path,
    depth: Depth,
    finish: Callable[[Path, Console], None] | None = None,
    *,
    as_json: bool,
    failed: Sequence[InputError] = (),
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
        Prints the summary of the run's folder at the end; by default its verdicts. Not called with `as_json`.
    as_json
        Whether verdicts are printed as JSON.
    failed
        What is wrong with files that are not in the study; printed at the end.
    **options
        Options of `run_study`.
    """
    envelopes_only = all(s.is_envelope for s in study.signals)
    if not options["quiet"] and not envelopes_only and (notice := compilation_notice()):
        typer.echo(notice, err=True)
    shown = Lasting()
    answered = None
    if not as_json and len(study.signals) <= FEW:
        answered = VerdictPrinter(shown, {spec.name: spec.source.unit for spec in study.signals})
    status = run_study(study, folder, console=Console(stderr=True), depth=depth, answered=answered, **options)
    if as_json:
        path = folder / "verdict.json"
        typer.echo(path.read_text(encoding="utf-8").rstrip("\n") if path.is_file() else "[]")
    else:
        (finish or conclude)(folder, shown)
    for error in failed:
        print_error(one_line(f"failed: {error}"))
    return WRONG_CELLS if failed else status
