"""What a comparison says on the terminal: the answer of each record as soon as it is there, and how it ended."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.text import Text

from bayesdamp.report.results.answers import answers, specimens
from bayesdamp.report.results.checks import sampled_words
from bayesdamp.report.results.overview import overview_table
from bayesdamp.report.results.run import Run
from bayesdamp.types import OK
from bayesdamp.units import unit_named
from bayesdamp.verdict.agreement import agreement
from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.tables import decay_table, modes_table, ratios_table
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import energy_of


class Lasting(Console):
    """A console that goes on without a word where what reads it has closed it: the run and its report are for later."""

    def on_broken_pipe(self) -> None:
        """Print nothing more."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class Told:
    """Tells each record's verdict as it comes, and then what sampling its motions made of it."""

    def __init__(self, console: Console, units: Mapping[str, str] | None = None) -> None:
        """units: of each record's displacement, by its name; else the verdict's own."""
        self.console, self._units = console, units or {}
        self.first: dict[str, Verdict] = {}
        self._begun = False

    def __call__(self, verdict: Verdict) -> None:
        """Tell of a record's verdict: the first in full, and of a later one whether it confirms that."""
        before = self.first.setdefault(verdict.record, verdict)
        if before is verdict:
            if self._begun:
                self.console.print()
            self._begun = True
            answered(self._shown(verdict), self.console)
            return
        free = before.law_free and verdict.law_free  # what is measured without a law is not sampled
        if free or verdict.grade is Grade.NO_FREE_DECAY or verdict.quantity == "envelope":
            return
        found = agreement(before, verdict)
        self.console.print(Text(sampled_words(found)), soft_wrap=True)
        if not found.confirms:
            self.console.print()
            answered(self._shown(verdict), self.console)

    def _shown(self, verdict: Verdict) -> Verdict:
        unit = self._units.get(verdict.record)
        return in_unit(verdict, unit_named(unit)) if unit else verdict


def answered(verdict: Verdict, console: Console) -> None:
    """Print a verdict: its sentence, the damping ratio against amplitude, the remarks."""
    console.print(Text.assemble((f"{verdict.record}: ", "bold"), verdict.sentence), soft_wrap=True)
    if verdict.decay_rate:
        console.print(decay_table(verdict.decay_rate, verdict.quality_factor_at).rich())
    elif verdict.damping_ratio:
        console.print(ratios_table(verdict.damping_ratio).rich())
        for said in energy_of(verdict):
            console.print(Text(said), soft_wrap=True)
    if verdict.modes:
        console.print(modes_table(verdict.modes, verdict.motion).rich())
    for remark in verdict.remarks:
        console.print(Text(f"- {remark}"), soft_wrap=True)


def conclude(folder: Path, console: Console) -> None:
    """Print how sampling changed what was said, what one has to know of the records, and where the report is."""
    run = Run(folder)
    found = answers(run)
    said = {a.signal for a in found}
    for together in specimens(run):
        console.print()
        answered(together, console)
    if len(found) > 1:
        console.print()
        console.print(
            overview_table(found, brief=True).rich(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
        )
    for signal in run.signals:
        if signal not in said:
            cell = run.cell("answer", signal, run.repeats(signal)[0])
            outcome = cell.outcome if cell is not None else str(run.about(signal).get("outcome", OK))
            why = "" if outcome == OK else f": {outcome.rstrip('.')}"
            console.print()
            console.print(Text(f"{signal}: no verdict{why}."), soft_wrap=True)
    beware(folder, console)
    console.print(str(folder / "report.html"), soft_wrap=True, highlight=False)


def beware(folder: Path, console: Console) -> None:
    """Print what one has to know of the records of a run."""
    run = Run(folder)
    for signal in run.signals:
        whose = f"{signal}: " if len(run.signals) > 1 else ""
        for warning in run.provenance(signal).warnings:
            console.print(Text(f"Beware: {whose}{warning}"), soft_wrap=True)
