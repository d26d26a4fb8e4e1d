"""Define `bayesdamp look`, which shows how a file is read."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from bayesdamp.cli import options as o
from bayesdamp.cli.records import (
    MAYBE_ENVELOPE,
    FileRecord,
    ReadingOptions,
    doubt_lines,
    records_in,
    with_reading_options,
)
from bayesdamp.formatting import Table, time_span
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.records.columns import separate_clocks
from bayesdamp.records.envelope.record import are_envelopes, read_envelope
from bayesdamp.records.envelope.window import window_between
from bayesdamp.records.files.contents import SECONDS, Contents, seconds_of_unit, unit_of_column
from bayesdamp.records.oscillation.features import holes
from bayesdamp.records.oscillation.noise import coarse_period
from bayesdamp.records.read import read_contents
from bayesdamp.types import UNITS, InputError, Refusal

MOST_COLUMNS, MOST_PLOTS, MOST_FACTS = 24, 4, 12
"""Largest numbers of a file's columns, of plots of its records, and of facts from its header that are shown in the
terminal; the others are left out."""
NARROWEST_PLOT = 10
"""Smallest width of a plot in characters, used if the terminal is narrower."""
MOST_GAPS = 4
"""Largest number of times without samples in a record that are listed one by one; for the others, only their number is
given."""
PLOT_ROWS = 10
"""Height in lines of the plot of a record in the terminal."""
_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bit of each dot in the code of a Unicode braille character, by row and column of the dot."""


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
        table = columns_table(content)
        first = replace(table, lines=table.lines[:MOST_COLUMNS])
        console.print(first.rich(title=f"{file.name}: {content.format}", title_justify="left"))
        if len(content.columns) > MOST_COLUMNS:
            console.print(f"and {len(content.columns) - MOST_COLUMNS} more columns", style="bright_black")
        for name, value in list(content.facts.items())[:MOST_FACTS]:
            console.print(f"{name}: {value}", style="bright_black", markup=False, highlight=False)

    if are_envelopes([file], reading["angle"], reading["unit"], reading["quantity"]):
        options = {name: reading[name] for name in ("time", "rate", "unit")}
        ends = o.parse_time(reading["start"], "--start"), o.parse_time(reading["stop"], "--stop")
        views = [view_envelope(file, ends, value=reading["angle"], **options)]
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
        views = [view_motion(record) for record in every]
        show_file()
    for i, view in enumerate(views):
        console.print(f"\n{view.name}: {view.reading}", style="bold", markup=False, highlight=False)
        for line in view.lines:
            console.print(f"  {line}", markup=False, highlight=False)
        if i < MOST_PLOTS:
            # The width of a terminal may be reported as 0.
            width = max(NARROWEST_PLOT, min(console.width, 100) - 2)
            console.print(plot(view.t, view.y, view.window, width))
    return 0


@dataclass(frozen=True)
class RecordView:
    """The information on a record that `bayesdamp look` shows.

    Attributes
    ----------
    name
        Name of the record.
    reading
        Its columns, unit, quantity, clock and number of samples, in words.
    lines
        Sentences on how the record was cleaned and on its free decay.
    t, y
        Times in s and values in the unit of the file (dB for an envelope of levels), (n,), of the whole record.
    window
        Start and end in s of the part that is used (the free decay); None if there is none.
    """

    name: str
    reading: str
    lines: Sequence[str]
    t: np.ndarray
    y: np.ndarray
    window: tuple[float, float] | None


def columns_table(contents: Contents) -> Table:
    """Return a table with a row for each column: number from 1, name, unit, samples, smallest and largest value.

    Samples that are not finite are not counted.
    """
    rows = []
    for i, column in enumerate(contents.columns, start=1):
        unit, quantity = unit_of_column(column)
        shown = UNITS[unit].of(quantity or "angle") if unit in UNITS else unit
        seconds = seconds_of_unit(column)
        shown = shown or next((name for name, value in SECONDS.items() if value == seconds), "")
        y = column.values[np.isfinite(column.values)]
        ends = (f"{y.min():.6g}", f"{y.max():.6g}") if y.size else ("", "")
        rows.append((str(i), column.name or "-", shown or "-", str(y.size), *ends))
    return Table(["no.", "column", "unit", "samples", "smallest", "largest"], rows, (1, 2))


