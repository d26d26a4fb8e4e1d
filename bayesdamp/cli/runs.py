"""Run the study of a command, and print its verdicts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer
from rich.console import Console

from bayesdamp.config import Study
from bayesdamp.machine import cache_folder
from bayesdamp.pipeline import Depth, run_study
from bayesdamp.report.terminal import Lasting, VerdictPrinter

FIRST_WORDS = 5
"""Largest number of records in one command for which a first line on each is printed."""


def compilation_notice() -> str:
    """Return a notice where a first run has nothing compiled yet and takes longer; empty later."""
    if any((cache_folder() / "kernels").glob("*")):
        return ""
    return "compiling the equations of motion for this machine; this first run takes about 20 s longer"


def run_and_print(
    study: Study,
    folder: Path,
    depth: Depth,
    finish: Callable[[Path, Console], None],
    *,
    as_json: bool,
    **options: Any,
) -> int:
    """Run a study, print its verdicts as they come, and return the exit status.

    Parameters
    ----------
    study
        The study.
    folder
        The folder of the run.
    depth
        How thoroughly the answer is checked.
    finish
        Prints the summary of the run's folder at the end; not called with `as_json`.
    as_json
        Whether verdicts are printed as JSON.
    **options
        Options of `run_study`.
    """
    envelopes_only = all(s.is_envelope for s in study.signals)
    if not options["quiet"] and not envelopes_only and (notice := compilation_notice()):
        typer.echo(notice, err=True)
    shown = Lasting()
    answered = None
    if not as_json and len(study.signals) <= FIRST_WORDS:
        answered = VerdictPrinter(shown, {spec.name: spec.source.unit for spec in study.signals})
    status = run_study(study, folder, console=Console(stderr=True), depth=depth, answered=answered, **options)
    if as_json:
        path = folder / "verdict.json"
        typer.echo(path.read_text(encoding="utf-8").rstrip("\n") if path.is_file() else "[]")
    else:
        finish(folder, shown)
    return status
