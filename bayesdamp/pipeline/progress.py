"""What is shown while a run goes on: the step in a user's words, and the time that the whole run has left."""

from __future__ import annotations

import contextlib
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bayesdamp.machine.cache import cache_folder
from bayesdamp.types import candidate_parts

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Task

    from bayesdamp.config import Study
    from bayesdamp.pipeline.jobs import Job

PLAIN = 15.0
"""Seconds between lines of one step where there is no terminal (conventional)."""
NOTHING = 0.2
"""Seconds for a job below which it is taken to have been done before (conventional)."""
REPORT = "report"
SAMPLED = 2
"""Candidates of a record that a staged study samples, about."""


@dataclass(frozen=True)
class Step:
    """Jobs that run side by side. kind: of which they are, by which the time of one is remembered; usual: whether the
    time that these take says something of others."""

    kind: str
    words: str
    jobs: int
    usual: bool = True


def step_of(study: Study, jobs: list[Job], others: Set[tuple[str, int]] = frozenset()) -> Step:
    """A stage of a study in words. others: records, as (signal, repeat), that are known to be no free decay, of which
    nothing is weighed."""
    job, whole = jobs[0], len(jobs)
    weighed = [j for j in jobs if (j.signal, j.repeat) not in others]
    if job.part in ("answer", "sampled"):
        if not weighed:
            it = "what moves" if len(jobs) == 1 else f"what moves in {counted(len(jobs), 'record')}"
            return Step(
                job.part, f"measuring {it}: no free decay, so no damping model is weighed", len(jobs), False
            )
        jobs = weighed
    records = counted(len({(j.signal, j.repeat) for j in jobs}), "record")
    if job.part == "read":
        return Step("read", f"reading {records}", len(jobs))
    if job.part == "answer":
        specs = [s for s in study.signals if s.name in {j.signal for j in jobs}]
        sums = counted(max(len(study.dampings(s)) for s in specs), "damping model")
        laws = max(len(s.restoring) for s in specs)
        under = f" under {counted(laws, 'restoring law')}" if laws else ""
        of = f" for {records}" if len(jobs) > 1 else ""
        kind = "answer" if laws else "envelope"
        return Step(kind, f"weighing {sums}{under}{of}", whole)
    if job.part == "sampled":
        return Step("sampled", f"sampling the likeliest damping models of {records}", whole)
    joined = {
        "average": "averaging over damping models",
        "specimen": f"joining the records of {counted(len(jobs), 'specimen')}",
        "population": "comparing the specimens",
    }
    if job.joined:
        return Step(job.joined, joined[job.joined], len(jobs))
    return Step(job.part or "model", f"{_DOING[job.part]} {_models(jobs)} on {records}", len(jobs))


def planned(study: Study, jobs: Sequence[Job], stored: Set[str]) -> list[Step]:
    """The steps of a run, as far as they are known before it, without what is stored already; the report ends them.

    Of a study that leaves candidates out as it goes all are looked at, and `SAMPLED` of each record sampled.
    """
    staged = study.models.prune is not None or study.posterior.best is not None
    kinds: dict[str, list[Job]] = {}
    for job in jobs:
        kind = "mode" if job.model else {"read": "signal"}.get(job.part or "", job.part)
        if f"{kind}/{job.signal}/{job.repeat}{f'/{job.model}' if job.model else ''}" in stored:
            continue
        job = replace(job, part="look") if staged and job.model else job
        kinds.setdefault(step_of(study, [job]).kind, []).append(job)
    steps = [step_of(study, found) for found in kinds.values()]
    looked = {(job.signal, job.repeat) for job in kinds.get("look", ())}
    steps += [Step("sample", "sampling", SAMPLED * len(looked))] if looked else []
    return [*steps, Step(REPORT, "drawing the report", 1)]


_DOING = {
    None: "estimating, fitting, sampling",
    "look": "estimating and fitting",
    "weigh": "weighing more closely",
    "sample": "sampling",
    "depend": "trying other priors and half the record with",
}


def _models(jobs: list[Job]) -> str:
    sums = {candidate_parts(j.model)[0] for j in jobs if j.model}
    return counted(len(sums), "damping model")


def counted(number: int, what: str) -> str:
    """A number with its noun, in the plural where it is not one."""
    return f"{number} {what}{'' if number == 1 else 's'}"


FEW = 3.5
"""Seconds that are called a few (conventional)."""


def left_words(seconds: float) -> str:
    """Time left, as coarse as it is known."""
    if math.isnan(seconds):
        return ""
    if seconds < FEW:
        return "a few seconds left"
    if seconds < 95:
        return f"about {5 if seconds < 7.5 else max(10, 10 * round(seconds / 10))} s left"
    if seconds < 5400:
        return f"about {counted(round(seconds / 60), 'minute')} left"
    return f"about {counted(round(seconds / 3600), 'hour')} left"


USUAL = {
    "answer": 12.0, "sampled": 8.0, "model": 12.0, "look": 4.0, "weigh": 3.0, "sample": 10.0, "depend": 6.0,
    "envelope": 0.5, "average": 1.0, "specimen": 20.0, "population": 10.0, REPORT: 6.0,
}  # fmt: skip
"""Wall seconds of a job of each kind where this machine has done none (measured: two cores, 1,000 samples)."""


