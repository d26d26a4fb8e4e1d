"""Show the progress of a run: a description of each stage, and a bar that counts its jobs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from bayesdamp.types import candidate_parts

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar

    from bayesdamp.config import Study
    from bayesdamp.pipeline.jobs import Job

T = TypeVar("T")
READING, CANDIDATES = "reading", "candidates"
ACTIVITIES = {
    "read": f"{READING} {{records}}",
    "answer": "measuring the damping of {records} with {models}{laws}",
    "sampled": "measuring the damping of {records} by sampling",
    CANDIDATES: "fitting, sampling and weighing {models} on {records}",
}
"""What the jobs of a stage do, for the user, by the `task_group` of the jobs. `CANDIDATES` is for jobs on single
models, which have no task group."""


def describe_stage(study: Study, jobs: list[Job]) -> str:
    """Return what the jobs of a stage (at least one) do, such as "measuring the damping of 2 records by sampling"."""
    names = {job.signal for job in jobs}
    specs = [spec for spec in study.signals if spec.name in names]
    sums = {candidate_parts(job.model)[0] for job in jobs if job.model}
    laws = max((len(spec.restoring) for spec in specs), default=0)  # an envelope has none
    return ACTIVITIES[jobs[0].task_group or CANDIDATES].format(
        records=_with_count(len({(job.signal, job.repeat) for job in jobs}), "record"),
        models=_with_count(
            len(sums) or max((len(study.dampings(spec)) for spec in specs), default=0), "damping model"
        ),
        laws=f" and {_with_count(laws, 'restoring law')}" if laws else "",
    )


def _with_count(number: int, what: str) -> str:
    """Return a number with a noun, such as "1 record" or "2 records"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


class Progress:
    """Show the steps of a run to the user: as a bar on a terminal, otherwise as one line for each step.

    Outside a terminal, the step that reads the records has no line.
    """

    def __init__(self, bar: Bar) -> None:
        self._bar, self._task = bar, bar.add_task("", total=None)

    def begin(self, words: str, jobs: Sequence[Job]) -> None:
        """Show the next step of a run: its description `words`, and a bar from 0 to the number of its `jobs`."""
        self._bar.reset(self._task, description=words, total=max(1, len(jobs)))
        if not self._bar.console.is_terminal and not words.startswith(READING):
            self._bar.console.print(words, soft_wrap=True, highlight=False, markup=False)

    def advance(self) -> None:
        """Count one job of the current step as done."""
        self._bar.update(self._task, advance=1)


def map_with_bar(
    run: Callable[..., Iterable[T]], function: Callable[[Any], T], items: Sequence[Any]
) -> Iterator[T]:
    """Yield the results of `run(function, items)`, and show a bar that counts them on standard error.

    run: function that is called like `map`.
    """
    from rich.console import Console

    with progress_bar(Console(stderr=True)) as bar:
        yield from bar.track(run(function, items), len(items), description="")


def progress_bar(console: Console) -> Bar:
    """Return a progress bar for one or several activities. It shows nothing if the console is not a terminal."""
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
