"""Options that several commands have: how files are read, how a run goes, what is said."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.types import InputError

READING, WEIGHED, RUNNING, SAID = "Reading the file", "What is weighed", "The run", "What is said"
"""Groups of options."""


def option(group: str, text: str, *names: str, **more: Any) -> Any:
    """Return an option of a group with its help."""
    return typer.Option(*names, help=text, rich_help_panel=group, **more)


Angle = Annotated[str | None, option(READING, "Column of the recorded quantity, by name or number from 1.")]
Time = Annotated[str | None, option(READING, "Column of the times, by name or number.")]
TimeUnit = Annotated[str | None, option(READING, "Unit of the times: s, ms, us, ns or min.")]
Rate = Annotated[float | None, option(READING, "Sampling rate in Hz, for a file without times.")]
Unit = Annotated[
    str | None,
    option(
        READING,
        "rad, deg, m, mm, V, g and others (a wrong one lists them): of the displacement itself, or g, rpm, dps; "
        "else as the file says, else rad, or deg or counts where the values are too large for that.",
    ),
]
Quantity = Annotated[
    str | None,
    option(
        READING,
        "angle (any displacement), velocity or acceleration; compare and look: envelope too (amplitude, power or "
        "level alone); else as the file says, else angle.",
    ),
]
Clock = Annotated[str, option(READING, "auto, as_logged or uniform.")]
Start = Annotated[str, option(READING, "Where the free decay starts, in s, or auto.")]
Stop = Annotated[str, option(READING, "Where it stops, in s, or auto.")]
Runs = Annotated[str | None, option(READING, "Runs of a file that has several: 1,3-5; all by default.")]
Channels = Annotated[
    list[str] | None,
    option(READING, "A channel of a file that has several, may be given again.", "--channel"),
]
Plugins = Annotated[
    list[Path] | None,
    option(WEIGHED, "A Python file with plug-ins of your own; may be given again.", "--plugin"),
]
Out = Annotated[Path | None, option(RUNNING, "The folder to write; by default reports/NAME.")]
Workers = Annotated[int | None, option(RUNNING, "Processes; as many as cores by default.", min=1)]
Scheduler = Annotated[
    str | None, option(RUNNING, "Address of a Dask scheduler whose workers share the work.")
]
Fresh = Annotated[bool, option(RUNNING, "Compute everything again.", "--fresh")]
Quick = Annotated[
    bool, option(RUNNING, "Only the answer, within seconds; no sampling to confirm it.", "--quick")
]
Quiet = Annotated[bool, option(SAID, "The answer and what failed; nothing else.", "--quiet", "-q")]
AsJson = Annotated[bool, option(SAID, "The verdicts as JSON, as in verdict.json.", "--json")]


LONGEST = 40
"""Characters of a wrong value that are repeated."""


def wrong(option: str, value: object, right: str) -> InputError:
    """The one line on a wrong value of an option: what it is, and what it must be."""
    shown = repr(value[:LONGEST]) if isinstance(value, str) else f"{value:g}"
    return InputError(f"{option}: is {shown}; it must be {right}")


def bound(text: float | str, name: str) -> float | str:
    """Return a time in s, or "auto". Raises InputError."""
    if text == "auto":
        return text
    try:
        if math.isfinite(number := float(text)):
            return number
    except ValueError:
        pass
    raise wrong(name, text, "a time in s, or auto")
