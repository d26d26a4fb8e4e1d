"""What is shown while a run goes on: the step in a user's words, and how far it is."""

from __future__ import annotations

from collections.abc import Iterator, Set
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bayesdamp.types import candidate_parts

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar

    from bayesdamp.config import Study
    from bayesdamp.pipeline.jobs import Job

READING = "reading"
DOING = {
    None: "estimating, fitting, sampling",
    "look": "estimating and fitting",
    "weigh": "weighing more closely",
    "sample": "sampling",
    "depend": "trying other priors and half the record with",
}
"""What is done with damping models, by the part of a job."""


def words_of(study: Study, jobs: list[Job], others: Set[tuple[str, int]] = frozenset()) -> str:
    """Return a stage of a study in words. others: records, as (signal, repeat), that are known to be no free decay, of
    which nothing is weighed."""
    job, whole = jobs[0], len(jobs)
    if job.part in ("answer", "sampled"):
        weighed = [j for j in jobs if (j.signal, j.repeat) not in others]
        if not weighed:
            it = "what moves" if whole == 1 else f"what moves in {counted(whole, 'record')}"
            return f"measuring {it}: no free decay, so no damping model is weighed"
        jobs = weighed
    records = counted(len({(j.signal, j.repeat) for j in jobs}), "record")
    if job.part == "read":
        return f"{READING} {records}"
    if job.part == "answer":
        specs = [s for s in study.signals if s.name in {j.signal for j in jobs}]
        sums = counted(max(len(study.dampings(s)) for s in specs), "damping model")
        laws = max(len(s.restoring) for s in specs)
        under = f" under {counted(laws, 'restoring law')}" if laws else ""  # an envelope has none
        return f"weighing {sums}{under}{f' for {records}' if len(jobs) > 1 else ''}"
    if job.part == "sampled":
        return f"sampling the likeliest damping models of {records}"
    if job.joined:
        return {
            "average": "averaging over damping models",
            "specimen": f"joining the records of {counted(whole, 'specimen')}",
            "population": "comparing the specimens",
        }[job.joined]
    models = counted(len({candidate_parts(j.model)[0] for j in jobs if j.model}), "damping model")
    return f"{DOING[job.part]} {models} on {records}"


def counted(number: int, what: str) -> str:
    """Return a number with its noun, in the plural where it is not one."""
    return f"{number} {what}{'' if number == 1 else 's'}"


class Progress:
    """One step after the other: on a terminal a bar with the time that the step has left, elsewhere a line a step."""

    def __init__(self, bar: Bar) -> None:
        self._bar = bar
        self._task = bar.add_task("", total=None)

    def begin(self, words: str, jobs: int) -> None:
        """Show the next step."""
        self._bar.reset(self._task, description=words, total=jobs)
        if not self._bar.console.is_terminal and not words.startswith(READING):
            self._bar.console.print(words, soft_wrap=True, highlight=False, markup=False)

    def advance(self) -> None:
        """Show that one job of the step is done."""
        self._bar.advance(self._task)


def progress_bar(console: Console) -> Bar:
    """Return the bar of steps, or of several things that go on at once."""
    # Not for workers, which show nothing.
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bar

    columns = (BarColumn(bar_width=20), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    return Bar(
        TextColumn("{task.description}"),
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


@contextmanager
def progress_on(console: Console) -> Iterator[Progress]:
    """Show progress while the context lasts; nothing on a quiet console."""
    with progress_bar(console) as bar:
        yield Progress(bar)
