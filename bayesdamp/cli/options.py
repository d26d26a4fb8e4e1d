"""Options that several commands have: how files are read, how a run goes, what is said."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.types import InputError

READING, WEIGHED, RUNNING, SAID = "Reading the file", "What is weighed", "The run", "What is said"
"""Groups of options."""

Angle = Annotated[
    str | None,
    typer.Option(help="Column of the recorded quantity, by name or number from 1.", rich_help_panel=READING),
]
Time = Annotated[
    str | None, typer.Option(help="Column of the times, by name or number.", rich_help_panel=READING)
]
TimeUnit = Annotated[
    str | None, typer.Option(help="Unit of the times: s, ms, us, ns or min.", rich_help_panel=READING)
]
Rate = Annotated[
    float | None, typer.Option(help="Sampling rate in Hz, for a file without times.", rich_help_panel=READING)
]
Unit = Annotated[
    str | None,
    typer.Option(
        help="rad, deg, m, mm, V, g and others (a wrong one lists them): of the displacement itself, or g, rpm, dps; "
        "else as the file says, else rad, or deg or counts where the values are too large for that.",
        rich_help_panel=READING,
    ),
]
Quantity = Annotated[
    str | None,
    typer.Option(
        help="angle (any displacement), velocity or acceleration; compare and look: envelope too (amplitude, power or "
        "level alone); else as the file says, else angle.",
        rich_help_panel=READING,
    ),
]
Clock = Annotated[str, typer.Option(help="auto, as_logged or uniform.", rich_help_panel=READING)]
Start = Annotated[
    str, typer.Option(help="Where the free decay starts, in s, or auto.", rich_help_panel=READING)
]
Stop = Annotated[str, typer.Option(help="Where it stops, in s, or auto.", rich_help_panel=READING)]
Runs = Annotated[
    str | None,
    typer.Option(help="Runs of a file that has several: 1,3-5; all by default.", rich_help_panel=READING),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channel",
        help="A channel of a file that has several, may be given again.",
        rich_help_panel=READING,
    ),
]
Plugins = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        help="A Python file with plug-ins of your own; may be given again.",
        rich_help_panel=WEIGHED,
    ),
]
Out = Annotated[
    Path | None, typer.Option(help="The folder to write; by default reports/NAME.", rich_help_panel=RUNNING)
]
Workers = Annotated[
    int | None, typer.Option(min=1, help="Processes; as many as cores by default.", rich_help_panel=RUNNING)
]
Scheduler = Annotated[
    str | None,
    typer.Option(help="Address of a Dask scheduler whose workers share the work.", rich_help_panel=RUNNING),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Compute everything again.", rich_help_panel=RUNNING)]
Quick = Annotated[
    bool,
    typer.Option(
        "--quick",
        help="Only the answer, within seconds; no sampling to confirm it.",
        rich_help_panel=RUNNING,
    ),
]
Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="The answer and what failed; nothing else.", rich_help_panel=SAID),
]
AsJson = Annotated[
    bool,
    typer.Option("--json", help="The verdicts as JSON, as in verdict.json.", rich_help_panel=SAID),
]


LONGEST = 40
"""Characters of a wrong value that are repeated."""


def wrong(option: str, value: object, right: str) -> InputError:
    """The one line on a wrong value of an option: what it is, and what it must be."""
    shown = repr(value[:LONGEST]) if isinstance(value, str) else f"{value:g}"
    return InputError(f"{option}: is {shown}; it must be {right}")


def bound(text: str, option: str) -> float | str:
    """A time in s, or "auto". Raises InputError."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise wrong(option, text, "a time in s, or auto") from None
