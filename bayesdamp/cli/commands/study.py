"""`bayesdamp study`: run what a study still lacks, and write its report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.asked import FIRST_WORDS, compiles_first, read_study, run_folder, units_of
from bayesdamp.cli.verdicts import verdicts_json


def study(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A study file (TOML), the name of one that ships, or a run's run.json."
        ),
    ],
    out: o.Out = None,
    workers: o.Workers = None,
    scheduler: o.Scheduler = None,
    plugin: o.Plugins = None,
    fresh: o.Fresh = False,
    quick: o.Quick = False,
    quiet: o.Quiet = False,
    as_json: o.AsJson = False,
) -> int:
    """Run what a study still lacks, and write its report."""
    from rich.console import Console

    loaded = read_study(file, plugin)
    folder = run_folder(out, loaded.name)
    if (once := compiles_first()) and not quiet:
        typer.echo(once, err=True)
    from bayesdamp.config import in_keys
    from bayesdamp.pipeline import Depth, run_study
    from bayesdamp.report.terminal import Lasting, Told, beware

    shown = Lasting()
    with in_keys():
        status = run_study(
            loaded,
            folder,
            workers=workers,
            scheduler=scheduler,
            fresh=fresh,
            console=Console(stderr=True),
            depth=Depth.ANSWER if quick else Depth.WHOLE,
            answered=None if as_json or len(loaded.signals) > FIRST_WORDS else Told(shown, units_of(loaded)),
            quiet=quiet,
        )
    report = folder / "report.html"
    if as_json:
        typer.echo(verdicts_json(folder))
    elif report.is_file():
        beware(folder, shown)
        typer.echo(report)
    return status
