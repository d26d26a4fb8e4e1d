"""Show the progress of a run: a description of each stage, and a bar that counts its jobs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bayesdamp.types import candidate_parts

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar

    from bayesdamp.config import Study
    from bayesdamp.pipeline.jobs import Job

READING = "reading"
ACTIVITIES = {
    "fit": "estimating and fitting",
    "evidence": "computing the evidence of",
    "sample": "sampling",
    "sensitivity": "repeating with other priors and with half the record:",
}
"""What a job on damping models does, by its `task_group`."""


def describe_stage(study: Study, jobs: list[Job]) -> str:
    """Return a description of a stage for the user, such as "sampling 3 damping models on 1 record"."""
    job = jobs[0]
    records = _with_count(len({(j.signal, j.repeat) for j in jobs}), "record")
    if job.task_group == "read":
        return f"{READING} {records}"
    if job.task_group == "answer":
        specs = [s for s in study.signals if s.name in {j.signal for j in jobs}]
        sums = _with_count(max(len(study.dampings(s)) for s in specs), "damping model")
        laws = max(len(s.restoring) for s in specs)
        under = f" and {_with_count(laws, 'restoring law')}" if laws else ""  # an envelope has none
        return f"measuring the damping of {records} with {sums}{under}"
    if job.model is not None:
        models = _with_count(len({candidate_parts(j.model)[0] for j in jobs if j.model}), "damping model")
        return f"{ACTIVITIES[str(job.task_group)]} {models} on {records}"
    return {
        "sampled": f"checking the answer on {records} by sampling",
        "average": "averaging over damping models",
        "specimen": f"fitting the records of {_with_count(len(jobs), 'specimen')} together",
        "population": "inferring the population of the specimens",
    }[str(job.task_group)]


def _with_count(number: int, what: str) -> str:
    """Return a number and a noun, which is in the plural unless the number is 1."""
    return f"{number} {what}{'' if number == 1 else 's'}"


class Progress:
    """Show the steps of a run: as a bar on a terminal, otherwise as one line for each step."""

    def __init__(self, bar: Bar) -> None:
        self._bar, self._task = bar, bar.add_task("", total=None)

    def begin(self, words: str, jobs: Sequence[Job]) -> None:
        """Show the next step of the run: its description `words`, and a bar that will count its `jobs`."""
        self._bar.reset(self._task, description=words, total=max(1, len(jobs)))
        if not self._bar.console.is_terminal and not words.startswith(READING):
            self._bar.console.print(words, soft_wrap=True, highlight=False, markup=False)

    def advance(self) -> None:
        """Count one job of the current step as done."""
        self._bar.update(self._task, advance=1)


def progress_bar(console: Console) -> Bar:
    """Return a progress bar for one or several activities, which shows nothing if the console is not a terminal."""
    # Imported here because workers, which show nothing, do not need it.
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress as Bar,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
