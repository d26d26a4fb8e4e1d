"""Define `bayesdamp study`, which runs a study file."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from bayesdamp.cli import options as o
from bayesdamp.cli.files import check_folder
from bayesdamp.cli.runs import FEW_RECORDS, read_study, run_and_print
from bayesdamp.config import in_keys
from bayesdamp.pipeline.jobs import Depth
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.terminal import print_conclusion, print_warnings


def study(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A study file (TOML), the name of a study of the package, or the run.json of a run.",
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
    """Run the tasks of a study file that have no stored result yet, and write the report."""
    loaded = read_study(file, plugin)
    folder = check_folder(out, loaded.name)

    def finish(folder: Path, console: Console) -> None:
        if not (page := folder / "report.html").is_file():
            return
        run = RunFolder(folder)
        if run.verdicts and len(loaded.signals) > FEW_RECORDS:
            print_conclusion(folder, console)
        else:
            print_warnings(run, console)
            typer.echo(page)

    depth = Depth.ANSWER if quick else Depth.WHOLE
    options = {"workers": workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet}
    with in_keys():
        return run_and_print(loaded, folder, depth, finish, as_json=as_json, **options)
