"""Options that say how files are read, the same for every command."""

from __future__ import annotations

from typing import Annotated

import typer

from bayesdamp.types import InputError

Angle = Annotated[str | None, typer.Option(help="Column of the recorded quantity, by name or number from 1.")]
Time = Annotated[str | None, typer.Option(help="Column of the times, by name or number.")]
TimeUnit = Annotated[str | None, typer.Option(help="Unit of the times: s, ms, us, ns or min.")]
Rate = Annotated[float | None, typer.Option(help="Sampling rate in Hz, for a file without times.")]
Unit = Annotated[str | None, typer.Option(help="Unit of the displacement; else as the file says, else rad.")]
Quantity = Annotated[
    str | None, typer.Option(help="angle, velocity or acceleration; else as the file says, else angle.")
]
Clock = Annotated[str, typer.Option(help="auto, as_logged or uniform.")]
Start = Annotated[str, typer.Option(help="Where the free decay starts, in s, or auto.")]
Stop = Annotated[str, typer.Option(help="Where it stops, in s, or auto.")]
Runs = Annotated[str | None, typer.Option(help="Runs of a file that has several: 1,3-5; all by default.")]
Channels = Annotated[
    list[str] | None,
    typer.Option("--channel", help="A channel of a file that has several, may be given again."),
]


def bound(text: str, option: str) -> float | str:
    """A time in s, or "auto". Raises InputError."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option} {text}: must be a time in s, or auto") from None
