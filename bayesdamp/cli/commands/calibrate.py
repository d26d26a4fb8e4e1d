"""`bayesdamp calibrate`: are the intervals what they say?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.asked import read_study, run_folder


def calibrate(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="The run's folder; reports/NAME where it is not given.")
    ] = None,
    models: Annotated[
        bool, typer.Option("--models", help="Put the probabilities of the models to the test.")
    ] = False,
    records: Annotated[
        int | None,
        typer.Option(min=1, help="Records of each model (of all with --models); else the study's."),
    ] = None,
    workers: o.Workers = None,
    fresh: o.Fresh = False,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Leave report.html to `bayesdamp report`.")
    ] = False,
) -> int:
    """Are the intervals what they say? Draw from a study's own prior, simulate, infer, compare with the truth."""
    from rich.console import Console

    loaded = read_study(file)
    folder = run_folder(out, loaded.name)
    from bayesdamp.calibrate import run_calibration

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
