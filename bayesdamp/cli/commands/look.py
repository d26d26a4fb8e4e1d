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

    from bayesdamp.cli.looking.said import Shown
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
    from bayesdamp.cli.looking.said import shown_motion
    from bayesdamp.cli.open_questions import one_command
    from bayesdamp.plugins import read_modules, use
    from bayesdamp.records.envelope.reading import are_envelopes
    from bayesdamp.records.opening import contents

    page = SingleFile(html, LOOK_PAGE, "--html", (file, *(plugin or ()))) if html is not None else None
    if page is not None:
        page.check()
    use(read_modules(plugin or ()))

    console, held = Console(), contents(file)
    if are_envelopes([file], angle, unit, quantity):
        from bayesdamp.cli.looking.envelope import shown_envelope

        ends = o.bound(start, "--start"), o.bound(stop, "--stop")
        shown = [shown_envelope(file, (time, angle, rate, unit), ends)]
        _show_file(console, file, held)
    else:
        asked = Options(time, angle, rate, time_unit, unit, quantity, clock, start, stop, runs, channel or ())
        try:
            found = found_records(file, asked)
        except InputError:
            _show_file(console, file, held)
            raise
        for line in [*doubts(file, found), *one_command([(one.path, one.raw) for one in found], asked)]:
            console.print(f"! {line}", style="yellow", markup=False, highlight=False)
        shown = [shown_motion(one, len(found) > 1) for one in found]
        _show_file(console, file, held)
    for i, one in enumerate(shown):
        _show_record(console, one, i < PLOTS)
    if page is not None:
        from bayesdamp.cli.looking.page import page_of

        page.write(page_of(file, held, shown))
        typer.echo(html)
    return 0


def _show_file(console: Console, file: Path, held: Contents) -> None:
    from bayesdamp.cli.looking.said import described

    table = described(held)
    first = replace(table, lines=table.lines[:COLUMNS])
    console.print(first.rich(title=f"{file.name}: {held.format}", title_justify="left"))
    if len(held.columns) > COLUMNS:
        console.print(f"and {len(held.columns) - COLUMNS} more columns", style="bright_black")
    for name, value in list(held.facts.items())[:FACTS]:
        console.print(f"{name}: {value}", style="bright_black", markup=False, highlight=False)


def _show_record(console: Console, one: Shown, is_drawn: bool) -> None:
    from bayesdamp.cli.looking.plot import plot

    console.print(f"\n{one.name}: {one.reading}", style="bold", markup=False, highlight=False)
    for line in one.lines:
        console.print(f"  {line}", markup=False, highlight=False)
    if is_drawn:
        # a terminal may say that it has no width
        console.print(plot(one.t, one.y, one.kept, max(NARROWEST, min(console.width, 100) - 2)))
