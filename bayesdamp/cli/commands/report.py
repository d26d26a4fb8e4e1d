"""Define `bayesdamp report`, which writes the report of a run again."""

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.report.sections import render
from bayesdamp.types import InputError


def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a run.")]) -> int:
    """Write the report of a run again; nothing is computed."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give the folder of a run, such as reports/NAME")
    typer.echo(render(folder))
    return 0
