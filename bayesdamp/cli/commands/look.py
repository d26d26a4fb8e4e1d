"""`bayesdamp look`: what would be read of a file, before anything is computed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.single_file import LOOK_PAGE, SingleFile
from bayesdamp.types import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bayesdamp.cli.asking import Found
    from bayesdamp.records.files.contents import Contents

COLUMNS, PLOTS, FACTS = 24, 4, 12
"""Of each, how many are shown before the rest is counted."""
NARROWEST = 10
"""Characters of a plot."""


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
    plugin: o.Plugins = None,
    html: Annotated[Path | None, typer.Option(help="A page to write it to as well.")] = None,
) -> int:
    """Show what would be read of a file: columns, units, clock, the free decay in it, and what looks wrong."""
    from rich.console import Console

    from bayesdamp.cli.asking import Options, doubts, found_records
    from bayesdamp.cli.looking.envelope import envelope_asked
    from bayesdamp.cli.open_questions import one_command
    from bayesdamp.plugins import read_modules, use
    from bayesdamp.records.opening.opening import contents

    page = SingleFile(html, LOOK_PAGE, "--html", (file, *(plugin or ()))) if html is not None else None
    if page is not None:
        page.check()
    use(read_modules(plugin or ()))

    if envelope_asked(file, angle, unit, quantity):
        if page is not None:
            raise InputError("--html: is for oscillations; bayesdamp compare draws the page of an envelope")
        ends = o.bound(start, "--start"), o.bound(stop, "--stop")
        _show_envelope(Console(), file, (time, angle, rate, unit), ends)
        return 0
    columns = time, angle, rate, time_unit
    asked = Options.of(columns, unit, quantity, clock, (start, stop), runs, channel)
    console = Console()
    held = contents(file)
    try:
        found = found_records(file, asked)
    except InputError:
        _show_file(console, file, held)
        raise
    for line in [*doubts(file, found), *one_command([(one.path, one.raw) for one in found], asked)]:
        console.print(f"! {line}", style="yellow", markup=False, highlight=False)
    _show_file(console, file, held)
    for i, one in enumerate(found):
        _show_record(console, one, len(found) > 1, i < PLOTS)
    if page is not None:
        from bayesdamp.cli.looking.page import page_of

        page.write(page_of(file, held, found))
        typer.echo(html)
    return 0


def _width(console: Console) -> int:
    """Characters of a plot's rows; a terminal may say that it has none."""
    return max(NARROWEST, min(console.width, 100) - 2)


def _show_file(console: Console, file: Path, held: Contents) -> None:
    from bayesdamp.cli.looking.said import described

    table = described(held)
    first = replace(table, lines=table.lines[:COLUMNS])
    console.print(first.rich(title=f"{file.name}: {held.format}", title_justify="left"))
    if len(held.columns) > COLUMNS:
        console.print(f"and {len(held.columns) - COLUMNS} more columns", style="bright_black")
    for name, value in list(held.facts.items())[:FACTS]:
        console.print(f"{name}: {value}", style="bright_black", markup=False, highlight=False)


def _show_envelope(
    console: Console,
    file: Path,
    columns: tuple[str | None, str | None, float | None, str | None],
    ends: tuple[float | str, float | str],
) -> None:
    from bayesdamp.cli.looking.envelope import looked_at
    from bayesdamp.cli.looking.plot import plot
    from bayesdamp.records.opening.opening import contents

    _show_file(console, file, contents(file))
    seen = looked_at(file, *columns, *ends)
    console.print(f"\n{seen.title}", style="bold", markup=False, highlight=False)
    for line in seen.lines:
        console.print(f"  {line}", markup=False, highlight=False)
    console.print(plot(seen.t, seen.y, seen.kept, _width(console)))


def _show_record(console: Console, one: Found, several: bool, drawn: bool) -> None:
    from bayesdamp.cli.looking.plot import plot
    from bayesdamp.cli.looking.said import curve, kept, reading, sentences

    title = one.label if several else f"{one.raw.channel or 'the record'}"
    console.print(f"\n{title}: {reading(one)}", style="bold", markup=False, highlight=False)
    for line in sentences(one):
        console.print(f"  {line}", markup=False, highlight=False)
    if drawn:
        console.print(plot(*curve(one), kept(one), _width(console)))
