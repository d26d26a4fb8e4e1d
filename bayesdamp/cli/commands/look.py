"""`bayesdamp look`: what would be read of a file, before anything is computed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp.cli import options as o

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console

    from bayesdamp.cli.asking import Found
    from bayesdamp.records.files.contents import Contents

COLUMNS, PLOTS, FACTS = 24, 4, 12
"""Of each, how many are shown before the rest is counted."""


def look(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of measured decays.")],
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
    html: Annotated[Path | None, typer.Option(help="A page to write it to as well.")] = None,
) -> int:
    """Show what would be read of a file: columns, units, clock, the free decay in it, and what looks wrong."""
    from rich.console import Console

    from bayesdamp.cli.asking import Options, found_records
    from bayesdamp.records.opening.opening import contents

    bounds = o.bound(start, "--start"), o.bound(stop, "--stop")
    asked = Options(time, angle, rate, time_unit, unit, quantity, clock, *bounds, runs, tuple(channel or ()))
    console = Console()
    held = contents(file)
    _show_file(console, file, held)
    found = found_records(file, asked)
    for i, one in enumerate(found):
        _show_record(console, one, len(found) > 1, i < PLOTS)
    if html is not None:
        from bayesdamp.cli.look_page import write_page

        write_page(html, file, held, found)
        typer.echo(html)
    return 0


def _show_file(console: Console, file: Path, held: Contents) -> None:
    from rich.table import Table

    table = Table(
        "",
        "column",
        "unit",
        "samples",
        "from",
        "to",
        title=f"{file.name}: {held.format}",
        title_justify="left",
    )
    for row in described(held)[:COLUMNS]:
        table.add_row(*row)
    console.print(table)
    if len(held.columns) > COLUMNS:
        console.print(f"and {len(held.columns) - COLUMNS} more columns", style="bright_black")
    for name, value in list(held.facts.items())[:FACTS]:
        console.print(f"{name}: {value}", style="bright_black", markup=False, highlight=False)


def described(held: Contents) -> list[tuple[str, ...]]:
    """A row for each column: number, name, unit, samples, first and largest values."""
    import numpy as np

    from bayesdamp.records.columns.names import seconds_of_unit
    from bayesdamp.records.columns.units_said import unit_said
    from bayesdamp.units import UNITS

    rows = []
    for i, column in enumerate(held.columns, start=1):
        unit, quantity = unit_said(column)
        said = UNITS[unit].of(quantity or "angle") if unit in UNITS else unit
        said = "s" if not said and seconds_of_unit(column) else said
        y = column.values[np.isfinite(column.values)]
        ends = (f"{y.min():.6g}", f"{y.max():.6g}") if y.size else ("", "")
        rows.append((str(i), column.name or "-", said or "-", str(y.size), *ends))
    return rows


def _show_record(console: Console, one: Found, several: bool, drawn: bool) -> None:
    from bayesdamp.cli.plot import plot

    title = one.label if several else f"{one.raw.channel or 'the record'}"
    console.print(f"\n{title}: {reading(one)}", style="bold", markup=False, highlight=False)
    for line in sentences(one):
        console.print(f"  {line}", markup=False, highlight=False)
    for finding in one.findings:
        console.print(f"  ! {finding}", style="yellow", markup=False, highlight=False)
    if drawn:
        console.print(plot(*curve(one), kept(one), min(console.width, 100) - 2))


def reading(one: Found) -> str:
    """What a record is read as, in a line."""
    from bayesdamp.units import UNITS

    unit = UNITS[one.unit].of(one.quantity) if one.unit in UNITS else one.unit
    time, value = one.raw.columns
    clock = f"times from column {time!r}" if time is not None else f"{one.raw.rate or 0:.6g} Hz"
    return f"column {value!r} as {one.quantity} in {unit}, {clock}, {one.raw.y.size} samples"


def sentences(one: Found) -> list[str]:
    """What was done to a record, or why there is no free decay in it."""
    notes = (one.signal.provenance if one.signal else one.raw.provenance).get("notes", [])
    said = [str(note) for note in notes] if isinstance(notes, list | tuple) else []
    return said if one.signal else [*said, f"No free decay: {one.refusal}"]


def curve(one: Found) -> tuple[np.ndarray, np.ndarray]:
    """Times in s (n,) and values (n,) in the file's unit."""
    import numpy as np

    raw = one.raw
    t = raw.t if raw.t is not None else np.arange(raw.y.size) / (raw.rate or 1.0)
    return t, raw.y


def kept(one: Found) -> tuple[float, float] | None:
    """From when to when the free decay lasts, in s of `curve`."""
    if one.signal is None:
        return None
    first, last = one.signal.provenance["start"], one.signal.provenance["stop"]
    return (first, last) if isinstance(first, float) and isinstance(last, float) else None