def view_motion(record: FileRecord) -> RecordView:
    """Collect what `bayesdamp look` shows about the record of an oscillation.

    If the record has no free decay, a line gives the reason, and the window is None.
    """
    raw, signal = record.raw, record.signal
    t = raw.t if raw.t is not None else np.arange(raw.y.size) / (raw.rate or 1.0)
    name = (record.several and record.label) or raw.channel or "the record"
    unit = UNITS[record.unit]
    quantity = f"{unit.quantity_name(record.quantity)} in {unit.of(record.quantity)}"
    time, value = raw.columns
    clock = f"times from column {time!r}" if time is not None else f"{raw.rate or 0:.6g} Hz"
    reading = f"column {value!r} as {quantity}, {clock}, {raw.y.size} samples"
    about = raw.provenance if signal is None else signal.provenance
    lines, window = list(about.sentences), None
    if signal is None:
        lines.append(f"No free decay: {record.refusal}")
        lines += [MAYBE_ENVELOPE] if raw.y.min() >= 0 else []
    else:
        assert about.stop is not None  # cleaning states it
        window = about.start, about.stop
        gaps = holes(signal.t, coarse_period(signal.t, signal.y)[0])  # the sampling rate does not show gaps
        listed = ", ".join(f"{b - a:.3g} s from {about.start + a:.4g} s on" for a, b in gaps[:MOST_GAPS])
        more = f" and {len(gaps) - MOST_GAPS} more" if len(gaps) > MOST_GAPS else ""
        lines += [f"No samples for {listed}{more}; the fit bridges the gap."] if listed else []
    return RecordView(name, reading, lines, t, raw.y, window)


def view_envelope(path: Path, ends: tuple[float | str, float | str], **options: Any) -> RecordView:
    """Read an envelope (amplitude against time), and collect what `bayesdamp look` shows about it.

    If the record has no free decay, a line gives the reason, and the window is None.

    Parameters
    ----------
    path
        The file.
    ends
        Start and end of the decay in s, or "auto".
    **options
        Options of `read_envelope`.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    record = read_envelope(path, **options)
    t, level = record.t, record.level
    inside = None
    try:
        window = window_between(t, level, *(end if isinstance(end, float) else None for end in ends))
    except Refusal as refusal:
        lines = [f"No free decay: {refusal}."]
    else:
        inside = float(t[window.start]), float(t[window.stop - 1])
        lines = [
            f"The decay {' and '.join(why for why in window.why if why)}.",
            f"In the decay the level falls by {level[window.start] - level[window.stop - 1]:.3g} dB.",
            f"The oscillation's frequency is {record.frequency:.9g} Hz."
            if record.frequency is not None
            else f"To get Q, give the frequency: bayesdamp compare {shlex.quote(str(path))} --frequency HZ",
        ]
    y = level if record.logarithmic else np.array([record.amplitude(float(x))[0] for x in level])
    what = f"{t.size} readings from {time_span(t[0], t[-1])}"
    return RecordView(f"an envelope in {record.unit}", what, [*record.notes, *lines], t, y, inside)


def braille_rows(t: np.ndarray, y: np.ndarray, columns: int, rows: int) -> list[str]:
    """Draw the curve y (n,) against t (n,) with braille characters, and return the rows of text, the top row first.

    `columns` and `rows` are the numbers of characters. All values are finite, and t is ascending. Each character has
    two columns and four rows of dots. In each column of dots, the dots from the smallest to the largest value are set.
    They are extended up or down until they touch the last value of the nearest earlier column with values.
    """
    wide, high = 2 * columns, 4 * rows
    span, low, size = float(t[-1] - t[0]), float(y.min()), float(np.ptp(y))
    at = np.minimum(((t - t[0]) / span * wide).astype(int), wide - 1) if span > 0 else np.zeros(t.size, int)
    level = np.minimum(((y - low) / size * high).astype(int), high - 1) if size > 0 else np.zeros(t.size, int)
    canvas = np.zeros((high, wide), bool)
    last = level[0]
    for x in np.unique(at):
        values = level[at == x]
        # Extend the range so that it touches the column before it.
        bottom, top = min(values.min(), last + 1), max(values.max(), last - 1)
        canvas[high - 1 - top : high - bottom, x] = True
        last = values[-1]
    bits = (canvas.reshape(rows, 4, columns, 2) * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return ["".join(chr(0x2800 + int(b)) for b in row) for row in bits]


def plot(t: np.ndarray, y: np.ndarray, window: tuple[float, float] | None, columns: int) -> Text:
    """Return a plot of a record for the terminal, in braille characters.

    A line below marks the free decay, if there is one. The last line gives the ranges of times and values.

    Parameters
    ----------
    t, y
        Times in s and values, (n,).
    window
        Start and end of the free decay in s, which is drawn in a bright colour; None if there is none.
    columns
        Width of the plot in characters; its height is `PLOT_ROWS`.
    """
    span = float(t[-1] - t[0]) or 1.0
    edges = [int((end - t[0]) / span * columns) for end in window] if window else [0, -1]
    text = Text()
    for line in braille_rows(t, y, columns, PLOT_ROWS):
        for i, character in enumerate(line):
            text.append(character, "cyan" if edges[0] <= i <= edges[1] else "bright_black")
        text.append("\n")
    if window:
        ruler = "".join("─" if edges[0] <= i <= edges[1] else " " for i in range(columns))
        text.append(f"{ruler}\n", "cyan")
    text.append(f"time {time_span(t[0], t[-1])}, values {y.min():.4g} to {y.max():.4g}")
    return text
