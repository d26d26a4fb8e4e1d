"""`bayesdamp study`: run what a study still lacks, and write its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli.asked import FIRST_WORDS, read_study, run_folder, units_of
from bayesdamp.cli.options import RUNNING, SAID, WEIGHED
from bayesdamp.cli.verdicts import verdicts_json


def study(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A study file (TOML), the name of one that ships, or a run's run.json."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="The run's folder; reports/NAME where it is not given.", rich_help_panel=RUNNING),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Processes; as many as there are cores where it is not given.",
            rich_help_panel=RUNNING,
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler to run on.", rich_help_panel=RUNNING)
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(
            help="A Python file with plug-ins of your own; may be given again.", rich_help_panel=WEIGHED
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Compute everything again.", rich_help_panel=RUNNING)
    ] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the answers; no sampling.", rich_help_panel=RUNNING)
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option("--quiet", "-q", help="The answer and what failed; nothing else.", rich_help_panel=SAID),
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="The verdicts as JSON, as in verdict.json.", rich_help_panel=SAID),
    ] = False,
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
        answered=None if as_json or len(loaded.signals) > FIRST_WORDS else Told(Console(), units_of(loaded)),
        quiet=quiet,
    )
    report = folder / "report.html"
    if as_json:
        typer.echo(verdicts_json(folder))
    elif report.is_file():
        typer.echo(report)
    return status