class Pace:
    """Seconds that a job of each kind takes on this machine, kept from run to run in the user's cache."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or cache_folder() / "pace.json"
        self._seconds: dict[str, float] = {}
        with contextlib.suppress(OSError, ValueError):
            found = json.loads(self.path.read_text(encoding="utf-8"))
            self._seconds = {str(k): float(v) for k, v in found.items()}

    def of(self, kind: str) -> float:
        """Wall seconds for a job, NaN where none was seen."""
        return self._seconds.get(kind, math.nan)

    def learn(self, kind: str, seconds: float) -> None:
        """Take what a job of this kind took, half by half with what was known."""
        if seconds < NOTHING:
            return
        known = self.of(kind)
        self._seconds[kind] = seconds if math.isnan(known) else 0.5 * (known + seconds)
        partial = self.path.with_name(f".pace.{os.getpid()}")
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            partial.write_text(json.dumps(self._seconds), encoding="utf-8")
            partial.replace(self.path)


SLOWER, LATER = 1.5, 10.0
"""What is shown goes up only where the estimate is so many times it and so many seconds more (conventional)."""
OVERDUE = 1.1
"""Times what a step usually takes, or `FEW` seconds more, after which it takes longer than usual (conventional)."""


class Progress:
    """One step after the other. show: told of a step's words and the time that is left."""

    def __init__(self, show: Callable[[Progress], None], pace: Pace | None = None) -> None:
        self._show, self._pace = show, pace or Pace()
        self.step = Step("", "", 0)
        self.done = 0
        self._later: list[Step] = []
        self._began = time.monotonic()
        self._shown = math.nan

    def plan(self, steps: Sequence[Step]) -> None:
        """What the run will do, as far as it is known before: each step as it begins takes its kind out of it."""
        self._later = list(steps)

    def begin(self, step: Step) -> None:
        """The next step; the one before is over, and what was planned before its kind is not done."""
        self.end()
        kinds = [one.kind for one in self._later]
        if step.kind in kinds:
            self._later = self._later[kinds.index(step.kind) + 1 :]
        self.step, self.done, self._began = step, 0, time.monotonic()
        self._show(self)

    def advance(self) -> None:
        """One job of the step is done."""
        self.done += 1
        self._show(self)

    def end(self) -> None:
        """The step is over."""
        if self.step.jobs and self.step.usual:
            self._pace.learn(self.step.kind, (time.monotonic() - self._began) / self.step.jobs)
        self.step, self.done = Step("", "", 0), 0

    def left(self) -> float:
        """Seconds that the whole run has left: of this step by its own pace or that of earlier runs, of later ones by
        that or by what is usual; NaN where nothing is known of the step, or it has taken longer than was thought."""
        return self._of_step() + sum(self._seconds(one) for one in self._later)

    def _of_step(self) -> float:
        gone = time.monotonic() - self._began
        if self.done:
            return gone / self.done * (self.step.jobs - self.done)
        whole = self._seconds(self.step)
        return whole - gone if whole > gone else math.nan

    def _seconds(self, step: Step) -> float:
        each = self._pace.of(step.kind)
        return step.jobs * (USUAL.get(step.kind, math.nan) if math.isnan(each) else each)

    def line(self) -> str:
        """The step, and the time that the run has left: it goes down, or stays, but for a run that is far slower than
        was thought."""
        left = self.left()
        if math.isnan(self._shown) or left < self._shown or left > SLOWER * self._shown + LATER:
            self._shown = left
        late = math.isnan(left) and self._overdue()
        return ", ".join(
            filter(None, (self.step.words, "longer than usual" if late else left_words(self._shown)))
        )

    def _overdue(self) -> bool:
        """Whether a step has taken longer than its kind does."""
        usual = self._seconds(self.step)
        return time.monotonic() - self._began > max(OVERDUE * usual, usual + FEW)


@contextmanager
def progress_on(console: Console) -> Iterator[Progress]:
    """A moving line on a terminal, plain lines elsewhere, nothing on a quiet console."""
    if not console.is_terminal:
        yield _plain(console)
        return
    from rich.progress import BarColumn, ProgressColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar
    from rich.text import Text

    class Line(ProgressColumn):
        """Drawn anew as time goes."""

        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            return Text(found.line())

    bar = Bar(Line(), BarColumn(bar_width=20), TimeElapsedColumn(), console=console, transient=True)
    found = Progress(lambda p: bar.update(task, total=p.step.jobs or None, completed=p.done))
    task = bar.add_task("", total=None)
    with bar:
        yield found
        found.end()


def _plain(console: Console) -> Progress:
    last = [-math.inf, ""]

    def show(progress: Progress) -> None:
        new = progress.step.words != last[1]
        over = progress.done == progress.step.jobs
        if progress.step.kind != "read" and (
            new or (not over and time.monotonic() - float(last[0]) >= PLAIN)
        ):
            console.print(progress.line(), soft_wrap=True, highlight=False, markup=False)
            last[:] = [time.monotonic(), progress.step.words]

    return Progress(show)
