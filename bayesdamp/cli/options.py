"""Options that say how files are read, the same for every command."""

from __future__ import annotations

from typing import Annotated

import typer

from bayesdamp.types import InputError

_GROUP = "Reading the file"

Angle = Annotated[
    str | None,
    typer.Option(help="Column of the recorded quantity, by name or number from 1.", rich_help_panel=_GROUP),
]
Time = Annotated[
    str | None, typer.Option(help="Column of the times, by name or number.", rich_help_panel=_GROUP)
]
TimeUnit = Annotated[
    str | None, typer.Option(help="Unit of the times: s, ms, us, ns or min.", rich_help_panel=_GROUP)
]
Rate = Annotated[
    float | None, typer.Option(help="Sampling rate in Hz, for a file without times.", rich_help_panel=_GROUP)
]
Unit = Annotated[
    str | None,
    typer.Option(help="Unit of the displacement; else as the file says, else rad.", rich_help_panel=_GROUP),
]
Quantity = Annotated[
    str | None,
    typer.Option(
        help="angle, velocity or acceleration; else as the file says, else angle.", rich_help_panel=_GROUP
    ),
]
Clock = Annotated[str, typer.Option(help="auto, as_logged or uniform.", rich_help_panel=_GROUP)]
Start = Annotated[
    str, typer.Option(help="Where the free decay starts, in s, or auto.", rich_help_panel=_GROUP)
]
Stop = Annotated[str, typer.Option(help="Where it stops, in s, or auto.", rich_help_panel=_GROUP)]
Runs = Annotated[
    str | None,
    typer.Option(help="Runs of a file that has several: 1,3-5; all by default.", rich_help_panel=_GROUP),
]
Channels = Annotated[
    list[str] | None,
    typer.Option(
        "--channel",
        help="A channel of a file that has several, may be given again.",
        rich_help_panel=_GROUP,
    ),
]


def bound(text: str, option: str) -> float | str:
    """A time in s, or "auto". Raises InputError."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option} {text}: must be a time in s, or auto") from None
