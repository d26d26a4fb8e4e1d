"""Define `bayesdamp calibrate`, which checks the intervals of a study with simulated records."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from bayesdamp.calibrate import run_calibration
from bayesdamp.cli import options as o
from bayesdamp.cli.files import check_folder
from bayesdamp.cli.runs import read_study


def calibrate(
    file: o.StudyFile,
    out: o.Out = None,
    models: Annotated[
        bool, typer.Option("--models", help="Check the probabilities of the models instead of the intervals.")
    ] = False,
    records: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of records of each model (with --models of all models together); by default as in the study.",
        ),
    ] = None,
    workers: o.Workers = None,
    fresh: o.Fresh = False,
    no_report: Annotated[
        bool,
        typer.Option("--no-report", help="Do not write report.html; `bayesdamp report` writes it later."),
    ] = False,
) -> int:
    """Check the intervals: simulate records with parameters from the study's prior, and compare with the truth."""
    loaded = read_study(file)
    folder = check_folder(out, loaded.name)
    status = run_calibration(
        loaded,
        folder,
        records=records,
        models=models,
        workers=workers,
        fresh=fresh,
        report=not no_report,
        console=Console(stderr=True),
    )
    typer.echo(folder if no_report else folder / "report.html")
    return status
