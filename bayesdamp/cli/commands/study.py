"""`bayesdamp study`: run what a study still lacks, and write its report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.asked import read_study, run_asked, run_folder

if TYPE_CHECKING:
    from rich.console import Console


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
    loaded = read_study(file, plugin)
    folder = run_folder(out, loaded.name)
    from bayesdamp.config import in_keys
    from bayesdamp.pipeline import Depth

    depth = Depth.ANSWER if quick else Depth.WHOLE
    how = {"workers": workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet, "as_json": as_json}
    with in_keys():
        return run_asked(loaded, folder, depth, _finish, **how)


def _finish(folder: Path, shown: Console) -> None:
    from bayesdamp.report.terminal import beware

    if (report := folder / "report.html").is_file():
        beware(folder, shown)
        typer.echo(report)
