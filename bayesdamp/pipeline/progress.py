"""What is shown while a run goes on: the step in a user's words, and how far it is."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bayesdamp.formatting import duration
from bayesdamp.types import candidate_parts

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar
    from rich.progress import ProgressColumn

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
TYPICAL = {
    "read": 0.4, "answer": 2.0, "sampled": 2.0, "model": 10.0, "average": 0.5,
    "specimen": 2.0, "population": 5.0, "": 3.0
}  # fmt: skip
"""Seconds of a job of each kind, and of drawing the report, as the shipped studies take them on one core."""


def words_of(study: Study, jobs: list[Job]) -> str:
    """Return a stage of a study in words."""
    job, whole = jobs[0], len(jobs)
    records = counted(len({(j.signal, j.repeat) for j in jobs}), "record")
    if job.part == "read":
        return f"{READING} {records}"
    if job.part == "answer":
        specs = [s for s in study.signals if s.name in {j.signal for j in jobs}]
        sums = counted(max(len(study.dampings(s)) for s in specs), "damping model")
        laws = max(len(s.restoring) for s in specs)
        under = f" and {counted(laws, 'restoring law')}" if laws else ""  # an envelope has none
        return f"measuring the damping of {records} with {sums}{under}"
    if job.part == "sampled":
        return f"checking the answer on {records} by sampling"
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
    """One step after the other: on a terminal a bar with the time that the whole run has left, elsewhere a line a step.

    jobs: of the whole run.
    """

    def __init__(self, bar: Bar, jobs: Sequence[Job] = ()) -> None:
        self._bar, self._kind, self._last = bar, "", 0.0
        self._task = bar.add_task("", total=None, left="")
        self._waiting = Counter(map(_kind_of, jobs))
        self._done, self._seconds = Counter[str](), defaultdict[str, float](float)

    def begin(self, words: str, jobs: Sequence[Job]) -> None:
        """Show the next step."""
        self._kind, self._last = _kind_of(jobs[0]) if jobs else "", time.monotonic()
        self._waiting[self._kind] = max(self._waiting[self._kind], len(jobs))
        self._bar.reset(self._task, description=words, total=max(1, len(jobs)))
        if not self._bar.console.is_terminal and not words.startswith(READING):
            self._bar.console.print(words, soft_wrap=True, highlight=False, markup=False)

    def advance(self) -> None:
        """Show that one job of the step is done."""
        now = time.monotonic()
        self._seconds[self._kind] += now - self._last
        self._last = now
        self._done[self._kind] += 1
        self._waiting[self._kind] = max(0, self._waiting[self._kind] - 1)
        self._bar.update(self._task, advance=1, left=f"{duration(self.left)} left")

    @property
    def left(self) -> float:
        """Seconds that the rest of the run takes: jobs as long as those of their kind took, or in proportion to
        `TYPICAL` where none has been done."""
        pace = sum(self._seconds.values()) / sum(TYPICAL[k] * n for k, n in self._done.items())
        mean = {k: self._seconds[k] / n for k, n in self._done.items()}
        return sum(n * mean.get(k, pace * TYPICAL[k]) for k, n in self._waiting.items())


def _kind_of(job: Job) -> str:
    """Return the kind of a job, whose jobs take about as long as each other."""
    return job.joined or ("model" if job.model else str(job.part))


def progress_bar(console: Console, *columns: ProgressColumn) -> Bar:
    """Return the bar of steps, or of several things that go on at once; columns: behind the others."""
    # Not for workers, which show nothing.
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    return Bar(
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


@contextmanager
def progress_on(console: Console, jobs: Sequence[Job] = ()) -> Iterator[Progress]:
    """Show progress of a run's jobs while the context lasts; nothing on a quiet console."""
    from rich.progress import TextColumn

    with progress_bar(console, TextColumn("{task.fields[left]}")) as bar:
        yield Progress(bar, jobs)
