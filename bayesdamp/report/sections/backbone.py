"""First, no law at all: damping and frequency against amplitude, and what each candidate makes of them."""

from __future__ import annotations

from collections.abc import Callable

from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.report.figures.curves import backbone
from bayesdamp.report.html import folded, paragraph, stack
from bayesdamp.report.results.reading import models_by_rank
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import SignalSection
from bayesdamp.table import Table

SHOWN = 6
"""Candidates that are drawn, the most probable ones."""
_POINTS = "against_amplitude/"


class Backbone(SignalSection):
    """The record's own curves, with every candidate's that was weighed over them."""

    order = 15
    name = "backbone"
    title = "Without any law: damping curve and backbone"
    lead = (
        "Read from turning points and crossings alone. A constant ratio is viscous damping, one that falls as the "
        "inverse of the amplitude Coulomb friction, one that grows with it quadratic damping; a frequency that changes "
        "with the amplitude is a restoring force that is not linear."
    )

    def shows(self, run: Run, signal: str) -> bool:
        """Return whether candidates' curves were stored."""
        return bool(run.cells("curve", signal))

    def part(self, run: Run, signal: str) -> Markup:
        """Return damping ratio and frequency against amplitude."""
        repeat = run.repeats(signal)[0]
        cell = run.cell("signal", signal, repeat)
        if cell is None or f"{_POINTS}ratio" not in cell.arrays:
            return paragraph("The record shows no swings to read them from.")
        record = {n.removeprefix(_POINTS): v for n, v in cell.arrays.items() if n.startswith(_POINTS)}
        found = {m: run.cell("curve", signal, repeat, m) for m in models_by_rank(run, signal, repeat)}
        curves = {m: dict(c.arrays) for m, c in found.items() if c is not None and "ratio" in c.arrays}
        curves = dict(list(curves.items())[:SHOWN])
        shown = run.unit(signal).displacement
        caption = (
            f"{signal}: damping ratio (fall of the log amplitude a cycle, over 2π) and angular frequency of the "
            "record, and of the models at their posterior modes."
        )
        figure = run.drawings.add(
            f"backbone-{signal}", caption, lambda: backbone(record, curves, shown.scale, shown.name)
        )
        columns: dict[str, Callable[[int], str]] = {
            f"amplitude / {shown.name}": lambda i: fmt.number(shown.scale * record["amplitude"][i]),
            "damping ratio": lambda i: fmt.with_error(record["ratio"][i], record["ratio_sd"][i]),
            "frequency / (rad/s)": lambda i: fmt.with_error(
                record["frequency"][i], record["frequency_sd"][i]
            ),
        }
        return stack(figure, folded("These numbers", Table.of(range(len(record["ratio"])), columns, ())))


PLUGIN = Backbone()
