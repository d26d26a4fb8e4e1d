"""Print a comparison on the terminal: the answer of each record as soon as it is available, and the final result."""

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.text import Text

from bayesdamp.report.results.checks import sampling_sentence
from bayesdamp.report.results.run import RunFolder, answers, no_verdict_sentence, overview_table, specimens
from bayesdamp.types import unit_named
from bayesdamp.verdict.parts import Grade, decay_table, modes_table, ratios_table
from bayesdamp.verdict.specimen import agreement
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import energy_sentences, noise_sentence


class PipeSafeConsole(Console):
    """A console that stops printing when the reader of its output closes it, so that the run still finishes."""

    def on_broken_pipe(self) -> None:
        """Stop printing, and discard what is still buffered."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


class VerdictPrinter:
    """Print each record's verdict when it arrives, and later whether sampling confirms this verdict.

    Parameters
    ----------
    console
        The console to print on.
    units
        Unit in which to print each record's displacement, by the record's name. Other records are printed in the unit
        of their verdict.

    Attributes
    ----------
    first
        The first verdict on each record, in its own unit, by the record's name.
    """

    def __init__(self, console: Console, units: Mapping[str, str] | None = None) -> None:
        self.console, self._units = console, units or {}
        self.first: dict[str, Verdict] = {}

    def __call__(self, verdict: Verdict) -> None:
        """Print a record's first verdict in full, or compare a later verdict (from sampling) with the first one.

        For a later verdict, a sentence says whether it confirms the first one. If it does, only its own sentence
        follows, otherwise the whole verdict. Nothing is printed for it in three cases: neither verdict names a damping
        law, the record is not a free decay, or the record is an envelope.
        """
        unit = self._units.get(verdict.record)
        converted = in_unit(verdict, unit_named(unit)) if unit else verdict
        before = self.first.get(verdict.record)
        if before is None:
            if self.first:
                self.console.print()
            self.first[verdict.record] = verdict
            print_verdict(converted, self.console)
            return
        both_without_law = before.law_free and verdict.law_free  # then nothing was sampled
        if both_without_law or verdict.grade is Grade.NO_FREE_DECAY or verdict.quantity == "envelope":
            return
        comparison = agreement(before, verdict)
        self.console.print(Text(sampling_sentence(comparison)), soft_wrap=True)
        if comparison.confirms:
            _print_sentence(converted, self.console)
        else:
            self.console.print()
            print_verdict(converted, self.console)


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Print a verdict: its sentence, a table of damping ratios or decay rates, and the remarks.

    If the verdict contains them, these are printed before the remarks: sentences on the energy that each damping term
    dissipates, sentences on the noise, and a table of the oscillations in a record that is not a free decay.
    """
    _print_sentence(verdict, console)
    if verdict.decay_rate:
        console.print(decay_table(verdict.decay_rate, verdict.quality_factor_at).rich())
    elif verdict.damping_ratio:
        console.print(ratios_table(verdict.damping_ratio).rich())
    energy = energy_sentences(verdict) if verdict.damping_ratio and not verdict.decay_rate else ()
    for sentence in (*energy, *noise_sentence(verdict)):
        console.print(Text(sentence), soft_wrap=True)
    if verdict.modes:
        console.print(modes_table(verdict.modes, verdict.motion).rich())
    for remark in verdict.remarks:
        console.print(Text(f"- {remark}"), soft_wrap=True)


def _print_sentence(verdict: Verdict, console: Console) -> None:
    """Print the record's name and the sentence of its verdict."""
    console.print(Text.assemble((f"{verdict.record}: ", "bold"), verdict.sentence), soft_wrap=True)


def print_conclusion(folder: Path, console: Console) -> None:
    """Print the end of a run: verdicts on specimens, a table of the records, warnings, and the path of the report.

    A specimen is a tested object with several records. The table is left out if fewer than two records have a verdict.
    Before the warnings, a line for each record without a verdict gives the reason.
    """
    run = RunFolder(folder)
    available = answers(run)
    for verdict in specimens(run):
        console.print()
        print_verdict(verdict, console)
    if len(available) > 1:
        console.print()
        table = overview_table(available, brief=True)
        console.print(table.rich(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0)))
    answered = {answer.signal for answer in available}
    for signal in run.signals:
        if signal not in answered:
            console.print()
            console.print(Text(f"{signal}: {no_verdict_sentence(run, signal)}"), soft_wrap=True)
    print_warnings(run, console)
    console.print(str(folder / "report.html"), soft_wrap=True, highlight=False)


def print_warnings(run: RunFolder, console: Console) -> None:
    """Print the warnings from reading the records of a run, with the record's name if the run has several records."""
    for signal in run.signals:
        whose = f"{signal}: " if len(run.signals) > 1 else ""
        for warning in run.provenance(signal).warnings:
            console.print(Text(f"Beware: {whose}{warning}"), soft_wrap=True)
