"""Define the options that several commands share: for reading files, for the run, and for the output."""

import math
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.formatting import show
from bayesdamp.types import InputError


def _option(group: str, text: str, *names: str, **more: Any) -> Any:
    """Define an option of a command for Typer.

    Parameters
    ----------
    group
        Heading under which the help lists the option.
    text
        Help text of the option.
    *names
        Names of the option, such as "--repeats"; by default it has the name of the argument.
    **more
        Further arguments of `typer.Option`.
    """
    return typer.Option(*names, help=text, rich_help_panel=group, **more)


reading, compared, running, output = (
    partial(_option, group) for group in ("Reading the file", "What is compared", "The run", "Output")
)
"""Functions that define an option (see `_option`), one for each heading in the help."""


StudyFile = Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")]
Plugins = Annotated[
    list[Path] | None,
    compared(
        "A Python file with your own damping terms, readers or other plug-ins; may be repeated.", "--plugin"
    ),
]
Out = Annotated[
    Path | None, running("The folder for the results; by default reports/NAME, with the study's name.")
]
Workers = Annotated[int | None, running("Number of processes; by default one for each core.", min=1)]
Scheduler = Annotated[str | None, running("Address of a Dask scheduler whose workers share the work.")]
Fresh = Annotated[
    bool, running("Compute everything again, and do not use stored results of this run.", "--fresh")
]
Quick = Annotated[
    bool,
    running(
        "Compute only the answer from linearised motions, without sampling the posterior; takes seconds.",
        "--quick",
    ),
]
Quiet = Annotated[bool, output("Print only the answer and errors.", "--quiet", "-q")]
AsJson = Annotated[bool, output("Print the verdicts as JSON, as in verdict.json.", "--json")]


def parse_time(text: float | str, name: str) -> float | str:
    """Convert the value of the option `name` (--start or --stop) to a finite time in s; "auto" is returned unchanged.

    Raises InputError for any other text.
    """
    if text == "auto":
        return text
    try:
        if math.isfinite(number := float(text)):
            return number
    except ValueError:
        pass
    raise InputError(f"{name}: is {show(text)}; it must be a time in s, or auto")
