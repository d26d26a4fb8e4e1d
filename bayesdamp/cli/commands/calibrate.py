"""Define `bayesdamp calibrate`, which checks the intervals of a study with simulated records."""

from typing import Annotated

import typer
from rich.console import Console

from bayesdamp.calibrate.run import run_calibration
from bayesdamp.cli import options as o
from bayesdamp.cli.files import check_folder
from bayesdamp.cli.runs import read_study


def calibrate(
    file: o.StudyFile,
    out: o.Out = None,
    models: Annotated[
        bool,
        typer.Option(
            "--models",
            help="Check the probabilities of the damping models instead of the intervals of parameters.",
        ),
    ] = False,
    records: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Number of simulated records for each model (with --models: for all models together); by default as "
            "in the study.",
        ),
    ] = None,
    workers: o.Workers = None,
    fresh: o.Fresh = False,
    no_report: Annotated[
        bool,
        typer.Option("--no-report", help="Do not write report.html; `bayesdamp report` writes it later."),
    ] = False,
) -> int:
    """Check the credible intervals on simulated records, whose true parameters are drawn from the study's prior."""
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
