"""`bayesdamp init`: write a commented study that compares files as `bayesdamp compare` does."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.arguments import check_names
from bayesdamp.cli.records import ReadingOptions, as_signals, chosen_records
from bayesdamp.cli.study_file import study_text
from bayesdamp.config.checks import StudyError
from bayesdamp.store.files import create, no_room
from bayesdamp.types import InputError


def init(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE...", help="Files of measured decays, all in one folder.")
    ],
    angle: o.Angle = None,
    time: o.Time = None,
    time_unit: o.TimeUnit = None,
    rate: o.Rate = None,
    unit: o.Unit = None,
    quantity: o.Quantity = None,
    clock: o.Clock = "auto",
    start: o.Start = "auto",
    stop: o.Stop = "auto",
    runs: o.Runs = None,
    channel: o.Channels = None,
) -> int:
    """Write a commented study of files next to them; nothing is computed, and no file is overwritten."""
    check_names(files)
    file = files[0]
    if len({path.absolute().parent for path in files}) > 1:
        raise InputError(
            f"{files[-1]}: is in another folder than {file}; a study reads files in its own folder"
        )
    if not file.name:
        raise InputError(f"{file}: is a folder, not a file; give one of the files in it")
    out = file.with_suffix(".toml")
    taken = InputError(f"{out}: already exists and is not overwritten; move it away first")
    if os.path.lexists(out):
        raise taken
    options = ReadingOptions(
        time, angle, rate, time_unit, unit, quantity, clock, start, stop, runs, channel or ()
    )
    chosen = chosen_records(files, options, every=True)
    for line in [*chosen.doubted, *chosen.notes]:
        typer.echo(line, err=True)
    try:
        text = study_text(as_signals(chosen.records, options), out)
    except StudyError as error:
        raise InputError(f"{file}: {error}") from None
    try:
        create(out, text.encode())
    except FileExistsError:
        raise taken from None
    except OSError as error:
        if no_room(error):
            raise
        what = (error.strerror or str(error)).lower()
        raise InputError(
            f"{out}: cannot be written: {what}; copy {file.name} to a folder of your own"
        ) from None
    typed = shlex.quote(str(out))
    typer.echo(f"{out}: next, bayesdamp check {typed} and bayesdamp study {typed}")
    return 0
