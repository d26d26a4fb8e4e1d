"""What a comparison says on the terminal: the answer of each record as soon as it is there, and how it ended."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bayesdamp.report.results.answers import verdicts
from bayesdamp.report.results.confirmation import confirmation, sampled_words
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.specimens import sentences
from bayesdamp.types import BEWARE, OK
from bayesdamp.verdict.agreement import agreement
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import energy_of, with_interval


class Told:
    """Tells each record's verdict as it comes, and then what sampling its motions made of it."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.first: dict[str, Verdict] = {}

    def __call__(self, verdict: Verdict) -> None:
        """Tell of a record's verdict: the first in full, and of a later one whether it confirms that."""
        before = self.first.setdefault(verdict.record, verdict)
        if before is verdict:
            answered(verdict, self.console)
            return
        found = agreement(before, verdict)
        self.console.print(Text(sampled_words(found)), soft_wrap=True)
        if not found.confirms:
            answered(verdict, self.console)


def answered(verdict: Verdict, console: Console) -> None:
    """Print a verdict: its sentence, the damping ratio against amplitude, the remarks."""
    console.print()
    console.print(Text.assemble((f"{verdict.record}: ", "bold"), verdict.sentence), soft_wrap=True)
    if verdict.damping_ratio:
        console.print(_ratios(verdict))
    for remark in verdict.remarks:
        console.print(Text(f"- {remark}"), soft_wrap=True)


def conclude(folder: Path, console: Console) -> None:
    """Print how sampling changed what was said, what one has to know of the records, and where the report is."""
    run = Run(folder)
    said = {v.record for v in verdicts(run)}
    for signal in run.signals:
        if signal not in said:
            console.print()
            console.print(Text(f"{signal}: {_why(run, signal)}"), soft_wrap=True)
        for warning in run.warnings(signal):
            console.print(Text(BEWARE + warning), soft_wrap=True)
        confirmed = confirmation(run, signal)
        if confirmed:
            console.print(Text(confirmed), soft_wrap=True)
    for text in sentences(run):
        console.print()
        console.print(Text(text), soft_wrap=True)
    console.print(str(folder / "report.html"), soft_wrap=True, highlight=False)


def _why(run: Run, signal: str) -> str:
    """Why a record has no verdict."""
    cell = run.cell("answer", signal, run.repeats(signal)[0])
    outcome = cell.outcome if cell is not None else str(run.about(signal).get("outcome", OK))
    return f"no verdict{'' if outcome == OK else ': ' + outcome.rstrip('.')}."


def _ratios(verdict: Verdict) -> Table:
    table = Table("amplitude", "equivalent damping ratio (95 %)", "Q")
    for r in verdict.damping_ratio:
        q = with_interval(0.5 / r.value, 0.5 / r.high, 0.5 / r.low) if r.low > 0 else f"{0.5 / r.value:.3g}"
        table.add_row(f"{r.amplitude:.3g} {r.unit}", with_interval(r.value, r.low, r.high, " %", 100), q)
    table.caption = energy_of(verdict)
    return table
