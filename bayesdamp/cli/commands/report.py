"""`bayesdamp report`: a run's folder rendered again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.types import InputError


def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run's folder.")]) -> int:
    """Render a run's folder again; nothing is computed."""
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder of a run, such as reports/NAME")
    from bayesdamp.report import render

    typer.echo(render(folder))
    return 0
