"""`bayesdamp study`: run what a study still lacks, and write its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli.asked import FIRST_WORDS, read_study, run_folder


def study(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="The run's folder; reports/NAME where it is not given.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as there are cores where it is not given.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to run on.")] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="A Python file with plug-ins of your own; may be given again."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute everything again.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Only the answers; no sampling.")] = False,
) -> int:
    """Run what a study still lacks, and write its report."""
    from rich.console import Console

    loaded = read_study(file, plugin)
    folder = run_folder(out, loaded.name)
    from bayesdamp.pipeline import Depth, run_study
    from bayesdamp.report.terminal import Told

    status = run_study(
        loaded,
        folder,
        workers=workers,
        scheduler=scheduler,
        fresh=fresh,
        console=Console(stderr=True),
        depth=Depth.ANSWER if quick else Depth.WHOLE,
        answered=None if len(loaded.signals) > FIRST_WORDS else Told(Console()),
    )
    report = folder / "report.html"
    if report.is_file():
        typer.echo(report)
    return status
