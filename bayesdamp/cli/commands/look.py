"""Define `bayesdamp look`, which shows how a file is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from bayesdamp.cli import looking, options as o
from bayesdamp.cli.records import ReadingOptions, doubt_lines, records_in, with_reading_options
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.records.columns import separate_clocks
from bayesdamp.records.envelope.record import are_envelopes
from bayesdamp.records.opening import read_contents
from bayesdamp.types import InputError

MOST_COLUMNS, MOST_PLOTS, MOST_FACTS = 24, 4, 12
"""Largest numbers of a file's columns, of plots of its records, and of facts from its header that are shown in the
terminal; the others are left out."""
NARROWEST_PLOT = 10
"""Smallest width of a plot in characters, used if the terminal is narrower."""


@with_reading_options
def look(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A file of measured decays.")],
    plugin: o.Plugins = None,
    **reading: Any,
) -> int:
    """Show how a file is read: columns, units, clock, the free decay in it, and what looks wrong."""
    use_modules(read_modules(plugin or ()))

    console, content = Console(), separate_clocks(read_contents(file))

    def show_file() -> None:
        table = looking.columns_table(content)
        first = replace(table, lines=table.lines[:MOST_COLUMNS])
        console.print(first.rich(title=f"{file.name}: {content.format}", title_justify="left"))
        if len(content.columns) > MOST_COLUMNS:
            console.print(f"and {len(content.columns) - MOST_COLUMNS} more columns", style="bright_black")
        for name, value in list(content.facts.items())[:MOST_FACTS]:
            console.print(f"{name}: {value}", style="bright_black", markup=False, highlight=False)

    if are_envelopes([file], reading["angle"], reading["unit"], reading["quantity"]):
        options = {name: reading[name] for name in ("time", "rate", "unit")}
        ends = o.parse_time(reading["start"], "--start"), o.parse_time(reading["stop"], "--stop")
        views = [looking.view_envelope(file, ends, value=reading["angle"], **options)]
        show_file()
    else:
        options = ReadingOptions(**reading)
        try:
            every = records_in(file, options)
        except InputError:
            show_file()
            raise
        for line in doubt_lines(file, every):
            console.print(f"! {line}", style="yellow", markup=False, highlight=False)
        views = [looking.view_motion(record) for record in every]
        show_file()
    for i, view in enumerate(views):
        console.print(f"\n{view.name}: {view.reading}", style="bold", markup=False, highlight=False)
        for line in view.lines:
            console.print(f"  {line}", markup=False, highlight=False)
        if i < MOST_PLOTS:
            # The width of a terminal may be reported as 0.
            width = max(NARROWEST_PLOT, min(console.width, 100) - 2)
            console.print(looking.plot(view.t, view.y, view.window, width))
    return 0
