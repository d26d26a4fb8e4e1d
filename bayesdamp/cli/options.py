"""Define the options that several commands share, and check the values of options and the paths that they name.

A command overwrites a file only if an earlier run of the same command wrote it.
"""

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.formatting import show
from bayesdamp.store.files import refuse_special
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


def check_folder(out: Path | None, name: str) -> Path:
    """Return the folder of a run, `out` or by default reports/`name`, and check that it can be a folder.

    The folder is not created.

    Raises
    ------
    InputError
        If the path, or the nearest folder above it that exists, is not a folder.
    OSError
        If the operating system refuses the path.
    """
    folder = Path("reports") / name if out is None else out
    present = next(p for p in (folder, *folder.absolute().parents) if p.is_symlink() or p.exists())
    if not present.is_dir():
        what = f"the results would be written to {str(folder)!r}, and {present} is not a folder"
        raise InputError(f"{what}; give another folder with --out")
    return folder


def check_names(paths: Sequence[Path]) -> None:
    """Raise InputError if a file name is not valid UTF-8, because run.json must contain the names of its inputs."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise InputError(f"{path}: the file name is not valid UTF-8; rename the file") from None


def check_replaceable(path: Path, first_line: str) -> None:
    """Raise InputError if a path exists but is not a regular file that begins with `first_line`."""
    refuse_special(path)
    if path.exists():
        with path.open("rb") as handle:
            head = handle.read(len(first_line))
        if head != first_line.encode():
            what = "already exists and was not made by bayesdamp"
            raise InputError(f"--out {path}: {what}; give another name, or delete that file")
