"""Read a study, choose the folder of its run, run it, and print its verdicts."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from bayesdamp.cli.border import one_line, print_error
from bayesdamp.cli.files import check_folder
from bayesdamp.config import Study, load_study
from bayesdamp.config.load import has_other_study, study_file
from bayesdamp.machine import cache_folder
from bayesdamp.pipeline.jobs import Depth
from bayesdamp.pipeline.run import SOME_FAILED, run_study
from bayesdamp.plugins import read_modules
from bayesdamp.report.terminal import PipeSafeConsole, VerdictPrinter, print_conclusion
from bayesdamp.types import InputError

MOST_ANSWERS = 100
"""Largest number of folders that are tried for the runs of studies with the same NAME: NAME, NAME-2, NAME-3, ...; if
all contain other studies, --out is required (conventional)."""
FEW_RECORDS = 5
"""Largest number of records in one command for which each verdict is printed as soon as it is available."""


def read_study(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """Read a study, and check the options of its estimators.

    Raises InputError if something in the study is wrong, or if there is no such file.

    Parameters
    ----------
    file
        A study file, the name of a study of the package, or the run.json of a run.
    plugins
        Files with plug-ins, in addition to those that the study names.
    """
    loaded = load_study(study_file(file), read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded


def choose_folder(study: Study) -> Path:
    """Return the first of the folders reports/NAME, reports/NAME-2, ... that contains no run of a different study.

    NAME is the study's name. The folder does not exist yet, or contains no run, or contains an earlier run of the same
    study, which is then resumed.

    Raises
    ------
    InputError
        If a file has the name of the folder, or if there are too many folders.
    """
    for name in (study.name, *(f"{study.name}-{number}" for number in range(2, MOST_ANSWERS + 1))):
        folder = check_folder(None, name)
        if not has_other_study(study, folder):
            return folder
    raise InputError(
        f"--out: reports/ already contains {MOST_ANSWERS} answers for {study.name}; give another folder with --out"
    )


def compilation_notice() -> str:
    """Return a notice that this run takes longer, if no equations of motion are compiled yet; else an empty text."""
    if any((cache_folder() / "kernels").glob("*")):
        return ""
    return "compiling the equations of motion for this machine; this first run takes 10 to 20 s longer"


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
    """Run a study, print its verdicts, and return the exit status.

    For up to `FEW_RECORDS` records, each verdict is printed as text as soon as it is available, unless `as_json` is
    true. The exit status is that of `run_study`, but 3 if `failed` is not empty.

    Parameters
    ----------
    study
        The study.
    folder
        The folder of the run.
    depth
        Step after which the run ends: `ANSWER`, the comparison of damping models by linear approximations; `SAMPLED`,
        in addition the sampling of the posteriors of the most probable models; or `WHOLE`, everything that the study
        asks for.
    finish
        Function that prints the end of the output, from the folder of the run; by default `print_conclusion`. It is
        not called if `as_json` is True.
    as_json
        Whether to print the verdicts as JSON. If False, they are printed as text.
    failed
        Errors of files that could not be read, which are printed at the end.
    **options
        Options of `run_study`; `quiet` must be among them.
    """
    envelopes_only = all(s.is_envelope for s in study.signals)
    if not options["quiet"] and not envelopes_only and (notice := compilation_notice()):
        typer.echo(notice, err=True)
    shown = PipeSafeConsole()
    answered = None
    if not as_json and len(study.signals) <= FEW_RECORDS:
        answered = VerdictPrinter(shown, {spec.name: spec.source.unit for spec in study.signals})
    status = run_study(
        study, folder, console=Console(stderr=True), depth=depth, on_verdict=answered, **options
    )
    if as_json:
        path = folder / "verdict.json"
        typer.echo(path.read_text(encoding="utf-8").rstrip("\n") if path.is_file() else "[]")
    else:
        (finish or print_conclusion)(folder, shown)
    for error in failed:
        print_error(one_line(f"failed: {error}"))
    return SOME_FAILED if failed else status
