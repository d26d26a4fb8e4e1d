"""Define `bayesdamp completion`, which prints the script with which a shell completes commands and options."""

from __future__ import annotations

from typing import Annotated

import typer
from typer.completion import get_completion_script  # pyright: ignore[reportPrivateImportUsage]

from bayesdamp.plugins import nearest
from bayesdamp.types import InputError

SHELLS = ["bash", "zsh", "fish"]
VARIABLE = "_BAYESDAMP_COMPLETE"
"""Environment variable with which the shell asks the program to complete a command line."""


def completion(
    shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.")],
) -> int:
    """Print the shell's completion script."""
    if shell not in SHELLS:
        raise InputError(f"completion {shell}: unknown shell{nearest(shell, SHELLS)}")
    typer.echo(get_completion_script(prog_name="bayesdamp", complete_var=VARIABLE, shell=shell))
    return 0
